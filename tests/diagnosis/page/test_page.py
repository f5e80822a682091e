"""The page of an examination: what it says is what was found, names stay text, and a real browser draws it all."""

import dataclasses
import html.parser
import json
import re
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import pytest
from markdown_it import MarkdownIt
from oarlock import InputError
from oarlock.base.numbers import figure
from oarlock.base.text import one_line as plain
from oarlock.diagnosis.beginning import begin
from oarlock.diagnosis.examination import examine
from oarlock.diagnosis.loops.gaps import opening
from oarlock.diagnosis.loops.wrenches import Series, Wrench
from oarlock.diagnosis.options import CheckOptions
from oarlock.diagnosis.page import pictures
from oarlock.diagnosis.page.motion import SIDE, VISIBLE, Skeleton, motion
from oarlock.diagnosis.page.page import html_fragment, markdown_text, write_page
from oarlock.diagnosis.verdict.findings import found as finding
from places import FIXTURES

CHECKED = FIXTURES / "check"

HOSTILE = "<!--<script>alert(1)</script> | `x` _y_ http://x.y\n@z"

MEGABYTES = 5.0

TITLES = ["Findings", "The loops", "The start", "Drift", "Why", "What would hold it", "Forces"]


def examined(name, budget=2.0):
    """An examination, all of it."""
    exam = begin(name if "." not in name else str(CHECKED / name), CheckOptions(budget=budget))
    for _ in examine(exam):
        pass
    return exam


def findings_of(exam):
    """One of each severity, with a hostile place."""
    return [
        finding("D1", exam.file, "a note of 2 m", element=HOSTILE, severity="note"),
        finding("D3", exam.file, "a warning", severity="warning"),
        finding("T2", exam.file, "an error <b>of 3</b>", severity="error"),
    ]


@pytest.fixture(scope="module")
def four_bar():
    return examined("four_bar")


@pytest.fixture(scope="module")
def named():
    return examined("script_names.xml")


@pytest.fixture(scope="module")
def unreachable():
    return examined("unreachable.xml", 0.0)


@pytest.fixture(scope="module")
def pages(four_bar, named, unreachable, tmp_path_factory):
    """Name → folder of its report."""
    folder = tmp_path_factory.mktemp("pages")
    every = {"four_bar": four_bar, "named": named, "unreachable": unreachable}
    return {name: write_page(exam, findings_of(exam), folder / name) for name, exam in every.items()}


