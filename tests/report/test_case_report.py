"""The report: what it says is in the tables, it can be made again, and nothing in it runs or loads but its own."""

import contextlib
import functools
import html.parser
import json
import re
import shutil
import warnings
import xml.etree.ElementTree as ElementTree

import pytest
import vl_convert
from mechanisms import four_bar, only, write_model
from oarlock import InputError, run
from oarlock.base.numbers import figure
from oarlock.report import case_report as report
from oarlock.report.case_report import write_report
from oarlock.tables.folder import ResultFolder

TRACKED = ["README.md", "figures/*.svg"]


@pytest.fixture(scope="module", autouse=True)
def _library_once():
    """The chart library takes over a second to bundle, and is always the same."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(vl_convert, "javascript_bundle", functools.cache(vl_convert.javascript_bundle))
        yield


@pytest.fixture(scope="module")
def boat_report(boat_run, tmp_path_factory):
    """The report of the whole case."""
    return write_report(boat_run.folder, tmp_path_factory.mktemp("report") / "boat")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Results that are soon reported: a four-bar, no truth, no gates, one solver."""
    folder = tmp_path_factory.mktemp("small")
    run(write_model(folder / "bar", four_bar()), mode="free", solver="pinv", duration=0.02, out=folder / "results")
    return folder / "results"


