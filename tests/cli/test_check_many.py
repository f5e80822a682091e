"""Several files in one check, and what is written for continuous integration: SARIF, JUnit, the action."""

import json
import os
import re
import shlex
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from mechanisms import COMMAND, four_bar
from oarlock.cli.app import app
from oarlock.diagnosis.verdict.findings import catalogue
from places import FIXTURES, REPOSITORY
from typer.main import get_command

CHECKED = FIXTURES / "check"
WELDED, RING = CHECKED / "welded_pin.xml", CHECKED / "mimic_ring.xml"
QUICK = ("--budget", "0", "--duration", "0.05", "--quiet")


def test_every_file_is_checked_whatever_the_others_are(oarlock_here):
    Path("bad.xml").write_text("<mujoco><worldbody>")
    Path("good.xml").write_text(four_bar())
    said = oarlock_here("check", "good.xml", "gone.xml", "bad.xml", "good.xml", *QUICK)
    assert said.returncode == 2
    verdicts = said.stdout.splitlines()[-4:]
    assert [re.split(r"[:;] ", line)[:2] for line in verdicts[1:3]] == [["gone.xml", "refused"], ["bad.xml", "refused"]]
    assert verdicts[0] == verdicts[3]
    assert verdicts[0].startswith("good.xml: ")
    assert said.stdout.count("1  The loops") == 2
    assert [line.startswith("oarlock: ") for line in said.stderr.splitlines()] == [True, True]


@pytest.mark.parametrize(("names", "status"), [(["good"], 0), (["good", "welded"], 1), (["welded", "gone", "good"], 2)])
def test_the_status_is_the_worst(oarlock_here, names, status):
    Path("good.xml").write_text(four_bar())
    Path("welded.xml").write_bytes(WELDED.read_bytes())
    said = oarlock_here("check", "--lint", *(f"{name}.xml" for name in names), "--json", "-")
    assert said.returncode == status
    document = json.loads(said.stdout)
    documents = document if len(names) > 1 else [document]
    assert [one["file"] for one in documents] == [f"{name}.xml" for name in names]
    assert [one["file"] for one in documents if "refused" in one] == [f"{name}.xml" for name in names if name == "gone"]


def test_one_refused_file_leaves_standard_output_empty(oarlock_here):
    said = oarlock_here("check", "gone.xml", "--json", "-", "--sarif", "out.sarif")
    assert (said.returncode, said.stdout, said.stderr) == (2, "", "oarlock: no model file 'gone.xml'\n")
    (run,) = json.loads(Path("out.sarif").read_text(encoding="utf-8"))["runs"]
    assert run["invocations"][0]["executionSuccessful"] is False


def test_several_reports_have_a_folder_each(oarlock_here):
    for folder in ("a", "b"):
        Path(folder).mkdir()
        Path(folder, "arm.xml").write_text(four_bar())
    said = oarlock_here("check", "a/arm.xml", "b/arm.xml", *QUICK, "--report", "pages")
    assert said.returncode == 0, said.stderr
    assert sorted(path.name for path in Path("pages").iterdir()) == ["arm", "arm-2"]
    assert all((path / "README.md").is_file() for path in Path("pages").iterdir())


@pytest.mark.parametrize("flag", ["--fix", "--write-tuned", "--write-keyframe"])
def test_a_copy_is_of_one_file(oarlock_here, flag):
    said = oarlock_here("check", "a.xml", "b.xml", flag, "out.xml")
    assert (said.returncode, said.stderr) == (2, f"oarlock: {flag} with 2 files, expected one file to copy\n")


# SARIF.


def sarif_of(oarlock_here, *files, lint=True):
    said = oarlock_here("check", *(["--lint"] if lint else QUICK), *files, "--sarif", "out.sarif")
    assert said.returncode in (0, 1), said.stderr
    return json.loads(Path("out.sarif").read_text(encoding="utf-8"))


