"""Sweeps: what is asked for, what the runs show, and that nothing of them gets among a case's own results."""

import csv
import itertools
import json
import shutil
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from mechanisms import four_bar, only, write_model
from oarlock import InputError, load_case
from oarlock.batch.suite import carry_out, plan_suite, status_of
from oarlock.batch.sweep import MAX_UNITS, folder_name, parse_axes, plan_sweep, tasks_of
from oarlock.batch.unit import expected_digest
from oarlock.batch.workers import LocalWorkers
from oarlock.cases.case import MODELS
from oarlock.cases.point import OWN, Point
from oarlock.report.sweep_report import write_sweep_report
from oarlock.tables.figures import TIMING_FIGURES
from oarlock.tables.folder import ResultFolder
from oarlock.tables.ledger import Ledger
from tolerances import (
    CLOSED,
    EULER_ORDER_HIGH,
    EULER_ORDER_LOW,
    RK4_ORDER_HIGH,
    RK4_ORDER_LOW,
    SOFTNESS_ALONE,
)

SWUNG = """title = "swung"
[run]
duration_s = 0.2
stabilisation = "baumgarte"
[start]
qvel = { crank = 6.0 }
[[experiments]]
mode = "free"
solvers = ["mujoco", "cholesky"]
"""


@pytest.fixture(scope="module")
def workers():
    with closing(LocalWorkers(2)) as made:
        yield made


@pytest.fixture
def swung(tmp_path):
    """A four-bar that is swung for a fifth of a second, at 2 ms."""
    write_model(tmp_path / "swung", four_bar(), SWUNG)
    return tmp_path / "swung"


def swept(models, out, workers, *sweep, **options):
    """A sweep, done."""
    suite = plan_suite([str(model) for model in models], out, parse_axes(sweep))
    carry_out(suite, workers, **options)
    return suite


def runs(suite, key, solver):
    """Value of the key → row of the solver's run."""
    return {row["point"][key]: row for row in suite.document()["runs"] if row["solver"] == solver}


def untimed(suite):
    return [{**row, **dict.fromkeys(TIMING_FIGURES)} for row in suite.document()["runs"]]


def files(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


# What is asked for.


@pytest.mark.parametrize(
    ("text", "whole", "values"),
    [
        ("timestep=5e-4:4e-3:4", False, [5e-4, 1e-3, 2e-3, 4e-3]),
        ("timestep=4e-3:1e-3:3", False, [4e-3, 2e-3, 1e-3]),
        ("solref=0.01:0.01:1", False, [0.01]),
        (" solref = 0.01 : 0.1 : 2 ", False, [0.01, 0.1]),
        ("length=-1:1:5", False, [-1.0, -0.5, 0.0, 0.5, 1.0]),
        ("seed=1:10:10", True, [*range(1, 11)]),
        ("N=1:40:4", True, [1, 14, 27, 40]),
        ("N=1:3:10", True, [1, 2, 3]),
        ("N=3e0:3:1", True, [3]),
    ],
)
def test_values(text, whole, values):
    (axis,) = parse_axes([text])
    found = axis.values(whole=whole)
    assert found == values
    assert {type(value) for value in found} == {int if whole else float}


def test_ends_are_kept_and_between_them_names_are_short():
    (axis,) = parse_axes(["timestep=0.00012345678:0.0087654321:4"])
    first, *between, last = axis.values(whole=False)
    assert (first, last) == (0.00012345678, 0.0087654321)
    assert all(float(f"{value:.6g}") == value for value in between)
    assert np.diff(np.log([first, *between, last])) == pytest.approx(np.log(last / first) / 3, rel=1e-5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "expected key=a:b:n"),
        ("timestep", "expected key=a:b:n"),
        ("timestep=", "expected key=a:b:n"),
        ("=1:2:3", "expected key=a:b:n"),
        ("timestep=1e-3:2e-3", "expected key=a:b:n"),
        ("timestep=1e-3:2e-3:3:4", "expected key=a:b:n"),
        ("timestep=1e-3:x:3", "expected key=a:b:n"),
        ("timestep=1e-3:2e-3:2.5", "expected key=a:b:n"),
        ("timestep=1e-3:2e-3:0", "expected 1 to 1000"),
        ("timestep=1e-3:2e-3:-1", "expected 1 to 1000"),
        ("timestep=1e-3:2e-3:1001", "expected 1 to 1000"),
        ("timestep=1e-3:2e-3:1", "1 point from 0.001 to 0.002, expected 1 where they are the same"),
        ("timestep=1e-3:1e-3:2", "2 points from 0.001 to 0.001"),
        ("timestep=0:1e-3:2", "expected numbers > 0"),
        ("solref=-100:-10:3", "expected numbers > 0"),
        ("timestep=nan:1e-3:2", "finite"),
        ("timestep=1e-3:inf:2", "finite"),
        ("N=-1e308:1e308:2", "finite"),
        ("seed=0.5:3:2", "expected whole numbers"),
        ("seed=-1:3:3", "expected seeds ≥ 0"),
        ("seed=1:1e300:3", "expected whole numbers"),
    ],
)
def test_mistakes_are_named(text, said):
    with pytest.raises(InputError) as caught:
        parse_axes([text])
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_key_is_there_once():
    with pytest.raises(InputError, match="timestep is given twice"):
        parse_axes(["timestep=1e-3:2e-3:2", "timestep=1e-3:3e-3:2"])


