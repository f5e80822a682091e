"""What is left of a drift where a cause of it is taken away: the same run of MuJoCo without that cause.

The parts of the row law add up, but may oppose one another: a part of 113 % is none that taking it away would save. So
what a finding says of time stepping is measured, by two runs from the same start:

    stepping    a quarter of the timestep, with every row's stiffness and damping as they were in use
    implicit    Euler without eulerdamp, which is explicit, in place of an integrator that treats damping implicitly
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from oarlock.diagnosis.loops.gaps import Opening, gaps, opening
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.stability import stability
from oarlock.diagnosis.runs.walking import walk
from oarlock.mechanics.controls import drive
from oarlock.mechanics.load import collected_warnings
from oarlock.mechanics.names import Equality
from oarlock.mechanics.prepare import set_integrator
from oarlock.poses.layout import Layout, RowColumns

PARTS = 4
"""Of a timestep: what a Euler step leaves falls to a quarter or a sixteenth."""

MOST_STEPS = 40_000
"""Of such a run: a longer one takes more than the rest of a check."""

ABOUT = 0.02
"""Of the run: what is left is looked for so near to the worst moment. At others another cause may do as much."""

Cause = Literal["stepping", "implicit"]

_EXPLICIT = "euler"


@dataclass(frozen=True)
class Without:
    """A run without a cause.

    Attributes:
        cause: what was taken away.
        left: equality → its largest gap about the moment at which it was worst; empty where the run diverged.
    """

    cause: Cause
    left: dict[str, Opening]

    def part(self, equality: str, given: float) -> float | None:
        """How much of a gap (m or rad) the cause makes, 0 to 1; None where the run did not last."""
        if equality not in self.left or not given:
            return None
        return min(1.0, max(0.0, 1.0 - self.left[equality].largest / given))


def find_without(recording: Recording) -> list[Without]:
    """Takes time stepping away, and the implicit part of it where there is one.

    Args:
        recording: MuJoCo's run as configured.
    """
    found = []
    if PARTS * recording.steps <= MOST_STEPS:
        found.append(_without("stepping", recording, PARTS, _finer))
    if implicit(recording.model, recording.integrator):
        found.append(_without("implicit", recording, 1, _explicit))
    return found


def implicit(model: mujoco.MjModel, integrator: str) -> bool:
    """Whether steps treat damping implicitly, and there may be some."""
    if integrator == _EXPLICIT:
        off = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP
        return not off and bool(model.dof_damping.any())
    return integrator in ("implicit", "implicitfast")


def _finer(model: mujoco.MjModel) -> None:
    for equality, one in zip(Layout.of(model).equalities, stability(model), strict=True):
        model.eq_solref[equality.index] = one.settings.effective
    model.opt.timestep /= PARTS


def _explicit(model: mujoco.MjModel) -> None:
    set_integrator(model, _EXPLICIT)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP


def _without(
    cause: Cause,
    recording: Recording,
    parts: int,
    change: Callable[[mujoco.MjModel], None],
) -> Without:
    model = copy.deepcopy(recording.model)
    change(model)
    data = recording.restart(model)
    layout, taken = recording.layout, 0
    columns, position = RowColumns(layout), np.zeros((recording.steps, layout.rows))
    with np.errstate(all="ignore"), collected_warnings():
        for step in walk(model, data, drive(model, recording.laws), parts * recording.steps):
            if step % parts == 0:
                position[step // parts, columns.of(data)] = data.efc_pos[columns.rows(data)]
            taken = step + 1
    if taken < parts * recording.steps:
        return Without(cause, {})
    left = {one.name: _left(recording, place, position) for place, one in enumerate(layout.equalities)}
    return Without(cause, left)


def _left(recording: Recording, place: int, position: np.ndarray) -> Opening:
    """The largest gap of an equality about the moment at which it was worst."""
    rows, equality = recording.layout.of_equality(place), recording.layout.equalities[place]
    _, worst = _worst(recording.model, equality, recording.position[:, rows])
    around = max(2, int(ABOUT * recording.steps))
    return _worst(recording.model, equality, position[max(0, worst - around) : worst + around + 1, rows])[0]


def _worst(model: mujoco.MjModel, equality: Equality, rows: np.ndarray) -> tuple[Opening, int]:
    """The largest gap of an equality, of its points or of its angle, whichever is larger; and the step."""
    instants = {int(sizes.argmax()) for sizes in gaps(model, equality, rows).values()}
    return max(((opening(model, equality, rows[at]), at) for at in instants), key=lambda one: one[0].largest)
