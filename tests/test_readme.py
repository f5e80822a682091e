"""The front page says what the published report says."""

import re

from places import REPOSITORY as ROOT


def test_the_figures_of_the_front_page_are_those_of_the_report():
    front = (ROOT / "README.md").read_text(encoding="utf-8").partition("\n## ")[0]
    report = (ROOT / "reports" / "boat" / "README.md").read_text(encoding="utf-8")
    figures = re.findall(r"\d\.\d\de-\d\d|\b1\.\d{3}\b", front)
    assert len(figures) >= 8
    assert [figure for figure in figures if figure not in report] == []


def test_a_row_of_the_front_page_is_a_run_of_the_report():
    front = (ROOT / "README.md").read_text(encoding="utf-8").partition("\n## ")[0]
    report = (ROOT / "reports" / "boat" / "README.md").read_text(encoding="utf-8")
    runs = [{cell.strip() for cell in line.split("|")} for line in report.splitlines() if line.startswith("| free-")]
    rows = re.findall(r"^\| .+ \| (\S+) m \| (\S+) rad \|$", front, re.MULTILINE)
    assert len(rows) == 4
    assert [row for row in rows if not any(set(row) <= run for run in runs)] == []


def test_links_of_the_front_page_lead_somewhere():
    front = (ROOT / "README.md").read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#:]+)\)", front)
    assert len(links) >= 3
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_the_two_commands_are_there():
    front = (ROOT / "README.md").read_text(encoding="utf-8")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in ("run", "test"):
        assert f"make {target}" in front
        assert re.search(rf"^{target}:", makefile, re.MULTILINE)
