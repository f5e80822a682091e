"""oarlock diff: how it is said, on the terminal, in JSON, JUnit and a notebook."""

import json
import re
from xml.etree import ElementTree

import oarlock
import polars as pl
import pytest
from oarlock.compare.figures import worded
from oarlock.compare.junit import junit
from pairs import edit, exact, set_figure


def test_exit_status_and_streams(pair, oarlock_here):
    finished = oarlock_here("diff", *pair)
    assert (finished.returncode, finished.stderr) == (0, "")
    assert finished.stdout.splitlines()[-1].startswith("3 runs compared: ")
    set_figure(pair[1], drift_pos_max=1.0)
    finished = oarlock_here("diff", *pair)
    assert finished.returncode == 1
    (line,) = finished.stderr.splitlines()
    assert line.startswith("oarlock: 1 got worse; the first: tiny free-hard-pinv-rk4: drift_pos_max: ")
    assert "worse  tiny" in finished.stdout
    assert oarlock_here("diff", *pair[::-1]).returncode == 0


def test_json(pair, oarlock_here, tmp_path):
    set_figure(pair[1], drift_pos_max=1.0)
    finished = oarlock_here("diff", *pair, "--json", "-")
    document = json.loads(finished.stdout)
    assert (finished.returncode, document["worse"], document["matched"]) == (1, 1, 3)
    assert [change["figure"] for change in document["changes"]] == ["drift_pos_max"]
    assert document["counts"]["worse"] == 1
    assert len(document["not_judged"]) > 0
    oarlock_here("diff", *pair, "--json", tmp_path / "d.json")
    assert json.loads((tmp_path / "d.json").read_text()) == document


def test_limit(pair, oarlock_here):
    figures = ("drift_pos_max", "drift_vel_max", "drift_acc_max")
    set_figure(pair[1], **dict.fromkeys(figures, 1e9))
    said = oarlock_here("diff", *pair, "--limit", "2").stdout
    assert said.count("worse  ") == 2
    assert "and 1 more changes" in said
    assert oarlock_here("diff", *pair, "--limit", "0").stdout.count("worse  ") == 3


HOSTILE = "<script>alert(1)</script>&\"'[bold]x[/bold]\x1b[31m\x00\ud7ff"


@pytest.fixture
def hostile(pair):
    def rename(document):
        document["provenance"]["case"] = HOSTILE
        for row in document["runs"]:
            row.update(case=HOSTILE, message=HOSTILE)

    for folder in pair:
        edit(folder, rename)
    set_figure(pair[1], drift_pos_max=1.0, status="diverged")
    return pair


def test_junit(hostile, oarlock_here, tmp_path):
    finished = oarlock_here("diff", *hostile, "--junit", tmp_path / "sub" / "d.xml")
    assert finished.returncode == 1
    root = ElementTree.parse(tmp_path / "sub" / "d.xml").getroot()
    assert root.tag == "testsuites"
    cases = root.findall("testsuite/testcase")
    failed = {case.get("name") for case in cases if case.find("failure") is not None}
    assert failed == {"free-hard-pinv-rk4: status", "free-hard-pinv-rk4: drift"}
    assert (int(root.attrib["tests"]), int(root.attrib["failures"])) == (len(cases), 2)
    assert len({case.get("name") for case in cases}) == len(cases)
    shown = HOSTILE.replace("\x1b", "\ufffd").replace("\x00", "\ufffd")
    assert {case.get("classname") for case in cases} == {shown}
    message = next(case for case in cases if case.get("name") == "free-hard-pinv-rk4: drift").find("failure")
    assert message is not None
    assert "drift_pos_max" in message.attrib["message"]
    assert "→ 1 " in (message.text or "")


def test_junit_on_standard_output(pair, oarlock_here):
    finished = oarlock_here("diff", *pair, "--junit", "-")
    assert (finished.returncode, finished.stderr) == (0, "")
    assert finished.stdout == junit(oarlock.diff(*pair))


def test_junit_skips_what_may_be_missing(pair):
    edit(pair[1], lambda document: document["runs"].remove(exact(document)))
    allowed = ElementTree.fromstring(junit(oarlock.diff(*pair, allow_missing=True)).encode())
    assert (allowed.get("failures"), allowed.get("skipped")) == ("0", "1")
    forbidden = ElementTree.fromstring(junit(oarlock.diff(*pair)).encode())
    assert (forbidden.get("failures"), forbidden.get("skipped")) == ("1", "0")


def test_names_stay_names_on_the_terminal(hostile, oarlock_here):
    said = oarlock_here("diff", *hostile).stdout
    assert "<script>alert(1)</script>&\"'[bold]x[/bold]" in said
    assert "\x1b" not in said
    assert "\x00" not in said


def test_a_notebook_shows_names_as_text(hostile):
    page = oarlock.diff(*hostile)._repr_html_()
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;&amp;&quot;&#x27;" in page
    assert "drift_pos_max" in page
    ElementTree.fromstring(page.replace("\x1b", "").replace("\x00", ""))  # every tag is closed


def test_frame(pair):
    set_figure(pair[1], drift_pos_max=1.0, status="diverged")
    found = oarlock.diff(*pair)
    frame = found.figures
    assert len(frame) == len(found.comparisons)
    worse = frame.filter(pl.col("verdict") == "worse")
    assert worse["figure"].to_list() == ["status", "drift_pos_max"]
    assert worse["was"].to_list() == ["done", worded(found.worse[1].before)]
    assert worse["after"].to_list() == [None, 1.0]


def test_help_names_the_options(oarlock_here):
    text = oarlock_here("diff", "--help").stdout
    assert {"json", "junit", "timings", "allow-missing", "limit"} <= set(re.findall(r"--([a-z-]+)", text))
