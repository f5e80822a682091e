"""The suite: what is finished is kept, what changed is repeated, what fails stops nothing else."""

import json
from contextlib import closing
from pathlib import Path

import grimp
import pytest
from mechanisms import four_bar, write_model
from oarlock import InputError, load_case, run
from oarlock.batch import digest
from oarlock.batch.pages import write_pages
from oarlock.batch.suite import carry_out, collate, plan_suite, status_of
from oarlock.batch.unit import expected_digest, plan_units
from oarlock.batch.workers import LocalWorkers
from oarlock.report.summary import Summary, write_summary
from oarlock.tables.figures import TIMING_FIGURES
from oarlock.tables.folder import ResultFolder
from oarlock.tables.ledger import Ledger
from oarlock.tables.provenance import occasion
from places import REPOSITORY
from suites import KILL, KILL_ONCE, STRICT, TINY, UNITS, Counter, carried_out, interrupted_and_resumed, python_model


@pytest.fixture(scope="module")
def workers():
    with closing(LocalWorkers(2)) as made:
        yield made


# What it leaves.


def test_results_are_those_of_a_run(tiny, tmp_path, workers):
    carried_out([tiny], tmp_path / "out", workers)
    run(tiny, out=tmp_path / "run")
    suite, single = ResultFolder(tmp_path / "out" / "tiny"), ResultFolder(tmp_path / "run")
    names = {str(path.relative_to(single.path)) for path in single.path.rglob("*")}
    assert len(names) == 3 + 1 + 7
    assert {str(path.relative_to(suite.path)) for path in suite.path.rglob("*")} == {*names, "units.json"}
    for name in ("case.json", "sketch.json"):
        assert suite.read_json(name) == single.read_json(name)
    documents = [folder.read_json("summary.json") for folder in (suite, single)]
    for document in documents:
        for row in document["runs"]:
            row.update(dict.fromkeys(TIMING_FIGURES))
    assert [documents[0][key] for key in ("runs", "gates")] == [documents[1][key] for key in ("runs", "gates")]
    for row in documents[0]["runs"]:
        timed = ("solve_ns", "step_us")
        assert suite.read_steps(row["run"]).drop(timed).equals(single.read_steps(row["run"]).drop(timed))


def test_units_of_the_boat_are_its_runs():
    """Every run once, each in one unit, and the parts in the order of the whole."""
    units = plan_units("boat", load_case("boat"))
    names = [name for unit in units for name in unit.runs]
    page = (REPOSITORY / "reports" / "boat" / "README.md").read_text(encoding="utf-8")
    runs = page.partition("## Runs")[2].partition("## Solves")[0]
    assert len(set(names)) == len(names) >= 29
    assert [name for name in names if f"| {name} |" not in runs] == []
    assert [unit.first for unit in units] == [True, *[False] * (len(units) - 1)]
    assert {unit.digest for unit in units} == {expected_digest(unit, load_case("boat")) for unit in units}
    assert len({unit.digest for unit in units}) == len(units)


def test_a_run_that_two_experiments_name_belongs_to_the_first(tiny, tmp_path, workers):
    again = '[[experiments]]\nmode = "lockstep"\nforms = ["hard"]\nsolvers = ["pinv", "cholesky"]\n'
    (tiny / "case.toml").write_text(TINY.replace("[[gates]]", again + "[[gates]]"))
    suite = carried_out([tiny], tmp_path / "out", workers)
    names = [row["run"] for row in suite.document()["runs"]]
    assert len(names) == len(set(names)) == 8
    assert carried_out([tiny], tmp_path / "out", workers).repeated == 0


# What is repeated.


def test_nothing_is_repeated(tiny, tmp_path, workers):
    out = tmp_path / "out"
    assert carried_out([tiny], out, workers).repeated == UNITS
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}
    assert len(before) == 3 + 7 + 1
    again = carried_out([tiny], out, workers)
    assert again.repeated == 0
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()} == before
    assert len(again.members[0].verdicts) == 1
    assert carried_out([tiny], out, workers, fresh=True).repeated == UNITS


