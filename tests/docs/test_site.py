"""The pages as they are built: strict and offline, with links that lead somewhere, and fit for a phone."""

import html.parser
import os
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

import oarlock
import pytest
from oarlock.base import core
from oarlock.cases.case_file import CaseFile
from oarlock.cli.app import COMMANDS
from oarlock.diagnosis.verdict.findings import catalogue
from oarlock.tables.figures import COLUMNS, FIGURES
from places import REPOSITORY

SECONDS = 240
"""A build takes ten; beside other tests on a busy machine far more."""

PHONE = 390
"""Pixels across."""


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The pages, built as ``make site`` does."""
    folder = tmp_path_factory.mktemp("site") / "pages"
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(
        command, cwd=REPOSITORY, env=environment, capture_output=True, encoding="utf-8", timeout=SECONDS, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


class _Page(html.parser.HTMLParser):
    """Anchors of a page, its links, and what it loads."""

    def __init__(self, path: Path):
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        self.anchors |= {found[name] for name in ("id", "name") if name in found}
        if tag == "a" and "href" in found:
            self.links.append(found["href"])
        elif tag == "link" and found.get("rel") != "canonical":
            self.loads.append(found.get("href", ""))
        elif tag in ("script", "img", "iframe", "source") and found.get("src"):
            self.loads.append(found["src"])


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, _Page]:
    return {path: _Page(path) for path in sorted(site.glob("**/*.html"))}


def test_links_lead_somewhere(site, pages):
    assert len(pages) > 70
    lost = []
    for path, page in pages.items():
        if path.name == "404.html":
            continue  # its links begin at the root of a server
        for link in [*page.links, *page.loads]:
            parts = urlsplit(link)
            if parts.scheme in ("http", "https", "data", "mailto"):
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            if not target.is_file():
                lost.append(f"{path.relative_to(site)}: {link}")
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
                lost.append(f"{path.relative_to(site)}: {link}: no such anchor")
    assert lost == []


def test_nothing_comes_from_the_net(site, pages):
    loads = [load for page in pages.values() for load in page.loads]
    assert len(loads) > 100
    assert [load for load in loads if load.startswith(("http:", "https:", "//"))] == []
    styles = [path.read_text(encoding="utf-8") for path in site.glob("**/*.css")]
    assert len(styles) >= 2
    assert [style for style in styles if re.search(r"(?:@import|url\()\s*[\"']?(?:https?:)?//", style)] == []


def test_no_path_of_this_machine(site):
    texts = [path.read_text(encoding="utf-8") for path in site.glob("**/*") if path.suffix in (".html", ".json", ".js")]
    assert [text for text in texts if str(REPOSITORY) in text or str(Path.home()) + "/" in text] == []


def _text(site: Path, place: str) -> str:
    return (site / "reference" / place).read_text(encoding="utf-8")


def test_the_reference_has_all_of_it(site, pages):
    commands = pages[site / "reference" / "commands.html"].anchors
    assert set(COMMANDS) <= commands
    codes = {code.lower() for code in catalogue()}
    assert len(codes) > 40
    assert codes <= pages[site / "reference" / "findings.html"].anchors
    names = {f"oarlock.{name}" for name in oarlock.__all__ if not name.startswith("__")}
    assert len(names) > 20
    assert names <= pages[site / "reference" / "python.html"].anchors
    columns = _text(site, "columns.html")
    assert [one.name for one in (*COLUMNS, *FIGURES) if f"<code>{one.name}</code>" not in columns] == []
    solvers = _text(site, "solvers.html")
    own = [name for name, (_, options) in core.solvers().items() if options]  # other tests register some without
    assert len(own) >= 15
    assert [name for name in own if f"<code>{name}</code>" not in solvers] == []
    case = _text(site, "case.html")
    assert [name for name in CaseFile.model_fields if f"<code>{name}</code>" not in case] == []


def test_formulas_are_set(site):
    theory = (site / "theory.html").read_text(encoding="utf-8")
    assert theory.count("<math ") > 40
    assert "arithmatex" not in theory
    assert re.findall(r"\\(?:lambda|mathsf|dot|frac)", theory) == []


def test_figures_of_the_front_page_are_those_of_the_report(site):
    front = (site / "index.html").read_text(encoding="utf-8")
    report = (REPOSITORY / "reports" / "boat" / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"<td>(\S+) m</td>\s*<td>(\S+) rad</td>", front)
    assert len(rows) == 4
    runs = [{cell.strip() for cell in line.split("|")} for line in report.splitlines() if line.startswith("| free-")]
    assert [row for row in rows if not any(set(row) <= run for run in runs)] == []


# A real browser.


@pytest.mark.parametrize(
    "place", ["index.html", "tutorials/gripper.html", "theory.html", "reference/case.html", "reference/python.html"]
)
def test_a_page_fits_a_phone(place, site, browser):
    browser.open(site / place, width=PHONE, height=800)
    assert browser.said == []
    assert [url for url in browser.asked if not url.startswith(("file:", "data:"))] == []
    assert browser.ask("document.querySelector('meta[name=viewport]').content") == "width=device-width,initial-scale=1"
    assert browser.ask("document.documentElement.scrollWidth") <= PHONE
    # What is wider scrolls by itself.
    wide = """[...document.querySelectorAll('article table, article pre > code, article .formula')].filter(one => {
        for (let up = one; up.tagName !== 'ARTICLE'; up = up.parentElement)
            if (['auto', 'scroll'].includes(getComputedStyle(up).overflowX)) return false;
        return one.getBoundingClientRect().right > innerWidth;
    }).length"""
    assert browser.ask(wide) == 0


def test_the_search_finds_a_finding_without_a_server(site, browser):
    browser.open(site / "index.html", width=1280)
    browser.ask("document.querySelector('[data-md-component=search-query]').focus()")
    browser.ask(
        """(query => {
            query.value = 'curvature-missing';
            query.dispatchEvent(new Event('keyup', {bubbles: true}));
        })(document.querySelector('[data-md-component=search-query]'))"""
    )
    browser.wait("document.querySelectorAll('.md-search-result__item').length > 0")
    assert "curvature-missing" in browser.ask("document.querySelector('.md-search-result__list').textContent")
