"""oarlock diff: which run is which, what counts as a change, which way is worse."""

import math
import shutil
from pathlib import Path

import oarlock
import polars as pl
import pytest
from oarlock.base.errors import InputError
from oarlock.compare.folders import KEYS, Run, match, read_side
from oarlock.compare.tolerances import FIGURES, tolerance_of
from oarlock.tables.folder import ResultFolder
from oarlock.tables.tolerances import Tolerance
from pairs import edit, exact, rewrite, set_figure
from places import REPOSITORY
from tolerances import RK4_ORDER_HIGH, RK4_ORDER_LOW

# Tolerances.


TOLERANCE = Tolerance("drift", "smaller", 0.01, 1e-12, "test")


@pytest.mark.parametrize(
    ("before", "after", "verdict"),
    [
        (1e-4, 1.005e-4, "same"),
        (1e-4, 1.02e-4, "worse"),
        (1e-4, 0.98e-4, "better"),
        (1e-15, 9e-13, "same"),  # both are rounding
        (9e-13, 1e-15, "same"),
        (1e-15, 2e-12, "worse"),
        (2e-12, 0.0, "better"),
        (0.0, 0.0, "same"),
        (1e-4, math.inf, "worse"),
    ],
)
def test_a_tolerance(before, after, verdict):
    assert TOLERANCE.verdict(before, after) == verdict


def test_whole_numbers_that_may_not_change():
    kind = FIGURES["rank_max"]
    assert [kind.verdict(4, after) for after in (4, 5, 3, 0)] == ["same", "changed", "changed", "changed"]
    assert kind.verdict(0, 0) == "same"
    assert kind.verdict(0, 1) == "changed"


def test_every_figure_of_a_summary_has_a_kind(results):
    """A new figure needs a tolerance and a direction, or would only ever be "changed"."""
    rows = ResultFolder(results).read_json("summary.json")["runs"]
    others = {*KEYS, "message", "solves"}
    assert set(rows[0]) - others <= set(FIGURES)
    for name, kind in FIGURES.items():
        assert kind.cause, name
        assert kind.relative >= 0 <= kind.floor, name


@pytest.mark.parametrize(
    ("form", "mode", "better"),
    [("matched", "lockstep", "smaller"), ("hard", "lockstep", "neither"), (None, "calibration", "smaller")],
)
def test_how_far_exact_constraints_are_from_mujoco_is_no_fault(form, mode, better):
    row = {"form": form, "mode": mode, "status": "done"}
    for figure in ("qacc_rel_diff_max", "trajectory_diff_max"):
        assert tolerance_of(figure, row, row).better == better


def test_of_two_runs_that_diverge_the_longer_one_is_better():
    row = {"form": "hard", "mode": "free", "status": "diverged"}
    assert tolerance_of("steps_done", row, row).better == "larger"
    assert tolerance_of("steps_done", {**row, "status": "done"}, row).better == "neither"


# Which run is which.


def run_of(**changes) -> Run:
    row = {key: None for key in KEYS} | {"case": "c", "mode": "free", "solver": "pinv", "timestep_s": 1e-3, "steps": 9}
    return Run(row | {"stepping": "native", "integrator": "rk4", "run": "x", "status": "done"} | changes, None)  # pyright: ignore


def names(runs):
    return [run.row["run"] for run in runs]


def test_a_run_finds_its_like_first():
    before = [run_of(run="fine", timestep_s=1e-3), run_of(run="coarse", timestep_s=2e-3)]
    after = [run_of(run="COARSE", timestep_s=2e-3), run_of(run="FINE", timestep_s=1e-3)]
    pairs, gone, new = match(before, after)
    assert {(one.row["run"], other.row["run"]) for one, other in pairs} == {("fine", "FINE"), ("coarse", "COARSE")}
    assert gone == new == []


@pytest.mark.parametrize(
    "changes",
    [
        {"stepping": "python"},
        {"steps": 10},
        {"timestep_s": 2e-3, "steps": 5},
        {"integrator": "euler"},
        {"stabilisation": "projection"},
        {"case": "other"},
    ],
)
def test_the_only_other_run_is_the_counterpart(changes):
    pairs, gone, new = match([run_of()], [run_of(**changes)])
    assert (len(pairs), gone, new) == (1, [], [])


@pytest.mark.parametrize("changes", [{"solver": "sr1"}, {"form": "matched"}, {"mode": "lockstep"}, {"settings": "s"}])
def test_another_question_is_no_counterpart(changes):
    pairs, gone, new = match([run_of(run="a")], [run_of(run="b", **changes)])
    assert (pairs, names(gone), names(new)) == ([], ["a"], ["b"])


