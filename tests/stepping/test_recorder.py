"""Rows on their way into a table: whole steps only, and figures that do not know of blocks."""

import numpy as np
import oarlock.stepping.recorder
import pytest
from mechanisms import setup_of
from oarlock.cases.case import load_case
from oarlock.experiments.laboratory import Laboratory
from oarlock.experiments.task import Task
from oarlock.stepping.recorder import Recorder, Row
from oarlock.stepping.solvers import SolverSpec
from oarlock.tables.schema import SCHEMA
from oarlock.tables.spool import Spool

MUJOCO, TRACKED, PINV = (SolverSpec(name) for name in ("mujoco", "sr1-tracked", "pinv"))
TIMES = ("step_us", "solve_ns")


def row(rows: int) -> Row:
    """Of a bar on so many constraint rows, in arrays that change after they were noted."""
    rng = np.random.default_rng(rows)
    return Row(*(rng.normal(size=size) for size in (2, 0, rows, rows, rows, 2 * rows, 2, rows)))


@pytest.fixture
def recorder():
    return Recorder(setup_of(load_case("four_bar"), duration_s=0.01), Spool(SCHEMA))


def test_a_step_that_does_not_end_leaves_nothing(recorder):
    seen = row(3)
    first = seen.qpos.tolist()
    recorder.note(seen, step=0, time_s=0.0)
    seen.qpos[:] = 7.0
    recorder.end(step_us=1.0)
    recorder.note(seen, step=1, time_s=1.0)
    recorder.note(seen, step=2, time_s=2.0)
    recorder.end(step_us=3.0)
    recorder.note(seen, step=3, time_s=3.0)
    steps = recorder.steps().frame()
    assert steps["step"].to_list() == [0, 2]
    assert steps["step_us"].to_list() == [1.0, 3.0]
    assert steps["qpos"].to_list() == [first, [7.0, 7.0]]


def test_the_number_of_constraint_rows_may_change(recorder):
    numbers = [3, 3, 2, 0, 3]
    seen = [row(number) for number in numbers]
    for step, one in enumerate(seen):
        recorder.note(one, step=step, time_s=0.1 * step)
        recorder.end(step_us=1.0, trajectory_diff=None if step < 2 else 0.5)
    steps = recorder.steps().frame()
    assert steps["step"].to_list() == [0, 1, 2, 3, 4]
    for name in ("residual", "multipliers"):
        assert steps[name].to_list() == [getattr(one, name).tolist() for one in seen]
    for one, position, acceleration in zip(seen, steps["drift_pos"], steps["drift_acc"], strict=True):
        assert position == np.abs(one.residual).max(initial=0.0)
        left = one.jacobian.reshape(-1, 2)
        expected = left[:, 0] * one.qacc[0] + left[:, 1] * one.qacc[1] + one.curvature
        assert acceleration == np.abs(expected).max(initial=0.0)
    assert steps["trajectory_diff"].to_list() == [None, None, 0.5, 0.5, 0.5]
    assert steps["rank"].null_count() == 5


@pytest.mark.parametrize(
    "task",
    [
        Task("calibration", MUJOCO, (), (), "rk4", "default"),
        Task("lockstep", PINV, ("matched", "hard"), (TRACKED,), "rk4", "default", "both"),
        Task("one-step", MUJOCO, ("hard",), (TRACKED,), "rk4", "default"),
        Task("free", MUJOCO, ("matched", "hard"), (MUJOCO, TRACKED), "rk4", "default"),
    ],
    ids=lambda task: task.mode,
)
def test_figures_are_those_of_every_step_alone(monkeypatch, task):
    def walked():
        laboratory = Laboratory(load_case("boat"), None, 0.05, lambda steps: None, stepping="python")
        return [result.steps.frame().drop(TIMES) for result in laboratory.run(task)]

    together = walked()
    monkeypatch.setattr(oarlock.stepping.recorder, "RECORDED", 1)
    for ours, alone in zip(together, walked(), strict=True):
        assert len(ours) == 50
        assert ours.equals(alone)


@pytest.mark.parametrize("stepping", ["native", "python"])
def test_beyond_its_end_the_truth_is_not_known(stepping):
    laboratory = Laboratory(load_case("boat"), 5e-3, 12.1, lambda steps: None, stepping=stepping)
    (result,) = laboratory.run(Task("free", MUJOCO, ("hard",), (SolverSpec("auto"),), "euler", "default"))
    errors = result.steps.frame()["truth_error"]
    assert errors.is_null().to_list() == [False] * 2401 + [True] * 19
    assert errors.is_finite().sum() == 2401
