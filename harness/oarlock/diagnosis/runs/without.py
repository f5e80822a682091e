"""What is left of a drift where a cause of it is taken away: the same run of MuJoCo without that cause.

The parts of the row law add up, but may oppose one another: a part of 113 % is none that taking it away would save. So
what a finding says of time stepping and of the solver is measured, by runs from the same start:

    stepping    a quarter of the timestep, with every row's stiffness and damping as they were in use
    implicit    Euler without eulerdamp, which is explicit, in place of an integrator that treats damping implicitly
    solver      Newton, with iterations and a tolerance that are enough, in place of a solver that stopped early

A solver that stops early leaves M qacc and the constraint forces apart. Euler with eulerdamp steps by the forces, and
the row law reads qacc: to it all of that is time stepping.
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from oarlock.diagnosis.loops.gaps import Opening, opening, widest
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.diagnosis.runs.solving import Solving
from oarlock.diagnosis.runs.stability import stability
from oarlock.mechanics.prepare import set_integrator
from oarlock.poses.layout import Layout

PARTS = 4
"""Of a timestep: what a Euler step leaves falls to a quarter or a sixteenth."""

FINEST = 16
"""Of a timestep: where a run that diverges still does, no shorter one is looked for."""

MOST_STEPS = 40_000
"""Of such a run: a longer one takes more than the rest of a check."""

ABOUT = 0.02
"""Of the run: what is left is looked for so near to the worst moment. At others another cause may do as much."""

LEFT = 1e-3
"""Of the largest R f of a step: a solver that leaves more of the rows' question, or is at its last iteration, stopped
early. CG and PGS leave 1e-6 and less where they arrive."""

MOST = 0.5
"""Of a drift: a cause that takes more of it away is the one that leads."""

Cause = Literal["stepping", "implicit", "solver"]

_EXPLICIT = "euler"

_RATE = 2
"""Place in the parameters of an actuator's gain or bias of what its force changes by with a velocity."""


@dataclass(frozen=True)
class Without:
    """A run without a cause.

    Attributes:
        cause: what was taken away.
        left: equality → its largest gap about the moment at which it was worst, or of the whole run where the run with
            the cause diverged; empty where this run did.
        parts: of a timestep that were taken in place of it.
    """

    cause: Cause
    left: dict[str, Opening]
    parts: int = 1

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
    found: list[Without] = []
    if PARTS * recording.steps <= MOST_STEPS:
        found.append(_without("stepping", recording, PARTS, _finer))
    if implicit(recording.model, recording.integrator):
        found.append(_without("implicit", recording, 1, _explicit))
    return found


def find_fed(recording: Recording, steps: int) -> list[Without]:
    """The same run with a solver that is enough, where the model's own stopped early; empty where it did not.

    Args:
        recording: MuJoCo's run as configured.
        steps: how many it had made if it had stayed finite.
    """
    given = Solving.of(recording.model)
    if not (given.short and _stopped_early(recording)):
        return []
    return [_without("solver", recording, 1, given.enough.apply, steps)]


def find_finer(recording: Recording, steps: int) -> list[Without]:
    """A run that diverged with shorter steps, down to the first that stays finite; empty where none does.

    Args:
        recording: MuJoCo's run as configured.
        steps: how many it had made if it had stayed finite.
    """
    for parts in (PARTS, FINEST):
        if parts * steps <= MOST_STEPS:
            finer = _without("stepping", recording, parts, lambda model, parts=parts: _finer(model, parts), steps)
            if finer.left:
                return [finer]
    return []


def _stopped_early(recording: Recording) -> bool:
    if recording.iterations.max(initial=0) >= recording.model.opt.iterations:
        return True
    missed = np.abs(recording.softness * (recording.force - recording.exact_force)).max(axis=1, initial=0.0)
    return bool((missed > LEFT * np.abs(recording.softness * recording.force).max(axis=1, initial=0.0)).any())


def starving(found: list[Without], equality: str, given: float) -> Without | None:
    """The run with a solver that is enough, where that takes most of the gap (m or rad) of an equality away."""
    for one in found:
        part = one.part(equality, given)
        if one.cause == "solver" and part is not None and part >= MOST:
            return one
    return None


def implicit(model: mujoco.MjModel, integrator: str) -> bool:
    """Whether steps treat damping implicitly, and there may be some."""
    if integrator == _EXPLICIT:
        off = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP
        return not off and bool(model.dof_damping.any())
    return integrator in ("implicit", "implicitfast")


def explicit(model: mujoco.MjModel, integrator: str) -> bool:
    """Whether steps may take some damping as it was at their start that implicitfast takes at their end."""
    if integrator in ("implicit", "implicitfast"):
        return False
    gains, biases = model.actuator_gainprm[:, _RATE], model.actuator_biasprm[:, _RATE]
    some = bool(gains.any() or biases.any() or model.tendon_damping.any() or model.opt.viscosity or model.opt.density)
    return some or (bool(model.dof_damping.any()) and not implicit(model, integrator))


def _finer(model: mujoco.MjModel, parts: int = PARTS) -> None:
    for equality, one in zip(Layout.of(model).equalities, stability(model), strict=True):
        model.eq_solref[equality.index] = one.settings.effective
    model.opt.timestep /= parts


def _explicit(model: mujoco.MjModel) -> None:
    set_integrator(model, _EXPLICIT)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP


def _without(
    cause: Cause,
    recording: Recording,
    parts: int,
    change: Callable[[mujoco.MjModel], None],
    steps: int | None = None,
) -> Without:
    model = copy.deepcopy(recording.model)
    change(model)
    again = rerun(recording, model, parts=parts, steps=steps)
    if again is None:
        return Without(cause, {}, parts)
    every = enumerate(recording.layout.equalities)
    return Without(cause, {one.name: left_about(recording, place, again.position) for place, one in every}, parts)


def left_about(recording: Recording, place: int, position: np.ndarray, model: mujoco.MjModel | None = None) -> Opening:
    """The largest gap of an equality in another run (steps, rows), about the moment of the worst one in this run.

    ``model`` is that of the other run, where its rows are scaled in another way.
    """
    model = recording.model if model is None else model
    rows, equality = recording.layout.of_equality(place), recording.layout.equalities[place]
    near = position[about(recording, place), rows]
    return opening(model, equality, near[widest(model, equality, near)])


def about(recording: Recording, place: int) -> slice:
    """Steps about the moment at which an equality was worst; all of them where the run diverged."""
    if recording.end.how != "finished":
        return slice(None)
    rows, equality = recording.layout.of_equality(place), recording.layout.equalities[place]
    worst = widest(recording.model, equality, recording.position[:, rows])
    around = max(2, int(ABOUT * recording.steps))
    return slice(max(0, worst - around), worst + around + 1)
