"""Files for hosts and hooks: well formed, and what they call is there."""

import json
import re
import shlex
import subprocess

import pytest
import yaml
from mechanisms import COMMAND
from places import FIXTURES, REPOSITORY

WORKFLOWS = sorted((REPOSITORY / ".github" / "workflows").glob("*.yml"))
FORMS = [path for path in sorted((REPOSITORY / ".github" / "ISSUE_TEMPLATE").glob("*.yml")) if path.stem != "config"]


def _loaded(path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def test_workflows_call_targets_that_exist():
    targets = set(re.findall(r"^([\w-]+):", (REPOSITORY / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    runs = [
        step["run"]
        for path in WORKFLOWS
        for job in _loaded(path)["jobs"].values()
        for step in job["steps"]
        if "run" in step
    ]
    asked = {target for run in runs for target in re.findall(r"\bmake ([\w-]+)", run)}
    assert len(WORKFLOWS) == 3
    assert {"wheel", "sdist", "site", "rustdoc", "lint"} <= asked
    assert asked - targets == set()
    files = {word for run in runs for word in shlex.split(run) if word.startswith(("tests/", ".ci/"))}
    assert len(files) >= 2
    assert [name for name in files if not (REPOSITORY / name).exists()] == []


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_may_do_no_more_than_it_needs(path):
    workflow = _loaded(path)
    assert workflow["permissions"]["contents"] == "read"
    assert [name for name, job in workflow["jobs"].items() if job["timeout-minutes"] > 90] == []


def test_forms_ask_for_what_is_needed():
    assert len(FORMS) == 2
    for path in FORMS:
        form = _loaded(path)
        assert form["name"]
        assert form["description"]
        assert [field for field in form["body"] if not field["attributes"]["label"]] == []


def test_the_hook_finds_a_mistake():
    (hook,) = _loaded(REPOSITORY / ".pre-commit-hooks.yaml")
    program, *arguments = shlex.split(hook["entry"])
    assert program == "oarlock"
    check = FIXTURES / "check"
    for name, status in (("gripper_2f/gripper_2f.xml", 0), ("welded_pin.xml", 1)):
        assert re.search(hook["files"], name)
        done = subprocess.run([COMMAND, *arguments, check / name], capture_output=True, encoding="utf-8", check=False)
        assert done.returncode == status, done.stdout + done.stderr


def test_hooks_of_our_own_are_local():
    (group,) = _loaded(REPOSITORY / ".pre-commit-config.yaml")["repos"]
    assert group["repo"] == "local"
    assert {hook["language"] for hook in group["hooks"]} == {"system"}


def test_the_paper_is_whole():
    text = (REPOSITORY / "paper" / "paper.md").read_text(encoding="utf-8")
    _, front, body = text.split("---\n", 2)
    meta = yaml.safe_load(front)
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} <= set(meta)
    entries = set(
        re.findall(r"^@\w+\{(\w+),", (REPOSITORY / "paper" / meta["bibliography"]).read_text("utf-8"), re.MULTILINE)
    )
    cited = set(re.findall(r"@(\w+)", body))
    assert len(cited) >= 6
    assert cited == entries
    assert len(body.split()) <= 1000
    for heading in ("# Summary", "# Statement of need", "# References"):
        assert f"\n{heading}\n" in body


def test_the_paper_says_what_the_reports_say():
    body = (REPOSITORY / "paper" / "paper.md").read_text(encoding="utf-8")
    summary = json.loads((REPOSITORY / "reports" / "summary.json").read_text(encoding="utf-8"))
    cases = {row["case"] for row in summary["runs"]}
    assert f"reports of {len(cases)} models and variants, with {len(summary['gates'])} gates" in body
    boat = (REPOSITORY / "reports" / "boat" / "README.md").read_text(encoding="utf-8")
    figures = re.findall(r"\b1\.\d{3}\b", body)
    assert len(figures) == 2
    assert [figure for figure in figures if figure not in boat] == []