def test_keys_that_no_model_has():
    with pytest.raises(
        InputError, match=r"unknown key of --sweep 'M', expected one of: timestep, solref, seed, N, con"
    ):
        plan_suite(["n_four_bar", "boat"], Path("nowhere"), parse_axes(["M=1:2:2"]))
    with pytest.raises(InputError, match="no model here has N and bodies"):
        plan_suite(["n_four_bar", "ring"], Path("nowhere"), parse_axes(["N=1:2:2", "bodies=3:4:2"]))
    with pytest.raises(InputError, match="N is a whole number"):
        plan_suite(["n_four_bar"], Path("nowhere"), parse_axes(["N=1:2.5:3"]))
    assert not Path("nowhere").exists()


def test_too_many_runs():
    axes = parse_axes(["seed=1:500:500", "timestep=1e-3:2e-3:2"])
    with pytest.raises(InputError, match=r"the sweep of 'boat' has [0-9],000 runs, expected at most 1,000"):
        plan_suite(["boat"], Path("nowhere"), axes)
    assert MAX_UNITS == 1000


def test_models_without_the_parameter_are_skipped_and_variants_are_swept_once():
    suite = plan_suite(["n_four_bar", "boat"], Path("nowhere"), parse_axes(["N=1:3:3"]))
    assert [member.name for member in suite.members] == ["n_four_bar", "n_four_bar:connects=2"]
    assert suite.skipped == {"boat": ["N"]}
    suite = plan_suite(["n_four_bar"], Path("nowhere"), parse_axes(["timestep=1e-3:2e-3:2"]))
    assert len(suite.members) == 5


def test_the_runs_of_a_point(swung, tmp_path):
    """MuJoCo, and the solvers that the case runs freely on exact constraints; auto where it names none."""
    names = [unit.name for unit in plan_suite([str(swung)], tmp_path, parse_axes(["seed=3:4:2"])).members[0].units]
    runs = ["free-mujoco-rk4", "free-hard-cholesky-rk4"]
    assert names == [f"{run}-at-seed={seed}" for seed in (3, 4) for run in runs]
    bare = load_case(write_model(tmp_path / "bare", four_bar()))
    assert [str(task.solvers[0]) for task in tasks_of(bare)] == ["mujoco", "auto"]
    euler = SWUNG.replace('stabilisation = "baumgarte"', "integrator = 'euler'\nstabilisation = 'projection'")
    (swung / "case.toml").write_text(euler)
    assert {(task.integrator, task.stabilisation) for task in tasks_of(load_case(swung))} == {("euler", "projection")}