class Page(html.parser.HTMLParser):
    """The tags of a page with their attributes, and its text."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.text = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text.append(data)


def plain(text):
    """Markdown without its backslashes."""
    return re.sub(r"\\(\W)", r"\1", text)


def cells(text, first):
    """The cells of the rows of Markdown tables that begin with ``first``."""
    rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in text.splitlines() if line.startswith("| ")]
    return [found for row in rows if (found := [plain(cell.strip()) for cell in row])[0] == first]


def well_formed(text):
    """Every row of every Markdown table has as many cells as its head."""
    width, tables = None, 0
    for line in text.splitlines():
        if not line.startswith("|"):
            width = None
            continue
        found = len(re.split(r"(?<!\\)\|", line))
        tables += width is None
        width = width or found
        assert found == width, line
    return tables


# What it says.


def test_every_figure_is_a_drawing(boat_report):
    text = (boat_report / "README.md").read_text(encoding="utf-8")
    named = set(re.findall(r"!\[[^]]*\]\(([^)]+)\)", text))
    drawn = {str(path.relative_to(boat_report)) for path in (boat_report / "figures").iterdir()}
    assert named == drawn
    assert len(drawn) >= 6
    for name in drawn:
        root = ElementTree.parse(boat_report / name).getroot()
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert float(root.attrib["width"]) > 100
        assert len(list(root.iter("{http://www.w3.org/2000/svg}path"))) > 5
        assert list(root.iter("{http://www.w3.org/2000/svg}script")) == []


def test_numbers_are_those_of_the_tables(boat_run, boat_report):
    text = (boat_report / "README.md").read_text(encoding="utf-8")
    assert well_formed(text) >= 5
    of_runs = ["status", "qacc_rel_diff_max", "qfrc_constraint_rel_diff_max", "drift_pos_max", "drift_vel_max"]
    of_runs += ["drift_acc_max", "energy_drift_rel", "error_estimate_max", "truth_error_max", "trajectory_diff_max"]
    for row in boat_run.rows:
        runs, *solves = cells(text, row["run"])
        assert runs[1:] == [row["status"], *(figure(row[name]) for name in of_runs[1:])]
        assert len(solves) == (row["solves"] > 0)
        for line in solves:
            assert line[1:3] == [figure(row["iterations_mean"]), figure(row["iterations_max"])]
            assert line[6:8] == [figure(row["min_norm_error_max"]), figure(row["min_norm_error_median"])]


def test_projected_runs_say_what_they_took(boat_run, boat_report):
    text = plain((boat_report / "README.md").read_text(encoding="utf-8"))
    rows = [row for row in boat_run.rows if row["mode"] == "free" and row["stabilisation"] == "projection"]
    assert {row["integrator"] for row in rows} == {"euler", "rk4"}
    for row in rows:
        (line,) = [line for line in text.splitlines() if line.startswith(f"{row['run']}: ")]
        assert f"{figure(row['projection_rounds_mean'])} rounds" in line
        assert f"0 of {figure(row['steps_done'])} steps not brought onto the constraints" in line
    front = text.partition("\n## ")[0]
    assert f"stand open by at most {figure(max(row['drift_pos_max'] for row in rows), 'm')}" in front


def test_units_are_those_of_the_rows_and_of_the_truth(tmp_path):
    """A gear train has angles in its rows and in its truth; a slider-crank is known by a slide, in m."""
    rows = {"gear_train": ("rad", "rad/s", "rad"), "spatial_slider_crank": ("m", "m/s", "m")}
    for name, (unit, rate_unit, truth_unit) in rows.items():
        results = run(name, mode="free", solver="pinv", stabilisation="projection", duration=0.01, out=tmp_path / name)
        text = (write_report(tmp_path / name, tmp_path / "report" / name) / "README.md").read_text(encoding="utf-8")
        row = only(results.rows, mode="free", form="hard")
        (said,) = [line for line in text.splitlines() if line.startswith("**Projection.**")]
        assert f"at most {figure(row['drift_pos_max'], unit)} and" in said
        assert f"at most {figure(row['drift_vel_max'], rate_unit)} (" in said
        assert f"is {figure(row['truth_error_max'], truth_unit)} away" in said
        deviations = (tmp_path / "report" / name / "figures" / "deviations.svg").read_text(encoding="utf-8")
        assert f"|deviation| ({unit})" in deviations


def test_a_run_beyond_its_truth(tmp_path):
    """The truth ends before the run does: its curve ends there."""
    toml = "title = 'x'\nrun.duration_s = 0.02\ntruth = { file = 'short.csv', joint = 'crank', source = 'nobody' }"
    path = write_model(tmp_path / "bar", four_bar(), toml)
    head = "time,position,velocity,acceleration\n"
    (tmp_path / "bar" / "short.csv").write_text(head + "0,0,0,0\n0.01,0,0,0\n", encoding="utf-8")
    run(path.parent, mode="free", solver="pinv", out=tmp_path / "results")
    page = write_report(tmp_path / "results", tmp_path / "report") / "README.md"
    assert "![truth](figures/truth.svg)" in page.read_text(encoding="utf-8")


def test_all_gates_appear(boat_run, boat_report):
    text = (boat_report / "README.md").read_text(encoding="utf-8")
    gates = boat_run.document["gates"]
    assert len(gates) >= 14
    for gate in gates:
        (line,) = [line for line in cells(text, gate["figure"]) if line[1] == gate["run"]]
        assert line[2] == figure(gate["value"])
        assert line[4] == "yes"
        assert line[5] == gate["cause"]
    assert f"All {len(gates)} gates hold." in text


def test_failed_gates_are_in_front(boat_run, tmp_path):
    results = shutil.copytree(boat_run.folder, tmp_path / "results")
    document = ResultFolder(results).read_json("summary.json")
    document["gates"][5]["held"] = False
    document["gates"][6]["held"] = None
    ResultFolder(results).write_json("summary.json", document)
    text = (write_report(results, tmp_path / "report") / "README.md").read_text(encoding="utf-8")
    front = text.partition("\n## ")[0]
    assert f"1 of {len(document['gates']) - 1} gates do not hold: {document['gates'][5]['figure']}" in front
    assert [line[4] for line in cells(text, document["gates"][5]["figure"])].count("**NO**") == 1
    assert text.count("not checked") == 1


# It can be made again.


def test_tracked_files_come_out_the_same(boat_run, boat_report, tmp_path):
    again = write_report(boat_run.folder, tmp_path / "elsewhere")
    names = [path.relative_to(again) for pattern in TRACKED for path in again.glob(pattern)]
    assert len(names) >= 7
    for name in names:
        assert (again / name).read_bytes() == (boat_report / name).read_bytes(), name


def test_tracked_page_has_nothing_of_the_occasion(boat_run, boat_report):
    text = (boat_report / "README.md").read_text(encoding="utf-8")
    provenance = boat_run.document["provenance"]
    for key in ("date", "commit", "kernel"):
        assert provenance[key] is None or str(provenance[key]) not in text
    assert "ns" not in re.findall(r"[a-zµ]+", text)
    assert provenance["model_sha256"] in text


def test_a_report_takes_the_place_of_the_old_one(small, boat_report, tmp_path):
    target = shutil.copytree(boat_report, tmp_path / "report")
    assert (target / "figures" / "truth.svg").is_file()
    write_report(small, target)
    assert not (target / "figures" / "truth.svg").exists()  # there is none for the four-bar
    assert (target / "figures" / "deviations.svg").is_file()
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize(
    ("moment", "failure"), [("before", KeyboardInterrupt), ("after", OSError(28, "No space left on device"))]
)
def test_a_failure_leaves_the_old_report(small, boat_report, tmp_path, monkeypatch, failure, moment):
    target = shutil.copytree(boat_report, tmp_path / "report")
    before = {path: path.read_bytes() for path in target.rglob("*") if path.is_file()}
    whole = report._write

    def fail(folder, *rest):
        if moment == "after":
            whole(folder, *rest)
        raise failure

    monkeypatch.setattr(report, "_write", fail)
    with pytest.raises((KeyboardInterrupt, InputError)):
        write_report(small, target)
    assert {path: path.read_bytes() for path in target.rglob("*") if path.is_file()} == before
    assert list(tmp_path.iterdir()) == [target]


# The mechanism.


def test_the_mechanism_has_its_geoms(small, tmp_path):
    """Three capsules; in results of before, which have none, the joints alone."""
    drawn = (write_report(small, tmp_path / "new") / "figures" / "mechanism.svg").read_text()
    results = shutil.copytree(small, tmp_path / "results")
    sketch = ResultFolder(results).read_json("sketch.json")
    assert [shape["kind"] for shape in sketch.pop("solids")["shapes"]] == ["capsule"] * 3
    ResultFolder(results).write_json("sketch.json", sketch)
    bare = (write_report(results, tmp_path / "old") / "figures" / "mechanism.svg").read_text()
    assert drawn.count("<path") >= bare.count("<path") + 3


# Folders that are no results, and folders that are no report.


@pytest.mark.parametrize(
    ("name", "content"), [("case.json", None), ("summary.json", None), ("summary.json", "{}"), ("sketch.json", "[1,")]
)
def test_damaged_results_are_named(small, tmp_path, name, content):
    results = shutil.copytree(small, tmp_path / "results")
    (results / name).unlink()
    if content is not None:
        (results / name).write_text(content)
    with pytest.raises(InputError, match=name.replace(".", r"\.")):
        write_report(results, tmp_path / "report")
    assert not (tmp_path / "report").exists()


def test_missing_steps_are_named(small, tmp_path):
    results = shutil.copytree(small, tmp_path / "results")
    shutil.rmtree(results / "steps")
    with pytest.raises(InputError, match=r"\.parquet"):
        write_report(results, tmp_path / "report")


@pytest.mark.parametrize("names", [["notes.txt"], ["README.md", "src/main.py"], ["README.md", ".git/config"]])
def test_a_folder_that_is_no_report_is_left_alone(small, tmp_path, names):
    """A project has a README.md too: replacing its folder would destroy it."""
    target = tmp_path / "project"
    for name in names:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (target / name).write_text("mine")
    with contextlib.suppress(InputError):
        write_report(small, target)
    assert all((target / name).is_file() and (target / name).read_text() == "mine" for name in names)
    with pytest.raises(InputError, match="project"):
        write_report(small, target)


def test_a_file_in_place_of_the_target(small, tmp_path):
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(InputError, match="taken"):
        write_report(small, tmp_path / "taken")
    assert (tmp_path / "taken").read_text() == "mine"


# The page.


def specs_of(text):
    """The charts that the page hands to its library."""
    found = re.search(r"^const specs = (.*);$", text, re.MULTILINE)
    assert found is not None
    return found[1]


def test_page_is_self_contained(boat_report):
    text = (boat_report / "index.html").read_text(encoding="utf-8")
    page = Page(text)
    loaded = [attrs[name] for _, attrs in page.tags for name in ("src", "href", "action", "data") if name in attrs]
    assert [target for target in loaded if not target.startswith(("#", "data:"))] == []
    assert not re.search(r"@import|import\s*\(\s*[\"']http|url\(\s*[\"']?http", text)
    assert [tag for tag, _ in page.tags].count("script") == 2


def test_page_draws_every_figure(boat_report):
    text = (boat_report / "index.html").read_text(encoding="utf-8")
    specs = json.loads(specs_of(text))
    assert set(specs) == {path.stem for path in (boat_report / "figures").iterdir()}
    places = {attrs["id"] for _, attrs in Page(text).tags if attrs.get("id", "").startswith("chart-")}
    assert places == {f"chart-{name}" for name in specs}
    assert all("mark" in json.dumps(spec) for spec in specs.values())


HOSTILE = "<!--<script>alert(1)</script>"


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """The report of a model whose every name wants to be markup."""
    folder = tmp_path_factory.mktemp("hostile")
    name = HOSTILE.replace("<", "&lt;").replace(">", "&gt;")
    xml = four_bar().replace('name="pin"', f'name="{name}"').replace('body name="rocker"', f'body name="{name}"')
    xml = xml.replace('joint name="rocker"', 'joint name="a | b ![](http://x/y.png)"')
    toml = f"""title = "{HOSTILE} | x"
