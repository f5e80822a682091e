"""Names that would paint a terminal, inject keys or lead elsewhere: in every output they are text."""

import re
import tomllib

import pytest
from markdown_it import MarkdownIt
from mechanisms import four_bar, write_model
from suites import TINY

PAINT = "\x1b[2K\x1b[1AALL GATES HOLD\x9b31m\u202e\u200b"
MARKUP = "](x)<img src=x onerror=alert(1)>`|![p](https://evil.example/p.png)<script>"
KEYS = '"\n[drive.ctrl]\nmotor = "9" # '
NAME = f"{PAINT}{MARKUP}{KEYS}"
RAW = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u202a-\u202e\u2066-\u2069]")


def attribute(text):
    """Text as an attribute of XML, which cannot hold all control characters: escape has to be smuggled in by name."""
    escaped = text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    return "".join(c if c.isprintable() else f"&#{ord(c)};" for c in escaped)


@pytest.fixture
def hostile(tmp_path):
    """A four-bar whose equality and joints have the name."""
    text = four_bar()
    text = re.sub(
        r"<connect ", f'<connect name="{attribute(NAME)}" ', re.sub(r'(<connect[^>]*) name="[^"]*"', r"\1", text)
    )
    return write_model(tmp_path / "hostile", text, TINY)


def harmless(*texts):
    for text in texts:
        assert not RAW.search(text), ascii(RAW.search(text))


def test_terminal_and_pages(hostile, tmp_path, oarlock_here):
    # A copy is proper XML, which cannot hold every control character.
    proper = tmp_path / "proper.xml"
    proper.write_text(hostile.read_text(encoding="utf-8").replace("&#27;", ""), encoding="utf-8")
    commands = [
        ("run", hostile.parent, "--out", "kept", "--report", "page", "--json", "-"),
        ("run", hostile.parent, "--out", "kept"),
        ("check", hostile, "--duration", "0.05", "--budget", "0", "--report", "checked"),
        ("view", hostile, "--duration", "0.05", "--out", "viewed/index.html"),
        ("suite", hostile.parent, "--out", "out", "--jobs", "1"),
        ("diff", "kept", "kept", "--report", "compared"),
        ("report", "kept", "--to", "again"),
        ("new", "fresh", proper, "--to", "."),
    ]
    for arguments in commands:
        finished = oarlock_here(*arguments)
        assert finished.returncode in (0, 1), finished.stderr
        assert "Traceback" not in finished.stderr
        harmless(finished.stdout, finished.stderr)
    pages = [path for path in tmp_path.rglob("*") if path.suffix in (".md", ".svg", ".toml") and path.parts]
    assert len(pages) > 8
    for path in pages:
        text = path.read_text(encoding="utf-8")
        harmless(text)
        if path.suffix == ".md":
            rendered = MarkdownIt("gfm-like", {"html": True, "linkify": False}).render(text)
            assert "<script" not in rendered
            assert "evil.example/p.png" not in "".join(re.findall("<[^>]*>", rendered))
            assert "<img src=x" not in rendered
        assert "<script" not in text or path.suffix != ".svg"
    for path in tmp_path.rglob("index.html"):
        text = path.read_text(encoding="utf-8")
        assert "\x1b[2K" not in text
        assert "<img" not in text.partition("<script>")[0]
    case = tomllib.loads((tmp_path / "fresh" / "case.toml").read_text(encoding="utf-8"))
    assert "drive" not in case


def test_a_drawing_that_fails_costs_its_figure(hostile, tmp_path, monkeypatch):
    from oarlock import run
    from oarlock.render import page
    from oarlock.report.case_report import write_report

    run(hostile.parent, out=tmp_path / "kept")
    draw, calls = page.vl_convert.vegalite_to_svg, []

    def fragile(spec):
        calls.append(spec)
        if len(calls) == 2:
            raise ValueError("no room for the legend")
        return draw(spec)

    monkeypatch.setattr(page.vl_convert, "vegalite_to_svg", fragile)
    with pytest.warns(UserWarning, match="figure 'coordinates' is not drawn: no room for the legend"):
        report = write_report(tmp_path / "kept", tmp_path / "report")
    text = (report / "README.md").read_text(encoding="utf-8")
    assert "figures/mechanism.svg" in text
    assert "figures/coordinates.svg" not in text
    assert not (report / "figures" / "coordinates.svg").exists()
