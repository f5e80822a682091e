"""The kinds of experiment: who answers along which walk, and which method of a path of stepping takes it.

``MODES`` has one entry for each. What runs there are, what they are called and how many walks a task has all follow
from it; the walk itself is a method of both paths.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from oarlock.cases.case_file import Form, ModeName
from oarlock.stepping.solvers import MUJOCO, SolverSpec

if TYPE_CHECKING:
    from oarlock.stepping.path import Path, Tables

Answer = tuple[SolverSpec, Form | None]
"""Who answers, and in which form; MuJoCo answers in none."""


class Asked(Protocol):
    """Who is asked in a task: all that a mode has to know of it."""

    @property
    def walker(self) -> SolverSpec:
        """Whoever walks, where those who answer do not."""
        ...

    @property
    def forms(self) -> tuple[Form, ...]:
        """The forms of the question."""
        ...

    @property
    def solvers(self) -> tuple[SolverSpec, ...]:
        """Those who answer."""
        ...


@dataclass(frozen=True)
class Mode:
    """A kind of experiment.

    Attributes:
        walks: gives the walks of a task, each as those who answer along it, in the order of their tables.
        take: takes one walk of a task on a path of stepping; the solver is that of the projection after each step, or
            None where nothing is projected.
        walked_in: the form of the constraints that such a walk is stepped with; None where MuJoCo steps it, or where
            each who answers steps from MuJoCo's states.
        alone: whether who answers walks; otherwise the walker of the task does.
        against_mujoco: whether solvers are held against MuJoCo, which is then none of them.
    """

    walks: Callable[[Asked], list[list[Answer]]]
    take: "Callable[[Path, Asked, SolverSpec | None], Tables]"
    walked_in: Callable[[Asked], Form | None]
    alone: bool = False
    against_mujoco: bool = False


def _together(task: Asked) -> list[list[Answer]]:
    """All along one walk, form by form."""
    return [[(solver, form) for form in task.forms for solver in task.solvers]]


def _alone(task: Asked) -> list[list[Answer]]:
    """Each on a walk of its own; MuJoCo once, whatever the forms."""
    forms: dict[bool, tuple[Form | None, ...]] = {True: (None,), False: task.forms}
    return [[(solver, form)] for solver in task.solvers for form in forms[solver.name == MUJOCO]]


def _own_form(task: Asked) -> Form | None:
    """The form of a task of one who walks alone."""
    return None if task.solvers[0].name == MUJOCO else task.forms[0]


MODES: dict[ModeName, Mode] = {
    "calibration": Mode(
        walks=lambda task: [[(SolverSpec(MUJOCO), None)]],
        take=lambda path, task, projector: path.calibration(),
        walked_in=lambda task: None,
    ),
    "lockstep": Mode(
        walks=_together,
        take=lambda path, task, projector: path.lockstep(task.walker, projector, task.forms, task.solvers),
        walked_in=lambda task: None if task.walker.name == MUJOCO else "hard",
        against_mujoco=True,
    ),
    "one-step": Mode(
        walks=_together,
        take=lambda path, task, projector: path.one_step(task.forms, task.solvers),
        walked_in=lambda task: None,
        against_mujoco=True,
    ),
    "free": Mode(
        walks=_alone,
        take=lambda path, task, projector: path.free(task.solvers[0], _own_form(task), projector),
        walked_in=_own_form,
        alone=True,
    ),
}
"""Name → mode. The calibration belongs to every comparison; the others can be asked for."""

CALIBRATION: ModeName = "calibration"

ASKABLE: dict[str, list[ModeName]] = {
    **{name: [name] for name in MODES if name != CALIBRATION},
    "all": [name for name in MODES if name != CALIBRATION],
}
"""What a user may ask for → the modes that are run for it, besides the calibration."""