class Page(html.parser.HTMLParser):
    """Tags, texts by the tag that they stand in, and the cells of every table."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.texts, self.tables, self._open = [], {}, [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "link", "br", "input"):
            self._open.append(tag)
            self.texts.setdefault(tag, []).append("")
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        if self._open:
            self.texts[self._open[-1]][-1] += data
            if self._open[-1] in ("td", "th"):
                self.tables[-1][-1][-1] += data

    def table(self, *begin):
        """The rows of the table whose head begins so, as dictionaries."""
        (table,) = [table for table in self.tables if table[0][: len(begin)] == list(begin)]
        assert all(len(row) == len(table[0]) for row in table)
        return [dict(zip(table[0], row, strict=True)) for row in table[1:]]


def page_of(folder):
    return Page((folder / "index.html").read_text(encoding="utf-8"))


def scripts(page):
    """Charts and motion that the page hands to its scripts."""
    specs = next(text for text in page.texts["script"] if "const specs" in text)
    moving = next(text for text in page.texts["script"] if "const motion" in text)
    found = [re.search(rf"^const {name} = (.*);$", text, re.M) for name, text in (("specs", specs), ("motion", moving))]
    return tuple(json.loads(one[1]) for one in found if one)


# What it says.


def test_chapters_come_in_order_and_findings_first(pages):
    page = page_of(pages["four_bar"])
    assert [re.sub(r"^\d\. ", "", title) for title in page.texts["h2"]] == TITLES
    severities = [attrs["class"].split()[1] for tag, attrs in page.tags if tag == "details"]
    assert severities == ["error", "warning", "note"]
    text = (pages["four_bar"] / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (?:\d\. )?(.*)$", text, re.MULTILINE) == TITLES
    assert "1 error, 1 warning, 1 note." in text


def test_figures_are_those_of_the_examination(four_bar, pages):
    page = page_of(pages["four_bar"])
    (loop,) = page.table("equality", "type")
    assert (loop["rows"], loop["shape"], loop["zero rows"], loop["may be left out"]) == ("3", "planar", "y", "no")
    (group,) = page.table("group", "equalities")
    assert [group[name] for name in ("rows", "zero", "rank", "redundancy", "dof")] == ["3", "1", "2", "1", "1"]
    for row, one in zip(page.table("equality", "level"), four_bar.drifts, strict=True):
        unit = {"position": "m", "velocity": "m/s", "acceleration": "m/s²"}[one.level]
        assert row["MuJoCo"] == figure(one.metres, unit)
        assert row["exact"] == ("–" if one.exact_metres is None else figure(one.exact_metres, "m"))
    (share,) = four_bar.attribution.shares
    (row,) = page.table("row", "off by")
    assert row["off by"] == figure(share.worst, "m")
    assert row["time stepping"].startswith(figure(share.parts["stepping"]))
    (row,) = page.table("equality", "softness")
    assert row["work (J)"] == figure(share.work)
    trials = page.table("run", "start")
    assert len(trials) == len(four_bar.recipe.trials)
    assert [row["run"].endswith("(chosen)") for row in trials].count(True) == 1
    assert four_bar.recipe.mjcf in page.texts["pre"]
    (row,) = page.table("equality", "what")
    peak = np.linalg.norm(four_bar.determined[0].total.force, axis=1).max()
    assert row["exact"] == figure(float(peak), "N")


def test_markdown_and_page_have_the_same_tables(pages):
    for folder in pages.values():
        tokens = MarkdownIt("commonmark").enable("table").parse((folder / "README.md").read_text(encoding="utf-8"))
        cells = [tokens[at + 1] for at, token in enumerate(tokens) if token.type == "td_open"]
        written = ["".join(child.content for child in cell.children or ()) for cell in cells]
        page = page_of(folder)
        shown = [cell for table in page.tables for row in table[1:] for cell in row]
        own = 5 * 3  # the table of findings, which the page has as a list
        assert written[own:] == shown


def test_every_figure_is_drawn_and_shown(pages):
    for folder in pages.values():
        text = (folder / "README.md").read_text(encoding="utf-8")
        drawn = {path.stem for path in (folder / "figures").iterdir()}
        assert set(re.findall(r"!\[[^]]*\]\(figures/([^)]+)\.svg\)", text)) == drawn
        page = page_of(folder)
        specs, moving = scripts(page)
        places = {attrs["id"] for _, attrs in page.tags if attrs.get("id", "").startswith("chart-")}
        assert places == {f"chart-{name}" for name in specs}
        assert set(specs) | {"mechanism"} == drawn
        assert moving["sides"]
    assert {path.name for path in (pages["four_bar"] / "figures").iterdir()} >= {"drift.svg", "pareto.svg", "parts.svg"}


def test_what_is_missing_is_said(unreachable, pages):
    text = (pages["unreachable"] / "README.md").read_text(encoding="utf-8")
    assert "The loops cannot be closed" in text
    for reason in (unreachable.missing["exact"], unreachable.missing["remedy"]):
        assert reason in text
    _, moving = scripts(page_of(pages["unreachable"]))
    assert [side["title"] for side in moving["sides"]] == ["MuJoCo"]


NOTHING = {"settings": [], "drifts": [], "given": (), "determined": ()}
PARTS = ("pose", "recording", "exact", "attribution", "history", "recipe", "reactions", *NOTHING)


@pytest.mark.parametrize("part", [*PARTS, "everything"])
def test_any_part_may_be_missing(four_bar, tmp_path, part, monkeypatch):
    monkeypatch.setattr("vl_convert.vegalite_to_svg", lambda _: "<svg/>")
    gone = PARTS if part == "everything" else (part,)
    some = dataclasses.replace(four_bar, **{name: NOTHING.get(name) for name in gone})
    page = page_of(write_page(some, [], tmp_path / "page"))
    assert [re.sub(r"^\d\. ", "", title) for title in page.texts["h2"]] == TITLES
    assert "None." in page.texts["p"]
    specs, moving = scripts(page)
    if part == "everything":
        assert specs == {}
        assert moving is None
    assert html_fragment(some, [])


def test_a_fragment_has_findings_and_tables_and_nothing_that_runs(four_bar):
    page = Page(html_fragment(four_bar, findings_of(four_bar)))
    tags = [tag for tag, _ in page.tags]
    assert not {"script", "svg", "figure", "html", "body"} & set(tags)
    assert tags.count("details") == 3
    assert page.table("equality", "level")


# Names stay text.


def test_names_stay_text_in_the_page(named, pages):
    page = page_of(pages["named"])
    tags = [tag for tag, _ in page.tags]
    assert tags.count("script") == 3
    assert not {"img", "b", "svg", "iframe"} & set(tags)
    assert not [attrs for _, attrs in page.tags if any(str(name).startswith("on") for name in attrs)]
    for text in page.texts["script"][1:]:
        assert not re.search(r"<!--|</?script", text, re.IGNORECASE)
    names = {row["equality"] for row in page.table("equality", "level")}
    assert names == {plain(one.equality) for one in named.drifts}
    assert any("<script>alert(1)" in name for name in names)


def test_names_stay_text_in_markdown(named, pages):
    text = (pages["named"] / "README.md").read_text(encoding="utf-8")
    assert "alert" in text
    tokens = MarkdownIt("commonmark", {"html": True}).enable("table").parse(text)
    inline = [child for token in tokens for child in token.children or []]
    # The report's own: what unfolds, and the images of figures.
    assert {token.content.strip() for token in tokens if token.type == "html_block"} <= {
        "<details>\n<summary>What the codes mean</summary>",
        "</details>",
    }
    assert not [child for child in inline if child.type in ("html_inline", "link_open", "code_inline")]
    assert {child.attrs["src"] for child in inline if child.type == "image"} == {
        f"figures/{path.name}" for path in (pages["named"] / "figures").iterdir()
    }


@pytest.mark.parametrize(
    "name", ["_a_", "a_b", "www.x.y", "http://x.y", "$x$", "a\nb", "~~a~~", "![a](b)", "&lt;", "# a"]
)
def test_markdown_gives_a_name_back(name):
    (token,) = [
        one for one in MarkdownIt("gfm-like", {"linkify": False}).parse(f"x {markdown_text(name)}") if one.children
    ]
    assert token.children
    assert {child.type for child in token.children} <= {"text", "text_special"}
    assert "".join(child.content for child in token.children) == f"x {plain(name)}"


def test_names_stay_text_in_drawings(pages):
    drawings = list((pages["named"] / "figures").iterdir())
    for path in drawings:
        root = ElementTree.parse(path).getroot()
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert not [element for element in root.iter() if str(element.tag).endswith(("script", "image"))]
    assert any("alert(1)" in "".join(ElementTree.parse(path).getroot().itertext()) for path in drawings)


def test_characters_that_turn_the_writing_are_shown(named):
    assert plain("a\u202eb\tc") == "a\\u202eb c"
    assert "\u202e" not in html_fragment(named, findings_of(named))


# The mechanism.


def test_gaps_are_exaggerated_by_the_factor_and_nothing_else(four_bar):
    moving = motion(four_bar)
    assert moving is not None
    digits = f"{moving.factor:.0f}"
    assert digits[0] in "125"
    assert set(digits[1:]) <= {"0"}
    largest = max(one.metres for one in four_bar.drifts if one.level == "position")
    assert moving.gap == pytest.approx(largest, rel=1e-9)
    assert moving.caption.count(f"exaggerated {digits} times") == 1
    skeleton = Skeleton(four_bar.model, four_bar.recording.layout.equalities)
    points = skeleton.read(four_bar.recording.qpos[::500])
    wide = skeleton.exaggerated(points, 50.0)
    np.testing.assert_allclose(skeleton.gaps(wide), 50.0 * skeleton.gaps(points), rtol=1e-12)
    ends = [end for pair in skeleton.loops for end in pair]
    rest = [at for at in range(skeleton.size) if at not in ends]
    np.testing.assert_array_equal(wide[:, rest], points[:, rest])
    np.testing.assert_allclose(skeleton.gaps(skeleton.read(four_bar.exact.qpos[::500])), 0.0, atol=1e-12)


def test_the_gap_is_seen_and_the_mechanism_is_on_the_drawing(four_bar):
    moving = motion(four_bar)
    assert moving is not None
    (first, second), frames = moving.skeleton.loops[0], moving.sides["MuJoCo"]
    wide = np.linalg.norm(frames[:, first] - frames[:, second], axis=1)
    assert int(wide.argmax()) == moving.worst
    assert 0.3 * VISIBLE * SIDE * 0.8 < wide.max() < 2.0 * VISIBLE * SIDE
    for points in moving.sides.values():
        assert points.min() >= 0
        assert points[..., 0].max() <= SIDE
        assert points[..., 1].max() <= moving.height


def test_a_point_of_the_world_stays():
    exam = begin("bricard", CheckOptions(budget=0.0, duration=0.01))
    for part in examine(exam):
        if part == "run":
            break
    assert exam.recording
    skeleton = Skeleton(exam.model, exam.recording.layout.equalities)
    points = skeleton.read(exam.recording.qpos)
    wide = skeleton.exaggerated(points, 1000.0)
    worldly = [pair[1] for pair, still in zip(skeleton.loops, skeleton.still, strict=True) if still[1]]
    assert worldly
    np.testing.assert_array_equal(wide[:, worldly], points[:, worldly])


def test_gaps_over_time_are_openings():
    """A weld's rotation rows are turned into an angle."""
    exam = begin("welded_frame", CheckOptions(budget=0.0, duration=0.2))
    for part in examine(exam):
        if part == "run":
            break
    recording = exam.recording
    assert recording
    (place,) = [at for at, one in enumerate(recording.layout.equalities) if one.kind.name == "weld"]
    series = pictures._gaps(recording, recording, place)
    for step in (0, 50, recording.steps - 1):
        rows = recording.position[step, recording.layout.of_equality(place)]
        one = opening(recording.model, recording.layout.equalities[place], rows)
        assert series["m"][step] == pytest.approx(one.metres)
        assert series["rad"][step] == pytest.approx(one.radians)
    assert series["rad"].max() > 1e-3