def test_a_point_changes_the_digest_and_the_case(tmp_path):
    case = load_case("n_four_bar")
    axes = parse_axes(["N=1:3:3", "seed=1:2:2"])
    units = plan_sweep("n_four_bar", case, axes, tasks_of(case))
    assert len(units) == 6 * len(tasks_of(case)) == len({unit.digest for unit in units})
    assert {unit.digest for unit in units} == {expected_digest(unit, case) for unit in units}
    assert folder_name(axes) == "sweep-N-seed"
    many = Point((("N", 40), ("timestep", 1e-3))).of(case)
    assert (many.name, many.file.run, many.file.published) == ("n_four_bar:N=40", case.file.run, [])
    assert load_case("n_four_bar:N=40").file.published
    assert many.truth_path != case.truth_path
    assert OWN.of(case) is case


# What the runs show.


def test_drift_over_the_timestep(swung, tmp_path, workers):
    """Ours is Runge–Kutta's error, of order four; MuJoCo's is its softness, which no timestep cures."""
    suite = swept([swung], tmp_path / "out", workers, "timestep=5e-4:4e-3:4")
    ours, theirs = runs(suite, "timestep", "cholesky"), runs(suite, "timestep", "mujoco")
    assert [row["timestep_s"] for row in ours.values()] == list(ours) == [5e-4, 1e-3, 2e-3, 4e-3]
    assert [row["steps"] for row in ours.values()] == [400, 200, 100, 50]
    for finer, coarser in itertools.pairwise(ours):
        ratio = ours[coarser]["drift_pos_max"] / ours[finer]["drift_pos_max"]
        assert RK4_ORDER_LOW < ratio < RK4_ORDER_HIGH
        same = theirs[coarser]["drift_pos_max"] / theirs[finer]["drift_pos_max"]
        assert same == pytest.approx(1.0, rel=SOFTNESS_ALONE)


def test_drift_over_the_timestep_of_euler(swung, tmp_path, workers):
    (swung / "case.toml").write_text(SWUNG.replace("duration_s", "integrator = 'euler'\nduration_s"))
    suite = swept([swung], tmp_path / "out", workers, "timestep=1e-3:4e-3:3")
    ours, theirs = runs(suite, "timestep", "cholesky"), runs(suite, "timestep", "mujoco")
    for finer, coarser in itertools.pairwise(ours):
        assert EULER_ORDER_LOW < ours[coarser]["drift_pos_max"] / ours[finer]["drift_pos_max"] < EULER_ORDER_HIGH
        assert theirs[coarser]["drift_pos_max"] > theirs[finer]["drift_pos_max"]


def test_drift_over_the_time_constant(swung, tmp_path, workers):
    """MuJoCo's falls with it; exact constraints know none, so that ours is the same run every time."""
    suite = swept([swung], tmp_path / "out", workers, "solref=5e-3:8e-2:3")
    ours, theirs = runs(suite, "solref", "cholesky"), runs(suite, "solref", "mujoco")
    drifts = [row["drift_pos_max"] for row in theirs.values()]
    assert drifts == sorted(drifts)
    assert drifts[-1] > 10 * drifts[0]
    assert len({row["drift_pos_max"] for row in ours.values()}) == 1
    assert len({row["trajectory_diff_max"] for row in ours.values()}) == 3


def test_starts_over_seeds(swung, tmp_path, workers):
    suite = swept([swung], tmp_path / "out", workers, "seed=1:3:3")
    rows = suite.document()["runs"]
    assert {row["status"] for row in rows} == {"done"}
    assert len({row["closing_moved"] for row in rows}) == 3
    assert all(row["closing_moved"] > CLOSED for row in rows)
    assert len({row["drift_pos_max"] for row in rows}) == 6
    assert untimed(swept([swung], tmp_path / "again", workers, "seed=1:3:3")) == untimed(suite)
    third = only(untimed(swept([swung], tmp_path / "one", workers, "seed=3:3:1")), solver="mujoco")
    assert third == untimed(suite)[4]


def short_n_four_bar(folder):
    """The model with a truth for N = 1, 2, 10 and 40, for twenty steps."""
    shutil.copytree(MODELS / "n_four_bar", folder)
    head = (folder / "case.toml").read_text(encoding="utf-8").partition("[[experiments]]")[0]
    own = '[[experiments]]\nmode = "free"\nsolvers = ["mujoco", "cholesky"]\n'
    (folder / "case.toml").write_text(head.replace("duration_s = 10.0", "duration_s = 0.02") + own)
    return folder


