"""What an engine's forces, steps and run say against a cause that its accelerations at the states show.

Accelerations of single states are compared to the last digit. The rest is held to what no integrator and no rounding
explains: forces that are not those of the accelerations, a step that is another one, a run whose loops open otherwise.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from oarlock.base.numbers import short
from oarlock.conformance.causes import SILENT, UNEXPLAINED, Cause
from oarlock.conformance.laws import Law, Laws, forces_apart
from oarlock.conformance.states import Plan
from oarlock.engines.answers import Answer

FORCES = 1e-3
"""Relative, of constraint forces in double precision: 1e-5 is measured of maximal coordinates, 1e-12 of others."""

FORCES_SINGLE = 0.1
"""The same in single precision, where a difference of large forces is left."""

STEP = 0.5
"""Relative, of what a step changes velocities by: Runge–Kutta's stages leave a loop by what one without J̇v makes of it
(2e-3) or float32 (0.1), both measured; another timestep is 1 and more."""

WIDER = 2.0
"""Times MuJoCo's own largest gap: the loops of a run under the same law open as far, however it ends."""

TORN = 1e-2
"""Of the mechanism's extent: a run of exact rows opens by its integrator's errors only."""


def against(cause: Cause, laws: Laws, plan: Plan, answer: Answer, row: dict[str, Any]) -> Cause:
    """The cause, or that there is none: forces, step and run have to be those of its law.

    Args:
        cause: as the accelerations show it.
        laws: of the model and its states.
        plan: of the model.
        answer: to the states.
        row: figures, with those of the step and of the run if there were such.
    """
    if cause.law is None or cause.name in (UNEXPLAINED, SILENT):
        return cause
    said = [*_forces(laws, cause.law, answer, row["single"]), *_step(cause.law, row), *_run(cause.law, plan, row)]
    if not said:
        return cause
    return replace(cause, name=UNEXPLAINED, text=f"unexplained: {cause.text} at every state, but {'; '.join(said)}")


def _forces(laws: Laws, law: Law, answer: Answer, single: bool) -> list[str]:
    apart_by = float(forces_apart(answer.qfrc_constraint, laws.solve(law)).max(initial=0.0))
    if apart_by <= (FORCES_SINGLE if single else FORCES):
        return []
    return [f"its constraint forces are off by {short(apart_by)} of those of its accelerations"]


def _step(law: Law, row: dict[str, Any]) -> list[str]:
    apart_by = row["step_mujoco"]
    if law != Law() or apart_by is None or apart_by <= STEP:
        return []
    return [f"its step changes velocities by {short(apart_by)} of MuJoCo's more or less"]


def _run(law: Law, plan: Plan, row: dict[str, Any]) -> list[str]:
    gap, own = row["drift_max"], plan.mujoco_gap
    if gap is None or not np.isfinite(own):
        return []
    most = WIDER * own
    if law.rigid:
        most = max(most, TORN * plan.extent)
    elif law != Law():
        return []
    if gap <= most + np.finfo(float).eps:
        return []
    return [f"its run opens the loops by {short(gap)}, and MuJoCo's by {short(own)}"]