def test_a_body_in_the_air_does_not_stand_on_the_ground():
    model = mujoco.MjModel.from_xml_path(str(CHECKED / "biped_leg" / "scene.xml"))
    skeleton = Skeleton(model, ())
    assert skeleton.grounded == []
    assert len(skeleton.bodies) == model.nbody - 1


# The folder.


def loaded(exam):
    """Wrenches through every connect, as many numbers as true ones have: the linear algebra is of no account here."""
    layout, steps = exam.recording.layout, exam.recording.steps
    frames = (np.broadcast_to(np.eye(3), (steps, 3, 3)),) * 2
    forces = [
        (one.name, exam.recording.force[:, layout.of_equality(place)])
        for place, one in enumerate(layout.equalities)
        if one.kind.name == "connect"
    ]
    return tuple(
        Wrench(name, ("a", "b"), (), Series(force, None, None), Series(0.3 * force, None, None), frames)
        for name, force in forces
    )


def test_pages_are_small(pages, tmp_path):
    many = begin(str(CHECKED / "thirty_equalities.xml"), CheckOptions(budget=0.0))
    for part in examine(many):
        if part == "remedy":
            break
    many.given = many.determined = loaded(many)
    folders = [*pages.values(), write_page(many, [], tmp_path / "many")]
    for folder in folders:
        assert (folder / "index.html").stat().st_size < MEGABYTES * 1e6
    page = page_of(folders[-1])
    assert many.pose
    assert len(page.table("equality", "type")) == len(many.pose.loops.loops)
    assert len([name for name in scripts(page)[0] if name.startswith("forces")]) == pictures.PANELS