def test_a_parameter_of_the_model(tmp_path, workers):
    folder = short_n_four_bar(tmp_path / "loops")
    suite = swept([folder], tmp_path / "out", workers, "N=1:3:7")
    ours = runs(suite, "N", "cholesky")
    assert list(ours) == [1, 2, 3]
    for N, row in ours.items():
        assert [row[name] for name in ("nv", "rows", "rank", "dof", "rank_max")] == [2 * N + 1, 3 * N, 2 * N, 1, 2 * N]
        assert row["case"] == ("loops" if N == 2 else f"loops:N={N}")
        assert (row["truth_error_max"] is None) == (N == 3)


def test_a_grid(swung, tmp_path, workers):
    axes = ["timestep=2e-3:4e-3:2", "seed=1:2:2"]
    suite = swept([swung], tmp_path / "out", workers, *axes)
    points = [tuple(row["point"].values()) for row in suite.document()["runs"] if row["solver"] == "mujoco"]
    assert points == [(1, 2e-3), (1, 4e-3), (2, 2e-3), (2, 4e-3)]
    assert swept([swung], tmp_path / "out", workers, *reversed(axes)).repeated == 0


# What it leaves.


def test_a_sweep_is_resumed(swung, tmp_path, workers):
    out = tmp_path / "out"
    assert swept([swung], out, workers, "seed=1:3:3").repeated == 6
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
    again = swept([swung], out, workers, "seed=1:3:3")
    assert (again.repeated, status_of(again)) == (0, 0)
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == before
    assert swept([swung], out, workers, "seed=1:4:4").repeated == 2
    assert swept([swung], out, workers, "solref=0.01:0.02:2").repeated == 4
    assert swept([swung], out, workers, "seed=1:4:4").repeated == 0
    assert swept([swung], out, workers, "seed=1:4:4", fresh=True).repeated == 8
    (swung / "case.toml").write_text(SWUNG.replace("0.2", "0.1"))
    assert swept([swung], out, workers, "seed=1:2:2").repeated == 4


def test_neither_knows_of_the_other(swung, tmp_path, workers):
    """The case's own units survive a sweep, a sweep survives them, and no row of one gets among those of the other."""
    out = tmp_path / "out"
    own = swept([swung], out, workers)
    assert own.repeated == 2
    before = files(out)
    sweep = swept([swung], out, workers, "timestep=2e-3:4e-3:2")
    assert sweep.repeated == 4
    assert {path: content for path, content in files(out).items() if path in before} == before
    new = {str(path.relative_to(out / "swung")) for path in set(files(out)) - set(before)}
    assert new == {f"sweep-timestep/{name}" for name in ("units.json", "summary.json", "sweep.csv")}
    both = files(out)
    again = swept([swung], out, workers)
    assert again.repeated == 0
    assert files(out) == both
    assert "sweep" not in again.document()
    assert {row["timestep_s"] for row in again.document()["runs"]} == {2e-3}
    assert len(Ledger.read(out / "swung").rows()) == 2
    assert Ledger.read(out / "swung").rows(sweep=True) == []
    assert swept([swung], out, workers, "timestep=2e-3:4e-3:2").repeated == 0


def test_gates_and_published_values_are_for_the_cases_own(swung, tmp_path, workers):
    gate = '[[gates]]\nfigure = "drift_pos_max"\nmax = 1e-30\ncause = "none"\n'
    published = '[[published]]\njoint = "crank"\ntime_s = 0.1\nposition = 0.5\nsource = "none"\n'
    (swung / "case.toml").write_text(SWUNG + gate + published)
    own = swept([swung], tmp_path / "out", workers)
    assert status_of(own) == 1
    assert all(row["published_position_error_max"] is not None for row in own.document()["runs"])
    sweep = swept([swung], tmp_path / "out", workers, "timestep=1e-3:2e-3:2")
    assert status_of(sweep) == 0
    assert sweep.document()["gates"] == []
    assert all(row["published_position_error_max"] is None for row in sweep.document()["runs"])


