"""The terminal: the chapters of the page, with the same figures as the page and the document, and nothing of charts."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from oarlock.base.numbers import figure
from oarlock.cli.blocks import print_chapter
from oarlock.diagnosis.page.blocks import Chapter, Code, Stage, Table
from oarlock.diagnosis.page.chapters.findings import findings
from oarlock.diagnosis.verdict.findings import found as finding
from places import FIXTURES

GRIPPER = FIXTURES / "check" / "gripper_2f" / "gripper_2f.xml"


def test_terminal_page_and_document_show_the_same_figures(oarlock_here):
    said = oarlock_here(
        "check", GRIPPER, "--budget", "0", "--duration", "0.5", "--report", "page", "--json", "out.json"
    )
    assert said.returncode == 0, said.stderr
    document = json.loads(Path("out.json").read_text(encoding="utf-8"))
    markdown = (Path("page") / "README.md").read_text(encoding="utf-8").replace("\\", "")
    printed = [re.split(r"\s{2,}", line) for line in said.stdout.splitlines()]
    written = [[cell.strip() for cell in line.split("|")[1:-1]] for line in markdown.splitlines() if line[:1] == "|"]

    drifts = [one for one in document["drift"] if one["level"] == "position"]
    assert len(drifts) == 3
    for one in drifts:
        name = one["equality"]
        after = printed[next(at for at, line in enumerate(printed) if line[:2] == ["equality", "m"]) :]
        (line,) = [line for line in after[:4] if line[0] == name]
        (row,) = [row for row in written if row[:2] == [name, "position"]]
        assert line[1:3] == [figure(one["metres"]), figure(one["radians"])]
        largest = one["metres"] if one["radians"] is None else one["radians"]
        unit, column = ("m", 2) if one["radians"] is None else ("rad", 3)
        number, said_unit = row[column].split()
        assert (number, said_unit) == (figure(largest), unit)
        assert float(number) == pytest.approx(largest, rel=5e-3)
        assert line[3] == row[6]

    for one in document["why"]["equalities"]:
        (line,) = [line for line in printed if line[0] == one["name"] and line[-2:-1] and "%" in line[-2]]
        (row,) = [row for row in written if row[:1] == [one["label"]] and "%" in row[-1]]
        assert line[1].split()[0] == row[1].split()[0] == figure(one["worst"])
        shares = [f"{round(100 * share)} %" for share in one["shares"].values()]
        assert line[3:8] == shares
        assert [cell.partition("(")[2].rstrip(")") for cell in row[4:]] == shares

    lines = said.stdout.splitlines()
    first = {one["code"]: one for one in reversed(document["findings"])}
    assert first
    assert [code for code, one in first.items() if not any(f" {code} " in x and one["line"] in x for x in lines)] == []
    assert [one["line"] for one in document["findings"] if one["line"] not in markdown] == []


def test_sentences_of_the_terminal_are_those_of_the_page(oarlock_here):
    said = oarlock_here("check", "four_bar", "--budget", "0", "--duration", "0.1", "--report", "page")
    page = (Path("page") / "README.md").read_text(encoding="utf-8").replace("\\", "")
    sentences = [line for line in said.stdout.splitlines() if line.endswith(".") and not line.startswith(" ")]
    assert len(sentences) >= 7
    assert [line for line in sentences if line not in page] == []


def test_explanations_and_figures_are_left_out(capsys):
    chapter = Chapter("x", "A chapter", 7)
    chapter.say("a sentence")
    chapter.explain("an explanation")
    chapter.table("t", ("name", "value"), [("whole", "1")])
    chapter.table("t", ("name", "value"), [("whole", "1")], short=Table("t", ("name", "n"), [("a", "1"), ("b", "22")]))
    chapter.blocks += [Stage("a caption"), Code("<one/>\n<two/>")]
    print_chapter(chapter)
    assert capsys.readouterr().out.splitlines() == [
        "7  A chapter",
        "a sentence",
        "name   n",
        "a      1",
        "b     22",
        "    <one/>",
        "    <two/>",
    ]


def test_findings_of_one_code_share_a_line(capsys):
    names = "abcdefghi"
    every = [finding("D1", "m.xml", f"line {name}", element=name, severity="note") for name in names]
    print_chapter(findings([*every, finding("T2", "m.xml", "whole", severity="error")]))
    assert capsys.readouterr().out.splitlines() == [
        "Findings",
        "1 error, 9 notes.",
        "error   T2 unstable  whole",
        "note    D1 compliance  a: line a",
        "           and 8 more: b, c, d, e, f, g and 2 more (--report and --json have each)",
        "oarlock explain T2 says what that means, how it is measured, and what to do",
    ]


def test_a_terminal_needs_no_charts():
    """They take longer to import than a small model to examine."""
    script = (
        "import sys; from oarlock.cli import blocks; from oarlock.diagnosis.page.chapters import contents, findings; "
        "print([name for name in ('altair', 'vl_convert', 'jinja2', 'markdown_it') if name in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True).stdout
    assert out.strip() == "[]"