def test_what_changed_is_repeated(tiny, tmp_path, workers, monkeypatch):
    other, out = write_model(tmp_path / "other", four_bar(), TINY).parent, tmp_path / "out"
    carried_out([tiny, other], out, workers)

    def repeated():
        return carried_out([tiny, other], out, workers).repeated

    (tiny / "model.xml").write_text(four_bar().replace('size="0.02"', 'size="0.03"'))
    assert repeated() == UNITS
    (tiny / "case.toml").write_text(TINY.replace("0.02", "0.03"))
    assert repeated() == UNITS
    (tiny / "case.toml").write_text(TINY.replace("0.02", "0.03").replace('"sr1"', '"sr1", "cholesky"'))
    assert repeated() == 1
    table = out / "tiny" / "steps" / "free-hard-pinv-projection-rk4.parquet"
    table.write_bytes((out / "tiny" / "steps" / "free-mujoco-rk4.parquet").read_bytes())
    assert repeated() == 1
    (out / "tiny" / "sketch.json").unlink()
    assert repeated() == 1
    assert repeated() == 0
    monkeypatch.setattr(digest, "program", lambda: "another version")
    assert sum(len(m.units) for m in plan_suite([str(tiny), str(other)], out).members) == 2 * UNITS
    assert not any(
        m.ledger.finished(u.name, u.digest) for m in plan_suite([str(tiny), str(other)], out).members for u in m.units
    )


def test_included_files_count(tmp_path):
    text = four_bar()
    geom = text[text.index("<default>") : text.index("</default>") + len("</default>")]
    write_model(tmp_path / "parted", text.replace(geom, '<include file="parts/defaults.xml"/>'), TINY)
    (tmp_path / "parted" / "parts").mkdir()
    part = tmp_path / "parted" / "parts" / "defaults.xml"
    part.write_text(f"<mujoco>{geom}</mujoco>")
    before = digest.of_case(load_case(tmp_path / "parted"))
    assert digest.of_case(load_case(tmp_path / "parted")) == before
    part.write_text(part.read_text().replace("0.02", "0.03"))
    assert digest.of_case(load_case(tmp_path / "parted")) != before


def test_gates_are_judged_anew_without_a_run(tiny, tmp_path, workers):
    out = tmp_path / "out"
    assert status_of(carried_out([tiny], out, workers)) == 0
    (tiny / "case.toml").write_text("# stricter\n" + STRICT)
    strict = carried_out([tiny], out, workers)
    assert (strict.repeated, status_of(strict)) == (0, 1)
    assert [gate["held"] for gate in ResultFolder(out / "tiny").read_json("summary.json")["gates"]] == [False]


def test_runs_that_are_no_longer_asked_for_go(tiny, tmp_path, workers):
    out = tmp_path / "out"
    carried_out([tiny], out, workers)
    (tiny / "case.toml").write_text(TINY.replace('"mujoco", "pinv"', '"pinv"'))
    suite = carried_out([tiny], out, workers)
    assert suite.repeated == 0
    assert not (out / "tiny" / "steps" / "free-mujoco-rk4.parquet").exists()
    assert len(suite.document()["runs"]) == 6


def test_prose_is_no_part_of_the_digest(tmp_path):
    source = tmp_path / "a.py"

    def digest_of(text):
        source.write_text(text)
        return digest._code(source)

    plain = digest_of('"""One."""\n\nX = 1\n"""What X is."""\n\n\ndef f():\n    """Two."""\n    return X\n')
    assert digest_of('"""Another."""\nX = 1  # why\ndef f():\n    return X\n') == plain
    assert digest_of("X = 2\ndef f():\n    return X\n") != plain
    assert digest_of('X = 1\ndef f():\n    return "X"\n') != plain