def test_the_table_is_tidy(swung, tmp_path, workers):
    suite = swept([swung], tmp_path / "out", workers, "timestep=2e-3:4e-3:2", "seed=1:2:2")
    text = (tmp_path / "out" / "swung" / "sweep-seed-timestep" / "sweep.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    assert list(rows[0])[:6] == ["seed", "timestep", "run", "nv", "rows", "rank"]
    for row, found in zip(rows, suite.document()["runs"], strict=True):
        assert {key: float(row[key]) for key in found["point"]} == found["point"]
        assert (row["run"], float(row["drift_pos_max"])) == (found["run"], found["drift_pos_max"])


# What fails.


def made(folder, body):
    """A case with the parameters N, steps and reach whose ``build`` begins with ``body``."""
    parameters = "[parameters]\nN = 1\nsteps = 1\nreach = 0.7\n"
    write_model(folder, four_bar(), SWUNG.replace('title = "swung"\n', f'title = "made"\n{parameters}'))
    (folder / "model.xml").unlink()
    text = four_bar(pivot="REACH 0 0")
    (folder / "model.py").write_text(
        f"import os, signal, mujoco\ndef build(N, steps, reach):\n    {body}\n"
        f"    return mujoco.MjSpec.from_string({text!r}.replace('REACH', repr(reach)))\n"
    )
    return folder


def test_a_start_that_cannot_be_closed_is_refused_and_the_others_go_on(tmp_path, workers):
    suite = swept([made(tmp_path / "far", "pass")], tmp_path / "out", workers, "reach=0.7:2.7:3")
    document = suite.document()
    assert list(runs(suite, "reach", "mujoco")) == [0.7]
    assert [failure["unit"] for failure in document["failures"]] == [
        f"free-{who}-rk4-at-reach={reach}" for reach in (1.7, 2.7) for who in ("mujoco", "hard-cholesky")
    ]
    assert all("cannot be closed" in failure["message"] for failure in document["failures"])
    assert status_of(suite) == 2
    folder = tmp_path / "out" / "far" / "sweep-reach"
    rows = list(csv.DictReader((folder / "sweep.csv").read_text(encoding="utf-8").splitlines()))
    assert [(row["reach"], row["status"]) for row in rows[2:]] == [
        (reach, "refused") for reach in ("1.7", "2.7") for _ in range(2)
    ]
    page = (write_sweep_report(folder, tmp_path / "page") / "README.md").read_text(encoding="utf-8")
    assert "4 more could not be made" in page
    assert page.count("cannot be closed") == 4


def test_a_killed_worker_takes_only_its_point(tmp_path, workers):
    folder = made(tmp_path / "killer", "N == 2 and os.kill(os.getpid(), signal.SIGKILL)")
    suite = swept([folder], tmp_path / "out", workers, "N=1:3:3")
    assert list(runs(suite, "N", "mujoco")) == list(runs(suite, "N", "cholesky")) == [1, 3]
    failures = suite.document()["failures"]
    assert len(failures) == 2
    assert all("SIGKILL, twice" in failure["message"] for failure in failures)
    assert status_of(suite) == 1


def test_nothing_but_failures(tmp_path, workers):
    suite = swept([made(tmp_path / "none", "raise ValueError('no')")], tmp_path / "out", workers, "steps=1:2:2")
    assert len(suite.document()["failures"]) == 4
    folder = tmp_path / "out" / "none" / "sweep-steps"
    assert len((folder / "sweep.csv").read_text(encoding="utf-8").splitlines()) == 5
    assert "0 runs; 4 more" in (write_sweep_report(folder, tmp_path / "page") / "README.md").read_text(encoding="utf-8")


def test_a_parameter_with_the_name_of_a_column(tmp_path, workers):
    swept([made(tmp_path / "named", "pass")], tmp_path / "out", workers, "steps=1:2:2")
    text = (tmp_path / "out" / "named" / "sweep-steps" / "sweep.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    assert [(row["swept steps"], row["steps"]) for row in rows] == [(value, "100") for value in "1122"]


def test_a_run_that_diverges_is_a_row(swung, tmp_path, workers):
    """Euler's steps of a twentieth of a second blow both up."""
    stiff = SWUNG.replace("0.2", "2.0").replace("[start]", "integrator = 'euler'\n[baumgarte]\nbeta = 50\n[start]")
    (swung / "case.toml").write_text(stiff)
    suite = swept([swung], tmp_path / "out", workers, "timestep=1e-3:0.05:2")
    document = suite.document()
    assert [(row["timestep_s"], row["status"] == "diverged") for row in document["runs"]] == [
        (timestep_s, lost) for timestep_s, lost in ((1e-3, False), (0.05, True)) for _ in range(2)
    ]
    assert (document["failures"], status_of(suite)) == ([], 0)
    folder = tmp_path / "out" / "swung" / "sweep-timestep"
    page = (write_sweep_report(folder, tmp_path / "page") / "README.md").read_text(encoding="utf-8")
    assert "2 of which diverged" in page


def test_a_timestep_longer_than_the_run(swung, tmp_path, workers):
    suite = swept([swung], tmp_path / "out", workers, "timestep=2e-3:0.5:2")
    assert list(runs(suite, "timestep", "mujoco")) == [2e-3]
    failures = suite.document()["failures"]
    assert len(failures) == 2
    assert all("longer than the duration of 0.2 s" in failure["message"] for failure in failures)


# The page and the command.


def test_the_page(tmp_path, workers):
    folder = short_n_four_bar(tmp_path / "loops")
    swept([folder], tmp_path / "out", workers, "timestep=1e-3:2e-3:2", "solref=1e-3:1e-2:2")
    results = tmp_path / "out" / "loops" / "sweep-solref-timestep"
    target = write_sweep_report(results, tmp_path / "page")
    first = files(target)
    names = {str(path.relative_to(target)) for path in first}
    assert names == {
        "README.md", "index.html", "provenance.json", "figures/solref.svg", "figures/timestep.svg"
    }  # fmt: skip
    text = (target / "README.md").read_text(encoding="utf-8")
    assert text.count("\n| 0.0") == 8
    assert "MuJoCo takes no time constant below two timesteps" in text
    date = ResultFolder(results).read_json("summary.json")["provenance"]["date"]
    assert date not in text
    for name in ("drift", "from truth", "iterations a solve", "1e-3"):
        assert name in (target / "figures" / "timestep.svg").read_text(encoding="utf-8")
    html = (target / "index.html").read_text(encoding="utf-8")
    assert "chart-timestep-time" in html
    assert date in html
    write_sweep_report(results, target)
    assert files(target) == first


def test_command(swung, oarlock_here, tmp_path):
    options = ["--out", "out", "--jobs", "1"]
    finished = oarlock_here("suite", swung, *options, "--sweep", "seed=1:2:2", "--json", "-")
    assert finished.returncode == 0, finished.stderr
    document = json.loads(finished.stdout)
    assert document["sweep"] == [{"key": "seed", "first": 1.0, "last": 2.0, "count": 2, "spacing": "linear"}]
    assert [row["point"]["seed"] for row in document["runs"]] == [1, 1, 2, 2]
    assert "swung free-mujoco-rk4-at-seed=1" in finished.stderr
    assert "table: out/swung/sweep-seed/sweep.csv" in finished.stderr
    report = tmp_path / "out" / "report"
    assert {path.name for path in report.iterdir()} == {"swung-sweep-seed"}
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    again = oarlock_here("suite", swung, *options, "--sweep", "seed=1:2:2")
    assert "4 of 4 kept" in again.stderr
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()} == before


def test_command_says_what_is_wrong(swung, oarlock_here, tmp_path):
    for sweep, said in (("tiemstep=1e-3:2e-3:2", "expected one of: timestep"), ("timestep=1e-3", "key=a:b:n")):
        finished = oarlock_here("suite", swung, "--out", "out", "--sweep", sweep)
        assert (finished.returncode, finished.stdout) == (2, "")
        (line,) = finished.stderr.splitlines()
        assert line.startswith("oarlock: ")
        assert said in line
    assert not (tmp_path / "out").exists()


def test_command_says_what_is_skipped(swung, oarlock_here, tmp_path):
    folder = short_n_four_bar(tmp_path / "loops")
    finished = oarlock_here("suite", swung, folder, "--out", "out", "--jobs", "1", "--sweep", "N=1:1:1")
    assert finished.returncode == 0, finished.stderr
    assert "oarlock: skipped: swung has no parameter N\n" in finished.stderr
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"loops", "report", "pages.json"}