def test_a_report_takes_the_place_of_the_old_one_and_of_nothing_else(four_bar, tmp_path, monkeypatch):
    monkeypatch.setattr("vl_convert.vegalite_to_svg", lambda _: "<svg/>")
    target = write_page(four_bar, [], tmp_path / "report")
    (target / "figures" / "old.svg").write_text("")
    write_page(four_bar, [], target)
    assert not (target / "figures" / "old.svg").exists()
    assert list(tmp_path.iterdir()) == [target]
    (target / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"notes\.txt"):
        write_page(four_bar, [], target)
    assert (target / "notes.txt").read_text() == "mine"


# A real browser.


MOVING = "[...document.querySelectorAll('#stage path.body')].map(path => path.getAttribute('d')).join()"


@pytest.mark.parametrize("name", ["four_bar", "named", "unreachable"])
def test_a_browser_draws_every_figure_and_says_nothing(browser, pages, name):
    browser.open(pages[name] / "index.html")
    drawn = int(browser.wait("document.documentElement.dataset.drawn"))
    specs, moving = scripts(page_of(pages[name]))
    assert drawn == len(specs)
    marks = "[...document.querySelectorAll('.chart')].map(c => c.querySelectorAll('svg .mark-line path, "
    marks += "svg .mark-rect path, svg .mark-symbol path').length)"
    assert min(browser.ask(marks)) > 0
    assert browser.ask("document.querySelectorAll('#stage svg').length") == len(moving["sides"])
    before = browser.ask(MOVING)
    assert before.count("M") >= len(moving["bodies"])
    browser.wait(f"{MOVING} !== {json.dumps(before)}")
    assert int(browser.ask("document.getElementById('time').value")) >= 0
    solids = "document.querySelectorAll('#stage svg')[%d].querySelectorAll('.solids polygon').length"
    counts = [{len(frame) for frame in side["solids"]} for side in moving["sides"]]
    assert all(browser.ask(solids % number) in count for number, count in enumerate(counts))
    assert browser.said == []
    assert browser.asked == [(pages[name] / "index.html").resolve().as_uri()]