def test_points_of_sweeps_are_kept_apart():
    row = run_of().row
    sides = []
    for _ in range(2):
        points = [Run(row, None, point, sweep) for sweep in ("", "sweep-N") for point in ("N=1", "N=2")]  # pyright: ignore
        sides.append([*points, run_of()])
    pairs, gone, new = match(*sides)
    assert (len(pairs), gone, new) == (5, [], [])
    assert all((one.point, one.sweep) == (other.point, other.sweep) for one, other in pairs)
    _, gone, new = match(sides[0][:1], sides[1][1:2])
    assert (len(gone), len(new)) == (1, 1)


def test_no_guess_between_two():
    pairs, gone, new = match([run_of()], [run_of(timestep_s=2e-3), run_of(timestep_s=4e-3)])
    assert (pairs, len(gone), len(new)) == ([], 1, 2)


def test_another_case_is_none_where_there_are_several():
    before = [run_of(case="one"), run_of(case="two")]
    pairs, gone, new = match(before, [run_of(case="three")])
    assert (pairs, len(gone), len(new)) == ([], 2, 1)


# What changed.


def test_the_same_is_the_same(pair):
    found = oarlock.diff(*pair)
    assert found.changes == found.worse == found.origins == []
    assert found.matched == 3
    assert found.counts["same"] > 20
    assert {one.figure for one in found.comparisons if one.verdict == "not judged"} == {
        "solve_ns_median",
        "step_us_median",
    }
    assert found.timings == {"solve_ns_median": 1.0, "step_us_median": 1.0}


@pytest.mark.parametrize(
    ("figure", "factor", "verdict"),
    [
        ("drift_pos_max", 2.0, "worse"),
        ("drift_pos_max", 0.5, "better"),
        ("energy_drift_rel", 3.0, "worse"),
        ("qacc_rel_diff_max", None, None),
        ("rank_max", 2, "changed"),
        ("drift_pos_max", 1.001, None),
    ],
)
def test_the_direction(pair, figure, factor, verdict):
    before = exact(ResultFolder(pair[0]).read_json("summary.json"))[figure]
    set_figure(pair[1], **{figure: before if factor is None else before * factor})
    found = oarlock.diff(*pair)
    assert [(one.figure, one.verdict) for one in found.changes] == ([(figure, verdict)] if verdict else [])
    assert bool(found.worse) is (verdict == "worse")


def test_the_worst_comes_first_and_with_its_moment(pair):
    row = exact(ResultFolder(pair[0]).read_json("summary.json"))
    drift, energy = row["drift_pos_max"], row["energy_drift_rel"]
    set_figure(pair[1], drift_pos_max=3 * drift, energy_drift_rel=30 * energy, status="diverged")
    found = oarlock.diff(*pair)
    assert [one.figure for one in found.worse] == ["status", "energy_drift_rel", "drift_pos_max"]
    steps = ResultFolder(pair[1]).read_steps(row["run"])
    assert found.worse[-1].time_s == steps["time_s"].to_numpy()[steps["drift_pos"].to_numpy().argmax()]
    assert found.worse[-1].factor == pytest.approx(3)


@pytest.mark.parametrize(
    ("before", "after", "verdict"),
    [
        ("done", "unconverged", "worse"),
        ("done", "diverged", "worse"),
        ("unprojected", "diverged", "worse"),
        ("diverged", "done", "better"),
        ("unconverged", "unprojected", "changed"),
    ],
)
def test_status(pair, before, after, verdict):
    set_figure(pair[0], status=before)
    set_figure(pair[1], status=after)
    (change,) = oarlock.diff(*pair).changes
    assert (change.figure, change.before, change.after, change.verdict) == ("status", before, after, verdict)


def test_a_figure_that_is_no_longer_measured(pair):
    set_figure(pair[1], drift_pos_max=None)
    (change,) = oarlock.diff(*pair).changes
    assert (change.verdict, change.after) == ("disappeared", None)
    assert oarlock.diff(*pair).worse
    assert not oarlock.diff(*pair, allow_missing=True).worse
    assert [one.verdict for one in oarlock.diff(pair[1], pair[0]).changes] == ["appeared"]
    assert not oarlock.diff(pair[1], pair[0]).worse


def test_a_run_that_is_gone(pair):
    edit(pair[1], lambda document: document["runs"].remove(exact(document)))
    found = oarlock.diff(*pair)
    assert [(one.verdict, one.group) for one in found.changes] == [("disappeared", "run")]
    assert found.matched == 2
    assert found.worse
    assert not oarlock.diff(*pair, allow_missing=True).worse
    assert [one.verdict for one in oarlock.diff(pair[1], pair[0]).changes] == ["appeared"]