def test_sarif_has_what_its_schema_requires(oarlock_here):
    document = sarif_of(oarlock_here, WELDED, RING)
    assert document["version"] == "2.1.0"
    assert document["$schema"].endswith("sarif-schema-2.1.0.json")
    (run,) = document["runs"]
    driver = run["tool"]["driver"]
    assert driver["name"] == "oarlock"
    assert re.fullmatch(r"\d+\.\d+\.\d+", driver["version"])
    assert len({rule["id"] for rule in driver["rules"]}) == len(driver["rules"]) > 0
    levels = {"error", "warning", "note"}
    for rule in driver["rules"]:
        assert rule["shortDescription"]["text"] == catalogue()[rule["id"]].title
        assert rule["defaultConfiguration"]["level"] in levels
    assert {"L9", "L10"} <= {result["ruleId"] for result in run["results"]}
    for result in run["results"]:
        assert driver["rules"][result["ruleIndex"]]["id"] == result["ruleId"]
        assert result["level"] in levels
        assert result["message"]["text"]
        (location,) = result["locations"]
        assert location["physicalLocation"]["artifactLocation"]["uri"]
        assert location["physicalLocation"].get("region", {"startLine": 1})["startLine"] >= 1
    (invocation,) = run["invocations"]
    assert invocation == {"executionSuccessful": True, "toolExecutionNotifications": []}


def lines_of(document):
    """Rule and element of every result → file and line, or None."""
    found = {}
    for result in document["runs"][0]["results"]:
        (location,) = result["locations"]
        element = location.get("logicalLocations", [{"name": ""}])[0]["name"]
        physical = location["physicalLocation"]
        found[result["ruleId"], element] = (
            physical["artifactLocation"]["uri"],
            physical.get("region", {}).get("startLine"),
        )
    return found


def line_with(path, text):
    lines = Path(path).read_text(encoding="utf-8").splitlines()
    (found,) = [number for number, line in enumerate(lines, 1) if text in line]
    return found


def test_a_finding_is_at_the_line_of_its_equality(oarlock_here):
    Path("sub dir").mkdir()
    Path("sub dir/welded.xml").write_bytes(WELDED.read_bytes())
    found = lines_of(sarif_of(oarlock_here, "sub dir/welded.xml"))
    assert found["L10", "knee"] == ("sub%20dir/welded.xml", line_with(WELDED, "<weld"))


def test_an_equality_of_an_included_file_is_found_there(oarlock_here):
    text = WELDED.read_text(encoding="utf-8")
    begin, end = text.index("<equality>"), text.index("</equality>") + len("</equality>")
    Path("main.xml").write_text(text[:begin] + '<include file="loops.xml"/>' + text[end:], encoding="utf-8")
    Path("loops.xml").write_text(f"<mujoco>\n\n{text[begin:end]}\n</mujoco>", encoding="utf-8")
    found = lines_of(sarif_of(oarlock_here, "main.xml"))
    assert found["L10", "knee"] == ("loops.xml", line_with("loops.xml", "<weld"))


def test_what_has_no_name_is_found_by_its_bodies(oarlock_here):
    text = WELDED.read_text(encoding="utf-8").replace('name="knee" ', "")
    assert text != WELDED.read_text(encoding="utf-8")
    Path("welded.xml").write_text(text, encoding="utf-8")
    found = lines_of(sarif_of(oarlock_here, "welded.xml"))
    (place,) = {place for (rule, _), place in found.items() if rule == "L10"}
    assert place == ("welded.xml", line_with("welded.xml", "<weld"))


def test_a_model_that_a_script_builds_has_its_file_alone(oarlock_here):
    document = sarif_of(oarlock_here, "n_four_bar", lint=False)
    places = lines_of(document)
    assert places
    assert all(uri.endswith("model.py") and line is None for uri, line in places.values())


# JUnit.


def test_junit_fails_where_a_finding_is_an_error(oarlock_here):
    Path("good.xml").write_text(four_bar())
    oarlock_here("check", "--lint", "good.xml", WELDED, "gone.xml", "--junit", "out.xml", "--json", "all.json")
    root = ElementTree.parse("out.xml").getroot()
    documents = json.loads(Path("all.json").read_text(encoding="utf-8"))
    assert [suite.get("name") for suite in root] == ["good.xml", str(WELDED), "gone.xml"]
    for suite, document in zip(root, documents, strict=True):
        errors = [one for one in document.get("findings", []) if one["severity"] == "error"]
        assert suite.get("failures") == str(len(errors))
        assert suite.get("tests") == str(1 + len(document.get("findings", [])))
        assert suite.get("errors") == str(int("refused" in document))
    assert (root.get("failures"), root.get("errors")) == ("1", "1")