def test_the_digest_covers_the_rooms_that_a_unit_imports_and_no_others():
    """An edit of a page or a benchmark repeats no run; an edit of anything that computes repeats all of them."""
    graph = grimp.build_graph("oarlock", cache_dir=None)
    unit = "oarlock.batch.unit"
    imported = graph.find_upstream_modules(unit)
    rooms = {module.split(".")[1] for module in imported if module.count(".") > 1 or graph.find_children(module)}
    rooms -= {"batch"}
    assert rooms == set(digest.COMPUTING)
    assert {module for module in imported if module.startswith("oarlock.batch.")} <= {"oarlock.batch.digest"}
    pages = {"oarlock.report.summary", "oarlock.report.case_report", "oarlock.report.sweep_report"}
    drawn = {module for page in pages for module in (page, *graph.find_upstream_modules(page))}
    assert {module.split(".")[1] for module in drawn if module.count(".") > 1} == set(digest.PRESENTING)


# What fails.


def test_a_model_that_fails_stops_no_other(tiny, tmp_path, workers):
    bad = write_model(tmp_path / "bad", "<mujoco><worldbody><body>", TINY).parent
    broken = write_model(tmp_path / "broken", four_bar(), "title = 'x'\nrun.duration_s = -1").parent
    raising = python_model(tmp_path / "raising", "raise RuntimeError('no such bar')")
    wrong = write_model(tmp_path / "wrong", four_bar(), TINY.replace("drift_pos_max", "drift_of_sand")).parent
    suite = carried_out([bad, broken, raising, wrong, tiny], tmp_path / "out", workers)
    by_name = {member.name: member for member in suite.members}
    assert list(by_name) == ["bad", "broken", "raising", "wrong", "tiny"]
    assert {v.held for v in by_name["tiny"].verdicts} == {True}
    assert len(by_name["tiny"].ledger.rows()) == 7
    assert "run.duration_s = -1" in by_name["broken"].refused
    assert "drift_of_sand" in by_name["wrong"].refused
    assert all("XML that cannot be read" in why.message for why in by_name["bad"].ledger.failures().values())
    assert len(by_name["bad"].ledger.failures()) == UNITS
    assert all("no such bar" in why.message for why in by_name["raising"].ledger.failures().values())
    assert len(by_name["raising"].ledger.failures()) == UNITS
    assert status_of(suite) == 2
    failures = suite.document()["failures"]
    assert {failure["case"] for failure in failures} == {"bad", "broken", "raising", "wrong"}
    # Mended, it runs; what is finished stays.
    (bad / "model.xml").write_text(four_bar())
    assert carried_out([bad, tiny], tmp_path / "out", workers).repeated == UNITS


def test_a_killed_worker_takes_only_its_unit(tiny, tmp_path, workers):
    killer = python_model(tmp_path / "killer", KILL)
    heard = Counter()
    suite = carried_out([killer, tiny], tmp_path / "out", workers, progress=heard)
    killed, whole = suite.members
    assert len(killed.ledger.failures()) == UNITS
    assert {why.status for why in killed.ledger.failures().values()} == {"failed"}
    assert all("SIGKILL, twice" in why.message for why in killed.ledger.failures().values())
    assert whole.ledger.failures() == {}
    assert len(whole.ledger.rows()) == 7
    assert sum(1 for message in heard.said.values() if message) == UNITS
    assert status_of(suite) == 1


def test_a_unit_whose_worker_was_killed_once_is_done(tmp_path, workers):
    once = python_model(tmp_path / "once", KILL_ONCE)
    suite = carried_out([once], tmp_path / "out", workers)
    assert (tmp_path / "was_here").exists()
    assert suite.members[0].ledger.failures() == {}
    assert status_of(suite) == 0