summary = "{HOSTILE} <img src=x onerror=alert(2)>"
source = "[click](javascript:alert(3))"
tags = ["{HOSTILE}"]
[expect]
rank = 2
[[gates]]
figure = "drift_pos_max"
max = 1.0
cause = "a | b {HOSTILE}"
"""
    results = folder / "results"
    run(write_model(folder / "a | b <i>", xml, toml), mode="free", solver="pinv", duration=0.02, out=results)
    return write_report(results, folder / "report")


def test_names_stay_text_in_the_page(hostile):
    text = (hostile / "index.html").read_text(encoding="utf-8")
    page = Page(text)
    tags = [tag for tag, _ in page.tags]
    assert tags.count("script") == 2
    assert not {"img", "i", "b", "iframe"} & set(tags)
    assert not [attrs for _, attrs in page.tags if any(str(value).startswith("javascript") for value in attrs.values())]
    assert "alert(1)" in "".join(page.text)


def test_names_cannot_end_the_script(hostile):
    """``<!--<script>`` in a script would swallow its end."""
    specs = specs_of((hostile / "index.html").read_text(encoding="utf-8"))
    assert "alert(1)" in specs
    assert not re.search(r"<!--|</?script", specs, re.IGNORECASE)


def test_names_stay_text_in_markdown(hostile):
    text = (hostile / "README.md").read_text(encoding="utf-8")
    assert well_formed(text) >= 4
    assert "alert(1)" in text
    assert re.findall(r"(?<!\\)<(?:script|img|i>|!--)", text) == []


def test_names_stay_text_in_drawings(hostile):
    drawings = list((hostile / "figures").iterdir())
    assert drawings
    for path in drawings:
        root = ElementTree.parse(path).getroot()
        assert not [element for element in root.iter() if str(element.tag).endswith("script")]
    assert any("alert(1)" in "".join(ElementTree.parse(path).getroot().itertext()) for path in drawings)


# Results that are thin or ended badly.


def test_one_step_is_enough(tmp_path):
    path = write_model(tmp_path / "bar", four_bar())
    results = run(path, duration=1e-9, walker="pinv", out=tmp_path / "results")
    assert {row["steps_done"] for row in results.rows} == {1}
    write_report(tmp_path / "results", tmp_path / "report")


def test_diverged_runs_are_reported(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # its own test holds against the noise
        run("boat", timestep=0.5, out=tmp_path / "results")
    rows = ResultFolder(tmp_path / "results").read_json("summary.json")["runs"]
    assert {row["status"] for row in rows} == {"diverged"}
    text = (write_report(tmp_path / "results", tmp_path / "report") / "README.md").read_text(encoding="utf-8")
    well_formed(text)
    for row in rows:
        assert f"{row['run']} ended at {row['message']}" in plain(text)