# Documents on standard output.


@pytest.mark.parametrize("flag", ["--json", "--sarif", "--junit"])
def test_a_dash_is_standard_output(oarlock_here, flag):
    """It has the document alone, the same as in a file; no file is called so."""
    said = oarlock_here("check", "--lint", WELDED, RING, flag, "-")
    assert said.returncode == 1
    oarlock_here("check", "--lint", WELDED, RING, flag, "out")
    at = r"\d{4}-\d\d-\d\dT[^\"]*"  # when it was made
    in_file = Path("out").read_text(encoding="utf-8")
    assert re.sub(at, "", said.stdout) == re.sub(at, "", in_file)
    parsed = ElementTree.fromstring(said.stdout.encode()) if flag == "--junit" else json.loads(said.stdout)
    assert len(parsed) > 0
    assert not Path("-").exists()


def test_two_documents_do_not_share_it(oarlock_here):
    said = oarlock_here("check", "--lint", WELDED, "--sarif", "-", "--junit", "-")
    assert (said.returncode, said.stdout) == (2, "")
    assert said.stderr == "oarlock: --sarif - and --junit -, expected one document on standard output\n"


# The action.


def action():
    return yaml.safe_load((REPOSITORY / "action.yml").read_text(encoding="utf-8"))


def test_the_action_calls_the_command_as_it_is():
    steps = action()["runs"]["steps"]
    (script,) = [step["run"] for step in steps if "oarlock check" in step.get("run", "")]
    (line,) = [line for line in script.splitlines() if line.startswith("oarlock check")]
    words = shlex.split(line.replace('"${arguments[@]}"', "--lint").replace('"${files[@]}"', "a.xml b.xml"))
    parsed = get_command(app).commands["check"].make_context("check", words[2:])
    assert parsed.params["files"] == ["a.xml", "b.xml"]
    assert str(parsed.params["sarif"]) == "$SARIF"
    assert "${{" not in script  # an input in a script is a command that somebody else writes


@pytest.mark.parametrize(
    ("files", "arguments", "status"),
    [("**/*.xml", "--lint", 1), ("good.xml", "--lint --keyframe none", 0), ("gone.xml", "", 2), ("*.mjcf", "", 2)],
)
def test_the_script_of_the_action_runs(tmp_path, files, arguments, status):
    (tmp_path / "sub").mkdir()
    (tmp_path / "good.xml").write_text(four_bar())
    (tmp_path / "sub" / "welded.xml").write_bytes(WELDED.read_bytes())
    (script,) = [step["run"] for step in action()["runs"]["steps"] if "oarlock check" in step.get("run", "")]
    path = os.pathsep.join([str(COMMAND.parent), os.environ["PATH"]])
    given = {"FILES": files, "ARGUMENTS": arguments, "SARIF": "out.sarif", "PATH": path}
    shell = ["bash", "--noprofile", "--norc", "-e", "-o", "pipefail", "-c", script]
    finished = subprocess.run(
        shell, cwd=tmp_path, env={**os.environ, **given}, capture_output=True, encoding="utf-8", check=False
    )
    assert finished.returncode == status, finished.stderr
    # A file that is not there is named in it, too.
    assert (tmp_path / "out.sarif").is_file() == ("*.mjcf" not in files)


def test_the_example_gives_the_inputs_that_the_action_has():
    text = (REPOSITORY / "docs" / "command.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    example = yaml.safe_load(block)
    (step,) = [step for step in example["jobs"]["check"]["steps"] if "oarlock" in step["uses"]]
    inputs = action()["inputs"]
    assert set(step["with"]) <= set(inputs)
    assert {name for name, one in inputs.items() if one.get("required")} <= set(step["with"])
    assert example["permissions"]["security-events"] == "write"
