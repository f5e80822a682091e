"""Tables on disk and the summary: whole files only, one schema, figures that can be computed again."""

import dataclasses
import json
import math

import numpy as np
import polars as pl
import pytest
from mechanisms import boat_copy, four_bar, frames_of, only, write_model
from oarlock import InputError, load_case, run
from oarlock.base.arrays import largest, relative_difference
from oarlock.base.files import replacing, write_text
from oarlock.cases.judging import Gate
from oarlock.tables.aggregate import judge, summarise
from oarlock.tables.folder import ResultFolder
from oarlock.tables.schema import SCHEMA, RunKey, RunResult
from oarlock.tables.spool import Spool

KEY = RunKey("c", "free", "pinv", "pinv", "hard", "rk4", "default", "python", 1e-3, 3)
CONTRACT = {
    "case",
    "solver",
    "form",
    "mode",
    "integrator",
    "stepping",
    "timestep_s",
    "steps",
    "status",
    "iterations_mean",
    "iterations_max",
    "refreshes",
    "rank_min",
    "rank_max",
    "min_norm_error_max",
    "min_norm_error_median",
    "residual_rel_max",
    "inconsistency_max",
    "qacc_rel_diff_max",
    "qfrc_constraint_rel_diff_max",
    "drift_pos_max",
    "drift_vel_max",
    "drift_acc_max",
    "energy_drift_rel",
    "truth_error_max",
    "trajectory_diff_max",
    "solve_ns_median",
    "step_us_median",
}
"""The keys of design.md: extend, do not rename."""


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A short run in every mode, kept in a folder."""
    folder = tmp_path_factory.mktemp("kept")
    return run("boat", solver=["pinv", "sr1", "mujoco"], duration=0.02, out=folder), folder


def recorded(**columns):
    """A run of made-up steps."""
    steps = Spool(SCHEMA)
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    steps.append(pl.DataFrame(rows, schema=SCHEMA, strict=False))
    return RunResult(KEY, "done", "", steps)


# The summary.


def test_summary_keeps_the_contract(boat_run):
    assert set(boat_run.document) >= {"provenance", "runs"}
    assert len(boat_run.rows) == 47
    for row in boat_run.rows:
        assert set(row) >= CONTRACT
        assert row["steps"] == row["steps_done"] == 12_000
        numbers = [value for value in row.values() if isinstance(value, float)]
        assert all(math.isfinite(value) for value in numbers)


def test_what_does_not_apply_is_null(boat_run):
    mujoco = only(boat_run.rows, run="free-mujoco-rk4")
    given = {"case", "solver", "mode", "integrator", "stepping", "timestep_s", "steps", "status", "iterations_mean"}
    given |= {"iterations_max", "drift_pos_max", "drift_vel_max", "drift_acc_max", "truth_error_max", "step_us_median"}
    assert {name for name in CONTRACT if mujoco[name] is not None} == given


def test_summary_is_a_function_of_the_steps(boat_run):
    folder = ResultFolder(boat_run.folder)
    row = only(boat_run.rows, run="lockstep-hard-along-pinv-sr1-rk4")
    steps = folder.read_steps(row["run"])
    assert len(steps) == row["steps"]
    residual = np.array(steps["residual"].to_list())
    assert np.abs(residual).max() == row["drift_pos_max"]
    assert steps["solves"].to_list() == [1] * row["steps"]
    assert steps["iterations"].mean() == row["iterations_mean"]
    assert steps["min_norm_error"].median() == row["min_norm_error_median"]
    np.testing.assert_allclose(steps["time_s"], np.arange(12_000) * 1e-3, rtol=0, atol=1e-9)


def test_first_solve_is_no_refresh():
    assert summarise(recorded(solves=[1, 1, 1], iterations=[0, 2, 1], refreshes=[1, 0, 1]))["refreshes"] == 1
    assert summarise(recorded(solves=[4, 4, 4], iterations=[0, 8, 4], refreshes=[3, 0, 1]))["refreshes"] == 3
    assert summarise(recorded(solves=[1, 1], iterations=[0, 2], refreshes=[0, 0]))["refreshes"] == 0


def test_iterations_are_per_solve():
    row = summarise(recorded(solves=[4, 4], iterations=[4, 12], iterations_worst=[1, 5]))
    assert (row["iterations_mean"], row["iterations_max"]) == (2.0, 5)


def test_products_of_an_iteration_are_told_by_solves_that_differ():
    """Those that started anew or gave up are left out; where every solve has as many iterations, nothing is told."""
    told = {
        "solves": [1] * 5,
        "iterations": [1, 3, 8, 50, 2],
        "products": [5, 9, 19, 400, 90],
        "unconverged": [0, 0, 0, 1, 0],
        "refreshes": [0, 0, 0, 0, 1],
    }
    row = summarise(recorded(**told))
    assert row["products_mean"] == (5 + 9 + 19 + 400 + 90) / 5
    assert row["products_per_iteration"] == 2.0
    alike = {name: [values[0]] * 2 for name, values in told.items()}
    assert summarise(recorded(**alike))["products_per_iteration"] is None
    nothing = summarise(recorded(step=[0, 1]))
    assert [nothing[name] for name in ("products_mean", "products_per_iteration")] == [None, None]


def test_summary_of_projections():
    """Rounds are a step's, iterations a solve's; without projections there is nothing to report."""
    row = summarise(
        recorded(
            projection=["landed", "too-far", "open", "landed"],
            projection_rounds=[1, 0, 2, 1],
            projection_solves=[2, 1, 3, 4],
            projection_iterations=[4, 1, 0, 0],
            projection_moved=[1e-9, 0.0, 3e-9, 2e-9],
        )
    )
    assert row["unprojected"] == 2
    assert (row["projection_rounds_mean"], row["projection_rounds_max"]) == (1.0, 2)
    assert (row["projection_iterations_mean"], row["projection_moved_max"]) == (0.5, 3e-9)
    row = summarise(recorded(step=[0, 1]))
    names = ["unprojected", "projection_rounds_mean", "projection_rounds_max", "projection_iterations_mean"]
    assert [row[name] for name in (*names, "projection_moved_max")] == [None] * 5


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_summary_of_what_is_not_finite_is_null(bad):
    row = summarise(recorded(step=[0, 1], drift_pos=[bad, bad], drift_vel=[1.0, bad], truth_error=[None, None]))
    assert row["drift_pos_max"] is None
    assert row["truth_error_max"] is None
    json.dumps(row, allow_nan=False)


@pytest.mark.parametrize(
    ("value", "status", "held"),
    [(0.5, "done", True), (1.0, "done", True), (1.5, "done", False), (None, "done", False), (0.5, "diverged", False)],
)
def test_gates(value, status, held):
    case = load_case("boat")
    gate = Gate(figure="drift_pos_max", where={"mode": "free"}, max=1.0, cause="c")
    case.file = case.file.model_copy(update={"gates": [gate]})
    row = {"run": "r", "mode": "free", "status": status, "drift_pos_max": value}
    (verdict,) = judge(case, [row, {**row, "mode": "lockstep"}])
    assert (verdict.run, verdict.held) == ("r", held)
    assert "drift_pos_max" in verdict.line()
    assert "≤ 1" in verdict.line()
    (unchecked,) = judge(case, [{**row, "mode": "lockstep"}])
    assert unchecked.held is None
    (missed,) = judge(case, [{**row, "mode": "lockstep"}], complete=True)
    assert missed.held is False


def test_expectations_are_checked(tmp_path):
    folder = boat_copy(tmp_path / "boat", duration_s=0.002, experiments="[[experiments]]\nmode = 'calibration'\n")
    path = folder / "case.toml"
    path.write_text(path.read_text(encoding="utf-8").replace("rank = 4", "rank = 5"), encoding="utf-8")
    (failure,) = run(folder).failures
    assert (failure.gate.figure, failure.value, failure.run) == ("rank", 4, "start")


def test_figures_of_a_step():
    assert relative_difference(np.array([3.0, 4.0]), np.array([3.0, 0.0])) == 4 / 3
    assert relative_difference(np.array([3.0, 4.0]), np.zeros(2)) == 5.0  # absolute: nothing to relate to
    assert largest(np.array([1.0, -3.0, 2.0])) == 3.0
    assert largest(np.zeros(0)) == 0.0


# The tables.


def test_every_run_has_its_table_of_one_schema(kept):
    results, folder = kept
    files = {path.stem for path in (folder / "steps").iterdir()}
    assert files == {row["run"] for row in results.rows}
    assert len(files) == len(results.rows) == 14
    schemas = {str(ResultFolder(folder).read_steps(name).schema) for name in files}
    assert len(schemas) == 1
    assert results.steps.height == sum(row["steps_done"] for row in results.rows)
    assert set(SCHEMA) < set(results.steps.columns)
    assert results.summary["run"].to_list() == [row["run"] for row in results.rows]


def test_disk_holds_what_was_returned(kept):
    results, folder = kept
    for row, frame in zip(results.rows, frames_of(results), strict=True):
        assert ResultFolder(folder).read_steps(row["run"]).equals(frame, null_equal=True)
    document = ResultFolder(folder).read_json("summary.json")
    assert document == json.loads(json.dumps(results.kept()))
    assert sorted(document["files"]) == sorted(str(path.relative_to(folder)) for path in folder.rglob("*.parquet"))


def test_no_temporary_files_are_left(kept):
    assert [path for path in kept[1].rglob("*") if path.name.startswith(".")] == []


def test_runs_of_an_earlier_summary_are_forgotten(tmp_path):
    run("boat", mode="free", solver="mujoco", duration=0.002, out=tmp_path)
    run("boat", mode="lockstep", form="hard", solver="pinv", duration=0.002, out=tmp_path, replace=True)
    names = sorted(path.stem for path in (tmp_path / "steps").iterdir())
    assert names == ["calibration-mujoco-rk4", "lockstep-hard-along-mujoco-pinv-rk4"]


def test_file_names_tell_settings_apart(tmp_path):
    solvers = ["sr1", "sr1:eps_abs=1e-7", "sr1:eps_abs=1e-8", "sr1:eps_abs=1.0000001e-7"]
    results = run("boat", mode="lockstep", form="hard", solver=solvers, duration=0.002, out=tmp_path)
    assert len({row["run"] for row in results.rows}) == len(results.rows) == 5
    assert len(list((tmp_path / "steps").iterdir())) == 5
    assert not any(set(row["run"]) & set("/\\: ,=") for row in results.rows)


def test_names_of_settings_cannot_leave_the_folder(tmp_path):
    key = RunKey("../c", "free", "pinv", "pinv", "hard", "rk4", "../../etc/passwd", "python", 1e-3, 3)
    ResultFolder(tmp_path / "in").write_steps(RunResult(key, "done", "", Spool(SCHEMA)))
    assert [path.parent for path in tmp_path.rglob("*.parquet")] == [tmp_path / "in" / "steps"]


def test_file_names_tell_stabilisations_apart_and_keep_quiet_about_the_default():
    keys = [dataclasses.replace(KEY, stabilisation=how) for how in (None, "baumgarte", "projection", "both")]
    names = [key.slug for key in keys]
    assert names == ["free-hard-pinv-rk4"] * 2 + ["free-hard-pinv-projection-rk4", "free-hard-pinv-both-rk4"]


def test_nothing_is_written_without_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    results = run(write_model(tmp_path / "bar", four_bar()), mode="free", duration=0.01)
    assert [path.name for path in tmp_path.iterdir()] == ["bar"]
    assert isinstance(results.steps, pl.DataFrame)


# Failures.


def test_a_write_that_fails_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "old")

    def interrupted():
        with replacing(path) as temporary:
            temporary.write_text("half of the n")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_in_place_of_the_folder(tmp_path):
    target = tmp_path / "taken"
    target.write_text("mine")
    with pytest.raises(InputError, match=r"cannot write '.*taken"):
        run("boat", mode="free", solver="mujoco", duration=0.002, out=target)
    assert target.read_text() == "mine"


@pytest.mark.parametrize("content", [None, "", "{", '{"runs": NaN', "\xff"])
def test_unreadable_summaries_are_named(tmp_path, content):
    if content is not None:
        (tmp_path / "summary.json").write_bytes(content.encode("latin-1"))
    with pytest.raises(InputError, match=r"summary\.json"):
        ResultFolder(tmp_path).read_json("summary.json")