@pytest.mark.parametrize(
    ("change", "verdict", "said"),
    [
        ({"held": False, "value": 1e-3}, "worse", ("held", "failed")),
        ({"max": 1e-2}, "changed", ("max 1e-06", "max 0.01")),
        ({"held": None, "run": None, "value": None}, "disappeared", ("held", None)),
    ],
)
def test_gates(pair, change, verdict, said):
    edit(pair[1], lambda document: document["gates"][0].update(change))
    first = oarlock.diff(*pair).changes[0]
    assert (first.verdict, first.group, (first.before, first.after)) == (verdict, "gate", said)


def test_a_gate_that_holds_again(pair):
    edit(pair[0], lambda document: document["gates"][0].update(held=False))
    assert [one.verdict for one in oarlock.diff(*pair).changes] == ["better"]


def test_gates_that_were_not_checked_on_either_side_are_no_change(pair):
    edit(pair[0], lambda document: document["gates"].clear())
    edit(pair[1], lambda document: document["gates"][0].update(held=None, run=None, value=None))
    assert oarlock.diff(*pair).changes == []


def test_timings_are_judged_on_request(pair):
    before = exact(ResultFolder(pair[0]).read_json("summary.json"))["step_us_median"]
    set_figure(pair[1], step_us_median=3 * before)
    assert oarlock.diff(*pair).changes == []
    assert oarlock.diff(*pair, timings=4.0).changes == []
    (change,) = oarlock.diff(*pair, timings=2.0).worse
    assert (change.figure, change.group) == ("step_us_median", "timing")
    for factor in (1.0, 0.0, -2.0, math.nan, math.inf):
        with pytest.raises(InputError, match="expected a factor > 1"):
            oarlock.diff(*pair, timings=factor)


def test_trajectories_that_part(pair):
    """A change is said with the first moment beyond rounding, and is no loss."""
    run = exact(ResultFolder(pair[0]).read_json("summary.json"))["run"]
    path = ResultFolder(pair[1]).steps_path(run)
    moved = pl.when(pl.col("time_s") >= 0.05).then(pl.col("qpos").list.eval(pl.element() + 1e-6)).otherwise("qpos")
    rewrite(pair[1], run, pl.read_parquet(path).with_columns(qpos=moved))
    found = oarlock.diff(*pair)
    (change,) = found.changes
    assert (change.figure, change.verdict, found.worse) == ("qpos_apart_max", "changed", [])
    assert change.after == pytest.approx(1e-6)
    assert change.time_s == pytest.approx(0.05)


def test_what_differs_in_where_they_come_from(pair):
    def other(document):
        document["provenance"].update(mujoco="3.3.0", platform="Darwin arm64", date="1999", commit="abc")
        for row in document["runs"]:
            row.update(timestep_s=2 * row["timestep_s"])

    edit(pair[1], other)
    case = ResultFolder(pair[1]).read_json("case.json")
    case["run"]["duration_s"], case["model"]["closing_moved"] = 7.0, case["model"]["closing_moved"] + 1e-15
    ResultFolder(pair[1]).write_json("case.json", case)
    found = oarlock.diff(*pair)
    assert [(origin.kind, origin.key, origin.after) for origin in found.origins] == [
        ("provenance", "mujoco", "3.3.0"),
        ("provenance", "platform", "Darwin arm64"),
        ("case", "run.duration_s", 7.0),
        ("run", "timestep_s", 0.004),
    ]
    assert found.origins[-1].line(found.matched) == "timestep_s: 0.002 → 0.004 (every run)"
    assert found.changes == []


def test_two_timesteps_for_real(results, tmp_path):
    """The drift of exact constraints under Runge–Kutta grows with the fourth power of the timestep."""
    case = results.parent / "tiny"
    for name, timestep in (("fine", 1e-3), ("coarse", 4e-3)):
        oarlock.run(case, mode="free", form="hard", solver=["pinv", "mujoco"], timestep=timestep, out=tmp_path / name)
    found = oarlock.diff(tmp_path / "fine", tmp_path / "coarse")
    assert found.matched == 3
    (drift,) = [one for one in found.worse if (one.run, one.figure) == ("free-hard-pinv-rk4", "drift_pos_max")]
    assert RK4_ORDER_LOW**2 <= (drift.factor or 0) <= RK4_ORDER_HIGH**2
    assert found.worse[0].run == "free-hard-pinv-rk4"
    back = oarlock.diff(tmp_path / "coarse", tmp_path / "fine")
    assert not [one for one in back.worse if one.run == "free-hard-pinv-rk4"]


# Folders.


def suite_of(results: Path, target: Path, *names: str) -> Path:
    for name in names:
        shutil.copytree(results, target / name)
        document = ResultFolder(target / name).read_json("summary.json")
        document["provenance"]["case"] = name
        for row in document["runs"]:
            row["case"] = name
        ResultFolder(target / name).write_json("summary.json", document)
    return target


