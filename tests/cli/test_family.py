"""The answers of the public functions are one family."""

import json
from html.parser import HTMLParser

import oarlock
import polars as pl
import pytest
from mechanisms import four_bar, write_model
from oarlock.engines import environments
from oarlock.engines.registry import parse_engine
from oarlock.tables.folder import ResultFolder
from suites import TINY

FAMILY = ("run", "check", "diff", "suite", "sweep", "sample", "view", "conform", "versions")

NASTY = "a & <b>"
"""Name of a model that HTML would take for a tag, and Markdown too."""


class Tags(HTMLParser):
    """Which tags were opened, and whether each was closed again."""

    def __init__(self):
        super().__init__()
        self.open, self.seen = [], set()

    def handle_starttag(self, tag, attrs):
        self.seen.add(tag)
        if tag not in ("br", "hr"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def two_versions(tmp_path_factory):
    """Two names for this very MuJoCo: folders of versions that hold nothing."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        for version in ("0.9", "1.0"):
            environments.place(parse_engine(f"mujoco@{version}")).mkdir(parents=True)
        yield


@pytest.fixture(scope="module")
def answers(tmp_path_factory, two_versions):
    folder = tmp_path_factory.mktemp("family")
    case = write_model(folder / NASTY, four_bar(), TINY.replace('title = "tiny"', f'title = "{NASTY}"')).parent
    file = write_model(folder / "files", four_bar()).rename(folder / "files" / f"{NASTY}.xml")
    results = oarlock.run(case)
    before, after = results.save(folder / "before"), results.save(folder / "after")
    summary = ResultFolder(after).read_json("summary.json")
    summary["runs"][0]["drift_pos_max"] *= 1e6
    ResultFolder(after).write_json("summary.json", summary)
    return {
        "run": results,
        "check": oarlock.check(file, budget=0, duration=0.1),
        "diff": oarlock.diff(before, after),
        "suite": oarlock.suite(case, out=folder / "out", jobs=2),
        "sample": oarlock.sample(file, 5),
        "view": oarlock.view(file, duration=0.05),
        "conform": oarlock.conform(str(file), "mujoco", states=3, out=folder / "conform", jobs=1),
        "versions": oarlock.versions(str(file), ["0.9", "1.0"], states=3, out=folder / "versions", jobs=1),
        "sweep": oarlock.sweep([case], "timestep=1e-3:2e-3:2", out=folder / "out", jobs=2),
    }


@pytest.mark.parametrize("name", FAMILY)
def test_an_answer(answers, name, tmp_path):
    answer = answers[name]
    assert isinstance(answer, oarlock.Answer)

    document = answer.document()
    assert json.loads(json.dumps(document, allow_nan=False)) == document

    assert list(answer.frames) == list(answer.FRAMES)
    assert all(isinstance(frame, pl.DataFrame) for frame in answer.frames.values())
    assert answer.frames[answer.FRAMES[0]].height > 0

    shown = answer._repr_html_()
    assert NASTY not in shown.replace("\n", " ")
    tags = Tags()
    tags.feed(shown)
    tags.close()
    assert tags.open == []
    assert "b" not in tags.seen
    assert {"table", "td"} <= tags.seen

    assert answer.report(tmp_path / "page") == tmp_path / "page"
    for page in ("README.md", "index.html"):
        text = (tmp_path / "page" / page).read_text(encoding="utf-8")
        assert len(text) > 100
    assert NASTY not in text
    assert answer.report(tmp_path / "page") == tmp_path / "page"  # an old page is replaced
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(oarlock.InputError):
        answer.report(tmp_path / "taken")


def test_a_run_in_memory_is_kept_as_one_in_a_folder(answers, tmp_path):
    case = answers["run"].case.folder
    there = tmp_path / "there"
    assert oarlock.run(case, out=there).folder == there
    here = answers["run"].save(tmp_path / "here")
    names = {path.relative_to(here).as_posix() for path in here.rglob("*") if path.is_file()}
    assert names == {path.relative_to(there).as_posix() for path in there.rglob("*") if path.is_file()}
    for name in ("case.json", "sketch.json"):
        assert (here / name).read_bytes() == (there / name).read_bytes()
    assert oarlock.diff(here, there).changes == []


def test_a_suite_tells_what_was_not_done(answers, tmp_path):
    assert answers["suite"].failures.is_empty()
    assert answers["suite"].status == 0
    broken = write_model(tmp_path / "broken", "<mujoco/>", TINY).parent
    found = oarlock.suite([broken], out=tmp_path / "out", jobs=1)
    assert found.status == 2
    assert set(found.failures["case"]) == {"broken"}
    assert "broken" in found._repr_html_()


def test_a_sweep_has_its_point_in_front(answers):
    table = answers["sweep"].summary
    assert table.columns[0] in ("timestep", "swept timestep")
    assert sorted(set(table[table.columns[0]])) == [1e-3, 2e-3]
    assert [path.name for path in answers["sweep"].tables] == ["sweep.csv"]
    with pytest.raises(oarlock.InputError, match="expected KEY=A:B:N"):
        oarlock.sweep("boat", [])


@pytest.mark.parametrize("name", FAMILY)
def test_a_page_of_somebody_else_is_not_overwritten(answers, name, tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    for own in ("README.md", "mine.txt"):
        (folder / own).write_text("# Mine\n")
    with pytest.raises(oarlock.InputError, match=r"mine\.txt|README\.md' is a page of something else"):
        answers[name].report(folder)
    assert [(folder / own).read_text() for own in ("README.md", "mine.txt")] == ["# Mine\n"] * 2


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: oarlock.run("boat", duration_s=1.0), "unknown argument 'duration_s', expected one of: solver, "),
        (lambda: oarlock.run("boat", duration="1"), "duration = '1' s, expected a finite number > 0"),
        (lambda: oarlock.run("boat", rtol=True), "rtol = True, expected a finite number > 0"),
        (lambda: oarlock.run("boat", solver=3), "solver = 3, expected a name or a list of names"),
        (lambda: oarlock.check("boat", budget=-1), "budget = -1, expected a finite number ≥ 0"),
        (lambda: oarlock.check("boat", seed=1.5), "seed = 1.5, expected a whole number ≥ 0"),
    ],
)
def test_arguments_that_make_no_sense(call, said):
    with pytest.raises(oarlock.InputError) as refused:
        call()
    assert str(refused.value).startswith(said)


def test_versions_say_what_changed(answers):
    assert answers["versions"].changes() == [f"nothing changed for {NASTY} in the first 2 s"]
    assert answers["versions"].figures["engine"].to_list() == ["mujoco@0.9", "mujoco@1.0"]
    with pytest.raises(oarlock.InputError, match="expected some, such as"):
        oarlock.versions("four_bar", " , ")


def test_a_view_shows_results_and_writes_where_it_is_asked_to(answers, tmp_path):
    viewed = oarlock.view(answers["run"].save(tmp_path / "results"))
    assert isinstance(viewed, oarlock.Viewed)
    assert viewed.drift.columns == ["time_s", "MuJoCo", "exact"]
    assert viewed.write(tmp_path / "page.html") == (tmp_path / "page.html").stat().st_size
    with pytest.raises(oarlock.InputError, match=r"expected the name of a page, OUT\.html"):
        viewed.write(tmp_path / "page.txt")


def test_loops_are_closed_from_a_program(tmp_path):
    source = tmp_path / "open.xml"
    source.write_text(four_bar(pivot="0.73 0 0").replace('<connect name="pin" site1="tip1" site2="tip2"/>', ""))
    closed = oarlock.close(source, tmp_path / "closed.xml", [("tip1", "tip2")])
    assert isinstance(closed, oarlock.Closing)
    assert closed.files == (tmp_path / "closed.xml",)
    assert oarlock.check(closed.files[0], keyframe=closed.keyframe, lint=True).examination.model.neq == 1
    for given, said in (
        ({"kind": "glue"}, "unknown kind 'glue', expected one of: connect"),
        ({"at": [0, 0, 0], "pair": [("tip1", "tip2")] * 2}, "--at with 2 pairs"),
    ):
        with pytest.raises(oarlock.InputError, match=said):
            oarlock.close(source, tmp_path / "other.xml", **given)