def test_a_changed_model_is_not_mixed_with_what_was_planned(tiny, tmp_path, workers):
    suite = plan_suite([str(tiny)], tmp_path / "out")
    (tiny / "model.xml").write_text(four_bar(pivot="0.71 0 0"))
    carry_out(suite, workers)
    assert len(suite.members[0].ledger.failures()) == UNITS
    assert all("not what it was" in why.message for why in suite.members[0].ledger.failures().values())


# The report.


@pytest.fixture(scope="module")
def varied(tmp_path_factory, workers):
    """Results of three cases: one as it should be, one with a gate that fails and more drift, one refused."""
    folder = tmp_path_factory.mktemp("varied")
    good = write_model(folder / "good", four_bar(), TINY).parent
    worse = write_model(folder / "worse", four_bar(joint='damping="0"'), STRICT.replace("0.02", "0.2")).parent
    sweep = "[sweep]\ntimesteps_s = [1e-3, 2e-3]\nsolvers = ['pinv']\nsettings = ['default']\nintegrators = ['euler']\n"
    (good / "case.toml").write_text(TINY + sweep)
    refused = write_model(folder / "refused", "<mujoco/>", "title = 'x'\nrun.duration_s = -1").parent
    suite = carried_out([good, worse, refused], folder / "out", workers)
    return folder / "out", suite


def tracked(report):
    paths = [report / "README.md", report / "summary.json", *sorted(report.glob("figures/*.svg"))]
    return {str(path.relative_to(report)): path.read_bytes() for path in paths}


def test_summary_is_a_function_of_the_folders(varied, tmp_path, workers):
    out, suite = varied
    folders = [out / "good", out / "worse", out / "refused"]
    first = tracked(write_summary(folders, tmp_path / "one"))
    assert set(first) == {"README.md", "summary.json", "figures/drift.svg", "figures/iterations.svg"}
    moment = {**occasion(), "date": "1999", "commit": "other"}
    for member in suite.members:
        collate(member, moment)
    assert tracked(write_summary(folders, tmp_path / "two")) == first
    page = (tmp_path / "one" / "index.html").read_text(encoding="utf-8")
    assert "good/index.html" in page
    assert "summary.json" in page
    date = ResultFolder(out / "good").read_json("summary.json")["provenance"]["date"]
    assert date in page
    assert not any(date.encode() in content for content in first.values())


def test_summary_json_has_the_contract_and_no_timing(varied, tmp_path):
    out, suite = varied
    write_summary([out / "good", out / "worse", out / "refused"], tmp_path)
    document = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    rows = suite.document()["runs"]
    assert [row["run"] for row in document["runs"]] == [row["run"] for row in rows]
    assert len(rows) == 14
    for row, whole in zip(document["runs"], rows, strict=True):
        assert list(row) == list(whole)
        assert [row[name] for name in TIMING_FIGURES] == [None, None]
        assert row["drift_pos_max"] == pytest.approx(whole["drift_pos_max"], rel=1e-5)
    assert [gate["case"] for gate in document["gates"]] == ["good", "worse"]
    assert [failure["case"] for failure in document["failures"]] == ["refused"]
    assert "date" not in document["provenance"]


def test_summary_names_the_worst(varied, tmp_path):
    out, _ = varied
    folders = [out / "good", out / "worse", out / "refused"]
    text = (write_summary(folders, tmp_path) / "README.md").read_text(encoding="utf-8")
    front, worst = text.partition("\n## ")[0], text.partition("## Worst")[2]
    assert "1 of 2 gates do not hold; 1 model could not be run" in front
    drifts = {line.name: line.cells()["drift"]["default"] for line in Summary(folders).lines if line.tables is not None}
    assert drifts["worse"] > drifts["good"] > 0
    largest = next(line for line in worst.splitlines() if "Largest drift of MuJoCo" in line)
    assert "[worse](worse/README.md)" in largest
    assert "good" not in largest
    assert "**Gate fails**: [worse](worse/README.md), drift_pos_max" in worst
    assert "**Refused**: refused: " in worst
    assert "| [good](good/README.md) | all 1 hold | 3 | 3 | 2 | 1 | 1 |" in text
    assert "| refused | **refused** | – |" in text


