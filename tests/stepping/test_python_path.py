"""The Python path: whole steps only, rows that do not know of one another, a table of every walk as it is listed."""

import oarlock.stepping.python_path
import pytest
from mechanisms import setup_of
from oarlock.base.errors import InputError, RefusedError
from oarlock.cases.case import load_case
from oarlock.cases.case_file import Baumgarte
from oarlock.cases.conditions import Conditions
from oarlock.experiments.laboratory import Laboratory
from oarlock.experiments.task import Task
from oarlock.stepping.ending import Ending
from oarlock.stepping.python_path import Calibration, PythonPath
from oarlock.stepping.solvers import SolverSpec

MUJOCO, TRACKED, PINV = (SolverSpec(name) for name in ("mujoco", "sr1-tracked", "pinv"))
TIMES = ("step_us", "solve_ns")


@pytest.mark.parametrize("error", [InputError("no answer"), RefusedError("a contact is active")])
def test_a_step_that_does_not_end_leaves_nothing(monkeypatch, error):
    """What ended the walk is handed over with the rows before it."""
    completed = []

    def complete(self, rows):
        completed.append(rows)
        if len(completed) == 4:
            raise error

    monkeypatch.setattr(Calibration, "complete", complete)
    ticks = []
    prepared = setup_of(load_case("four_bar"), duration_s=0.05)
    (steps,), ending = PythonPath(prepared, Baumgarte(), tick=ticks.append).calibration()
    assert steps.frame()["step"].to_list() == [0, 1, 2]
    assert ending is not None
    assert (ending.step, ending.error) == (3, error)
    assert ending.time_s == pytest.approx(4 * prepared.timestep_s)
    assert ticks == []


def test_who_is_told_of_steps(monkeypatch):
    monkeypatch.setattr(oarlock.stepping.python_path, "TICK_STEPS", 4)
    ticks = []
    prepared = setup_of(load_case("four_bar"), duration_s=0.02)
    _, ending = PythonPath(prepared, Baumgarte(), tick=ticks.append).calibration()
    assert ending is None
    assert sum(ticks) == prepared.steps
    assert ticks == [4] * (prepared.steps // 4) + [prepared.steps % 4] * (prepared.steps % 4 > 0)


@pytest.mark.parametrize(
    ("ending", "said"),
    [
        (Ending(7, 0.25), "step 7, t = 0.25 s: the state is no longer finite, or beyond MuJoCo's bound of 1e+10"),
        (Ending(7, 0.25, InputError("no\n answer")), "step 7, t = 0.25 s: no answer"),
        (Ending(0, 0.0), "step 0, t = 0 s: the state is no longer finite, or beyond MuJoCo's bound of 1e+10"),
    ],
)
def test_what_a_run_says_of_its_end(ending, said):
    assert ending.message() == said


@pytest.mark.parametrize(
    "ending", [Ending(0, 0.0, InputError("no answer")), Ending(7, 0.25, RefusedError("a contact"))]
)
def test_an_end_that_no_run_survives(ending):
    with pytest.raises(InputError) as raised:
        ending.message()
    assert raised.value is ending.error


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
def test_rows_do_not_know_of_one_another(monkeypatch, task):
    """However many of them become a table at once."""

    def walked():
        laboratory = Laboratory(load_case("boat"), Conditions(duration_s=0.05), stepping="python")
        return [result.steps.frame().drop(TIMES) for result in laboratory.run(task)]

    together = walked()
    monkeypatch.setattr(oarlock.stepping.python_path, "HELD_ROWS", 1)
    for ours, alone in zip(together, walked(), strict=True):
        assert len(ours) == 50
        assert ours.equals(alone)


@pytest.mark.parametrize("stepping", ["native", "python"])
def test_beyond_its_end_the_truth_is_not_known(stepping):
    laboratory = Laboratory(load_case("boat"), Conditions(5e-3, 12.1), stepping=stepping)
    (result,) = laboratory.run(Task("free", MUJOCO, ("hard",), (SolverSpec("auto"),), "euler", "default"))
    errors = result.steps.frame()["truth_error"]
    assert errors.is_null().to_list() == [False] * 2401 + [True] * 19
    assert errors.is_finite().sum() == 2401
