"""The documents for contributors say what is there: rooms, decisions, links, commands, versions."""

import re
import tomllib
from pathlib import Path

import oarlock
import pytest
from oarlock.cli.app import app
from places import REPOSITORY
from typer.main import get_command

PACKAGE = REPOSITORY / "harness" / "oarlock"
DECISIONS = REPOSITORY / "docs" / "decisions"
DOCUMENTS = [
    *(REPOSITORY / name for name in ("README.md", "CONTRIBUTING.md", "ARCHITECTURE.md", "CHANGELOG.md", "SECURITY.md")),
    *sorted(DECISIONS.glob("*.md")),
]
"""Documents whose links lead to files of the repository; those of the site are held by tests/docs."""


def text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def prose(path: Path) -> str:
    return re.sub(r"^```.*?^```", "", text(path), flags=re.MULTILINE | re.DOTALL)


def project() -> dict:
    return tomllib.loads(text(REPOSITORY / "pyproject.toml"))


# ARCHITECTURE.md.


def folders() -> set[Path]:
    """Every folder that has to be on the map: rooms of the package, crates, rooms of the core, and what git tracks."""
    rooms = {path.parent for path in PACKAGE.glob("**/__init__.py")} - {PACKAGE}
    crates = {path.parent for path in REPOSITORY.glob("rust/*/Cargo.toml")}
    core = {path.with_suffix("") for path in (REPOSITORY / "rust" / "core" / "src").glob("*.rs")}
    top = {
        REPOSITORY / name
        for name in ("harness/oarlock", "mjcf", "tests", "reports", "docs", "examples", "paper", ".ci")
    }
    return rooms | crates | {path for path in core if path.is_dir()} | top


def named_paths() -> set[Path]:
    """What the page names in backquotes with a slash, from the repository or from the package."""
    named = re.findall(r"`([\w.\-]+/[\w./\-]*)`", prose(REPOSITORY / "ARCHITECTURE.md"))
    assert len(named) > 30
    return {PACKAGE / name if (PACKAGE / name.split("/")[0]).is_dir() else REPOSITORY / name for name in named}


def test_the_map_has_every_room_and_no_other():
    assert len(folders()) > 25
    assert folders() - named_paths() == set()
    assert {path for path in named_paths() if not path.exists()} == set()


def test_the_floors_on_the_map_are_those_of_the_contracts():
    blocks = re.findall(r"^```text\n(.*?)^```", text(REPOSITORY / "ARCHITECTURE.md"), re.MULTILINE | re.DOTALL)
    drawn = [block.splitlines() for block in blocks]
    contracts = project()["tool"]["importlinter"]["contracts"]
    floors = [contract["layers"] for contract in contracts if contract["type"] == "layers"]
    assert len(floors) == 2
    assert [layers for layers in floors if layers not in drawn] == []


# Decisions.


def decisions() -> list[Path]:
    return sorted(DECISIONS.glob("[0-9]*.md"))


def test_every_decision_is_in_the_index():
    rows = re.findall(
        r"^\| \[(\d{3})\]\((.+?)\) \| (.+?) \| (\d{4}-\d\d-\d\d) \| (.+) \|$",
        text(DECISIONS / "README.md"),
        re.MULTILINE,
    )
    listed = [(name, f"# {number}. {title}", f"- Date: {date}") for number, name, title, date, _ in rows]
    written = [(path.name, *text(path).splitlines()[:3:2]) for path in decisions()]
    assert len(written) >= 46
    assert listed == written


def test_decisions_are_numbered_in_the_order_of_their_dates():
    assert [int(path.name[:3]) for path in decisions()] == list(range(1, len(decisions()) + 1))
    dates = [re.search(r"^- Date: (.+)$", text(path), re.MULTILINE) for path in decisions()]
    assert None not in dates
    assert [date[1] for date in dates if date] == sorted(date[1] for date in dates if date)


@pytest.mark.parametrize("path", decisions(), ids=lambda path: path.stem)
def test_a_decision_is_whole(path):
    parts = re.split(r"^## (.+)\n", text(path), flags=re.MULTILINE)
    assert re.search(r"^- Status: (Accepted|Replaced by \[\d{3}\])", parts[0], re.MULTILINE)
    assert parts[1::2] == ["Context", "Decision", "Consequences"]
    assert [heading for heading, part in zip(parts[1::2], parts[2::2], strict=True) if not part.strip()] == []


# Links and commands.


def anchors(path: Path) -> set[str]:
    """The anchors that GitHub gives to the headings of a page."""
    headings = re.findall(r"^#+ (.+)$", prose(path), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.relative_to(REPOSITORY).as_posix())
def test_links_lead_somewhere(path):
    for link in re.findall(r"\]\(([^)\s]+)\)", prose(path)):
        if ":" not in link:
            name, _, anchor = link.partition("#")
            target = path.parent / name if name else path
            assert target.exists(), link
            assert not anchor or anchor in anchors(target), link


def code(path: Path) -> str:
    """Fenced and indented blocks, and what stands in backquotes."""
    lines = [line for line in text(path).splitlines() if line.startswith("    ")]
    fenced = re.findall(r"^```\w+\n(.*?)^```", text(path), re.MULTILINE | re.DOTALL)
    return "\n".join([*lines, *fenced, *re.findall(r"`([^`\n]+)`", prose(path))])


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md"])
def test_commands_exist(name):
    targets = set(re.findall(r"^([\w-]+):", text(REPOSITORY / "Makefile"), re.MULTILINE))
    asked = set(re.findall(r"^\s*make ([a-z-]+)", code(REPOSITORY / name), re.MULTILINE))
    assert len(asked) >= 2
    assert asked - targets == set()
    commands = set(get_command(app).commands)  # type: ignore[attr-defined]
    asked = set(re.findall(r"^\s*(?:\.venv/bin/)?oarlock ([a-z-]+)", code(REPOSITORY / name), re.MULTILINE))
    assert len(asked) >= 4
    assert asked - commands == set()


def test_paths_of_the_guide_exist():
    named = re.findall(r"`([\w.\-]+/[\w./\-]*)`", text(REPOSITORY / "CONTRIBUTING.md"))
    tested = re.findall(r"pytest ([\w/.]+)", text(REPOSITORY / "CONTRIBUTING.md"))
    assert len(named) > 10
    assert len(tested) >= 3
    assert [path for path in [*named, *tested] if not (REPOSITORY / path.replace("NAME", "boat")).exists()] == []


# Versions.


def test_one_version_everywhere():
    version = oarlock.__version__
    assert project()["project"]["version"] == version
    assert tomllib.loads(text(REPOSITORY / "Cargo.toml"))["workspace"]["package"]["version"] == version
    assert f"\nversion: {version}\n" in text(REPOSITORY / "CITATION.cff")
    assert re.search(rf"^## {re.escape(version)}\b", text(REPOSITORY / "CHANGELOG.md"), re.MULTILINE)