def test_a_folder_of_many_cases(results, tmp_path):
    one = suite_of(results, tmp_path / "one", "anvil", "bellows")
    two = suite_of(results, tmp_path / "two", "bellows", "chisel")
    found = oarlock.diff(one, two)
    assert found.matched == 3
    assert {one.case for one in found.changes if one.verdict == "disappeared"} == {"anvil"}
    assert {one.case for one in found.changes if one.verdict == "appeared"} == {"chisel"}


def test_the_pages_of_a_suite_are_no_results(results, tmp_path):
    """``oarlock suite`` writes them into the same folder, with the runs of all cases once more."""
    folder = suite_of(results, tmp_path / "out", "anvil")
    (folder / "report").mkdir()
    document = ResultFolder(folder / "anvil").read_json("summary.json")
    document["provenance"] = {"mujoco": "4.0.0", "cases": {"anvil": {}}}
    ResultFolder(folder / "report").write_json("summary.json", document)
    assert len(read_side(folder).runs) == 3
    assert len(read_side(folder / "report").runs) == 3
    assert oarlock.diff(folder, folder / "report").matched == 3


def test_a_published_summary_compares_with_itself():
    published = REPOSITORY / "reports"
    found = oarlock.diff(published, published)
    assert found.matched > 300
    assert found.changes == found.origins == []


def test_units_that_failed_are_worse_than_gone(results, tmp_path):
    one, two = suite_of(results, tmp_path / "one", "anvil"), suite_of(results, tmp_path / "two", "anvil")
    gone = exact(ResultFolder(two / "anvil").read_json("summary.json"))["run"]
    edit(two / "anvil", lambda document: document["runs"].remove(exact(document)))
    entry = {"digest": "", "status": "failed", "message": "killed", "seconds": 1.0, "point": {}, "rows": []}
    units = {gone: {**entry, "files": {}, "model": None}}
    ResultFolder(two / "anvil").write_json("units.json", {"case": "anvil", "refused": "", "units": units})
    (change,) = oarlock.diff(one, two, allow_missing=True).worse
    assert (change.before, change.after, change.cause) == ("done", "failed", "failed: killed")
    assert [change.verdict for change in oarlock.diff(two, one).changes] == ["better"]


def test_a_case_that_is_refused(results, tmp_path):
    one = suite_of(results, tmp_path / "one", "anvil", "bellows")
    two = suite_of(results, tmp_path / "two", "bellows")
    (two / "anvil").mkdir()
    ResultFolder(two / "anvil").write_json("units.json", {"case": "anvil", "refused": "no loop", "units": {}})
    worse = oarlock.diff(one, two, allow_missing=True).worse
    assert {(change.case, change.after) for change in worse if change.group == "status"} == {("anvil", "refused")}


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda folder: shutil.rmtree(folder), "no folder"),
        (lambda folder: (folder / "summary.json").unlink(), "no runs in"),
        (lambda folder: (folder / "summary.json").write_text("{"), "cannot be read"),
        (lambda folder: (folder / "summary.json").write_text("[]"), "holds no object"),
        (lambda folder: (folder / "summary.json").write_text('{"provenance": {}, "runs": 3, "gates": []}'), "no runs"),
        (lambda folder: edit(folder, lambda document: document.pop("gates")), "has no gates"),
        (lambda folder: edit(folder, lambda document: document["runs"].append(3)), "has a run without 'case'"),
        (lambda folder: edit(folder, lambda document: document["runs"][0].pop("solver")), "without 'solver'"),
        (lambda folder: edit(folder, lambda document: document["gates"][0].pop("held")), "without 'held'"),
        (lambda folder: set_figure(folder, novelty=1.0), "has no figure 'novelty'"),
        (lambda folder: edit(folder, lambda d: exact(d).pop("drift_vel_max")), "has no figure 'drift_vel_max'"),
        (
            lambda folder: [path.write_bytes(path.read_bytes()[:99]) for path in (folder / "steps").iterdir()],
            ".parquet' is not what was written with 'summary.json'",
        ),
    ],
)
def test_bad_folders_are_one_line(pair, oarlock_here, damage, said):
    damage(pair[1])
    for order in (pair, pair[::-1]):
        finished = oarlock_here("diff", *order)
        assert (finished.returncode, finished.stdout) == (2, "")
        (line,) = finished.stderr.splitlines()
        assert line.startswith("oarlock: ")
        assert said in line


def test_one_case_twice(results, tmp_path):
    shutil.copytree(results, tmp_path / "both" / "one")
    shutil.copytree(results, tmp_path / "both" / "two")
    with pytest.raises(InputError, match="holds results of 'tiny' twice"):
        oarlock.diff(results, tmp_path / "both")