def test_rows_of_the_sweep_stay_out_of_the_case(varied):
    out, _ = varied
    ledger = Ledger.read(out / "good")
    assert {row["timestep_s"] for row in ledger.rows(sweep=True)} == {1e-3, 2e-3}
    assert len(ledger.rows(sweep=True)) == 4
    assert {row["timestep_s"] for row in ledger.rows()} == {2e-3}


def test_pages_are_made_once(varied, tmp_path, workers):
    out, _ = varied
    folders, report = [out / "good", out / "worse", out / "refused"], tmp_path / "report"
    heard = Counter()
    assert write_pages(out, folders, report, workers, heard, every=True) == []
    assert len(heard.said) == 3
    assert (report / "good" / "index.html").is_file()
    again = Counter()
    assert write_pages(out, folders, report, workers, again, every=True) == []
    assert again.said == {}
    (report / "good" / "README.md").write_text("edited")
    assert write_pages(out, folders, report, workers, again, every=True) == []
    assert list(again.said) == [str(report / "good" / "README.md")]
    (report / "worse" / "notes.txt").write_text("mine")
    (report / "worse" / "README.md").write_text("mine")
    (failure,) = write_pages(out, folders, report, workers, again, every=True)
    assert "notes.txt" in failure
    assert (report / "worse" / "README.md").read_text() == "mine"


# The command.


def test_exit_statuses(tiny, oarlock_here, tmp_path):
    out = ["--out", "out", "--jobs", "1", "--report", "report"]
    finished = oarlock_here("suite", tiny, *out, "--json", "-")
    assert finished.returncode == 0
    assert {"provenance", "runs", "gates", "failures"} == set(json.loads(finished.stdout))
    assert "tiny calibration-mujoco-rk4" in finished.stderr
    assert (tmp_path / "report" / "README.md").is_file()
    (tiny / "case.toml").write_text(STRICT)
    finished = oarlock_here("suite", tiny, *out)
    assert finished.returncode == 1
    (line,) = [line for line in finished.stderr.splitlines() if "gate failed" in line]
    assert line.startswith("oarlock: gate failed: tiny: drift_pos_max = ")
    (tiny / "case.toml").write_text("title = 1")
    finished = oarlock_here("suite", tiny, *out)
    assert finished.returncode == 2
    assert "oarlock: model refused: tiny: " in finished.stderr
    assert "Traceback" not in finished.stderr


def test_mistakes_are_said_before_anything_runs(tiny, oarlock_here, tmp_path):
    finished = oarlock_here("suite", tiny, "bogus", "--out", "out")
    assert finished.returncode == 2
    assert finished.stderr.startswith("oarlock: unknown model 'bogus', expected one of: ")
    assert not (tmp_path / "out").exists()
    assert oarlock_here("suite", tiny, "--jobs", "0").returncode == 2
    write_model(tmp_path / "elsewhere" / "tiny", four_bar(), TINY)
    with pytest.raises(InputError, match="both called 'tiny'"):
        plan_suite([str(tiny), str(tmp_path / "elsewhere" / "tiny")], tmp_path / "out")


def test_variants_are_members():
    names = [member.name for member in plan_suite(["n_four_bar", "boat"], Path("nowhere")).members]
    assert names[0] == "n_four_bar"
    assert names[-1] == "boat"
    assert len(names) >= 4
    (alone,) = plan_suite(["n_four_bar:N=10"], Path("nowhere")).members
    assert (alone.name, alone.folder.path.name) == ("n_four_bar:N=10", "n_four_bar-N=10")


def test_an_interruption_keeps_what_is_finished(tmp_path):
    interrupted_and_resumed(tmp_path)
