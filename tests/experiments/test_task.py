"""Tasks, their walks and the names of their runs; the table of modes."""

from typing import get_args

import pytest
from oarlock.cases.case_file import ModeName
from oarlock.experiments.modes import ASKABLE, MODES
from oarlock.experiments.task import Task
from oarlock.stepping.solvers import SolverSpec


def task(mode, **changes):
    solvers = tuple(map(SolverSpec, changes.pop("solvers", ("pinv", "sr1"))))
    asked = {"walker": SolverSpec("mujoco"), "forms": ("matched", "hard"), "integrator": "rk4", "settings": "default"}
    return Task(mode, **{**asked, **changes}, solvers=solvers)


def test_every_mode_of_a_case_file_is_in_the_table():
    assert list(MODES) == list(get_args(ModeName))
    assert list(ASKABLE) == [*list(MODES)[1:], "all"]


@pytest.mark.parametrize(
    ("asked", "names"),
    [
        (task("calibration"), [["calibration-mujoco-rk4"]]),
        (
            task("lockstep", walker=SolverSpec("pinv")),
            [
                [
                    f"lockstep-{form}-along-pinv-{s}-projection-rk4"
                    for form in ("matched", "hard")
                    for s in ("pinv", "sr1")
                ]
            ],
        ),
        (
            task("one-step"),
            [[f"one-step-{form}-{s}-rk4" for form in ("matched", "hard") for s in ("pinv", "sr1")]],
        ),
        (
            task("free", solvers=("mujoco", "pinv"), settings="stiff"),
            [["free-mujoco-stiff-rk4"], ["free-matched-pinv-stiff-rk4"], ["free-hard-pinv-stiff-projection-rk4"]],
        ),
    ],
)
def test_walks_and_their_runs(asked, names):
    walks = asked.walks()
    assert [list(walk.names) for walk in walks] == names
    for walk in walks:  # what a unit of a suite is given is that walk and no other
        assert walk.task.walks() == (walk,)


def test_keys_tell_who_walks_and_what_holds_the_constraints():
    (free,) = task("free", solvers=("pinv",), forms=("hard",), stabilisation="projection").walks()
    (key,) = free.keys("boat", 1e-3, 5, "native")
    assert (key.walker, key.stepping, key.stabilisation) == ("pinv", "native", "projection")
    (alone,) = task("free", solvers=("mujoco",), stabilisation="projection").walks()
    (key,) = alone.keys("boat", 1e-3, 5, "native")
    assert (key.walker, key.form, key.stepping, key.stabilisation) == ("mujoco", None, "mujoco", None)
    (led,) = task("lockstep", walker=SolverSpec("pinv"), stabilisation="both").walks()
    assert [key.stabilisation for key in led.keys("boat", 1e-3, 5)] == ["both"] * 4
    (followed,) = task("lockstep", stabilisation="both").walks()
    assert [key.stabilisation for key in followed.keys("boat", 1e-3, 5)] == [None, None, "both", "both"]


def test_projected_is_what_is_stepped_on_exact_constraints():
    where = {mode: task(mode, stabilisation="projection").walks()[0].task.projected for mode in MODES}
    assert where == dict.fromkeys(MODES, False)  # along MuJoCo, or in the matched form
    assert task("lockstep", walker=SolverSpec("pinv"), stabilisation="projection").projected
    assert [walk.task.projected for walk in task("free", solvers=("pinv",), stabilisation="both").walks()] == [
        False,
        True,
    ]


def test_solvers_that_walk_are_projected_and_answers_along_mujoco_have_baumgartes_terms():
    held = {mode: task(mode, solvers=("pinv",)).held_by for mode in MODES}
    assert held == {"calibration": "baumgarte", "lockstep": "baumgarte", "one-step": "baumgarte", "free": "projection"}
    assert task("lockstep", walker=SolverSpec("pinv")).held_by == "projection"
    assert task("free", stabilisation="baumgarte").held_by == "baumgarte"
    assert task("lockstep", stabilisation="projection").held_by == "projection"