def test_the_animation_obeys(browser, pages):
    browser.open(pages["four_bar"] / "index.html", prefers_reduced_motion="reduce")
    _, moving = scripts(page_of(pages["four_bar"]))
    browser.wait("document.documentElement.dataset.drawn")
    value = "Number(document.getElementById('time').value)"
    assert browser.ask(value) == moving["worst"]
    still = browser.ask(MOVING)
    browser.ask("new Promise(done => setTimeout(done, 300))")
    assert browser.ask(MOVING) == still
    browser.ask("document.getElementById('play').click()")
    browser.wait(f"{value} !== {moving['worst']}")
    browser.ask("document.getElementById('play').click()")
    stopped = browser.ask(value)
    browser.ask("new Promise(done => setTimeout(done, 300))")
    assert browser.ask(value) == stopped
    browser.ask("{ const t = document.getElementById('time'); t.value = 3; t.dispatchEvent(new Event('input')) }")
    points = moving["sides"][0]["frames"][3]
    (a, b), *_ = moving["bodies"][0]["lines"]
    expected = f"M{points[2 * a]} {points[2 * a + 1]}L{points[2 * b]} {points[2 * b + 1]}"
    assert browser.ask("document.querySelector('#stage path.body').getAttribute('d')").startswith(expected)
    assert browser.said == []


def test_names_stay_text_in_a_browser(browser, named, pages):
    browser.open(pages["named"] / "index.html")
    browser.wait("document.documentElement.dataset.drawn")
    cells = browser.ask("[...document.querySelectorAll('td')].map(cell => cell.textContent)")
    assert {plain(one.equality) for one in named.drifts} <= set(cells)
    titles = browser.ask("[...document.querySelectorAll('#stage title')].map(one => one.textContent)")
    names = [mujoco.mj_id2name(named.model, mujoco.mjtObj.mjOBJ_BODY, body) for body in range(1, named.model.nbody)]
    assert titles == [plain(name) for name in names] * 2
    assert browser.ask("document.querySelectorAll('script').length") == 3
    assert browser.ask("document.querySelectorAll('img, iframe, [onload], [onerror]').length") == 0
    assert browser.said == []


def test_a_phone_in_the_dark(browser, pages):
    colours = {}
    for scheme in ("light", "dark"):
        browser.open(pages["four_bar"] / "index.html", 390, 800, prefers_color_scheme=scheme)
        browser.wait("document.documentElement.dataset.drawn")
        assert browser.ask("document.documentElement.scrollWidth <= innerWidth")
        wide = "Math.max(...[...document.querySelectorAll('.chart svg')].map(svg => svg.getBoundingClientRect().right))"
        assert browser.ask(wide) <= 390
        get = "(node => getComputedStyle(node).{})(document.querySelector('{}'))"
        paper = browser.ask(get.format("backgroundColor", "body"))
        ink = browser.ask("document.querySelector('.chart .role-axis-label text').getAttribute('fill')")
        colours[scheme] = paper, ink
        assert browser.said == []
    assert colours["light"][0] != colours["dark"][0]
    assert colours["light"][1] != colours["dark"][1]
