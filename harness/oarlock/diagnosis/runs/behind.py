"""What is behind the drift of the equality that opens furthest, or behind a run that diverges, by runs without it.

A row that gives way says how it opens; what pulls at it says why. Of all suspects the one is named without which least
is left, where that is less than half. Weight is what every mechanism has: it is named where nothing else is. What stays
open for good is looked at where that is much of it, else the worst moment.
"""

import copy
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from oarlock.diagnosis.loops.gaps import Opening, opening, widest
from oarlock.diagnosis.loops.loops import Loops
from oarlock.diagnosis.runs.drifts import VISIBLE, Drift
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import Rerun, rerun
from oarlock.diagnosis.runs.suspects import MOST, Suspect, drives, model_without, run_without, suspects
from oarlock.diagnosis.runs.without import MOST as HALF
from oarlock.diagnosis.runs.without import left_about
from oarlock.mechanics.names import element_name

SHARE = 0.8
"""Of a drift: what makes so much is named before what makes less."""

LASTS = 0.2
"""Of the largest drift: what stays open for good is what is asked about, where it is more than that."""

PARTS = 4
"""Of a run; over the last of them something stays open."""

CALM = 0.1
"""Of a drift: with a part of an actuator's force that is told less is left."""

STEPS = 30_000
"""Of all such runs together."""

SMALLER = (1e-4, 1e-5, 1e-6)
"""Parts that are tried besides of what makes a run diverge."""

WHOLE = 0.05
"""Of the size of the loops: one that opens by less holds."""

ARMATURES = (2.0, 10.0, 50.0, 250.0)
"""Steps within which a damper is to take a velocity away at the least: armatures that are tried are so large."""

FACTORS = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 1e-3)
"""Of a suspect: the first with which a run stays finite, or opens by less than half, is told."""

_ALWAYS = ("weight",)
_RIGID = ("refsafe", "scale", "weight")


@dataclass(frozen=True)
class Behind:
    """What is behind a drift.

    Attributes:
        equality: that drifts; empty: the run diverges.
        suspect: what makes most of it.
        left: what is left of the drift without it, where it was worst; of a run that diverged the most of all.
        share: of the drift that is gone, 0 to 1.
        factor: of the suspect with which that holds already; 0: only without it, or it is no number to write.
        wanted: where a joint goes without its limit, rad or m; None of others.
        weight: part that is gone without gravity; None: not measured.
        lasting: what stays open in the run as it is, where that is what ``left`` and ``share`` are of.
        armature: on the joint of a damper with which next to nothing is left, kg m² or kg, and what is.
    """

    equality: str
    suspect: Suspect | None
    left: Opening | None
    share: float
    factor: float = 0.0
    weight: float | None = None
    wanted: tuple[float, float] | None = None
    lasting: Opening | None = None
    armature: tuple[float, Opening] | None = None


def find_behind(recording: Recording, worst: Drift, loops: Loops, rigid: bool = False) -> Behind | None:
    """Of the equality that opens furthest in a run that lasts.

    Args:
        recording: MuJoCo's run as configured.
        worst: its drift.
        loops: at the closed start.
        rigid: whether they are a structure, which opens by its softness alone: only what MuJoCo makes softer than the
            file says, or by a scale, is behind that.
    """
    layout = recording.layout
    place = [one.name for one in layout.equalities].index(worst.equality)
    groups = {loop.name: loop.group for loop in loops.loops}
    if worst.equality not in groups:
        return None
    number = groups[worst.equality]
    own = [one for one in layout.equalities if groups.get(one.name) == number]
    stays = _lasting(recording, place, recording.position, recording.model)
    lasting = stays if stays.largest > max(LASTS * worst.largest, VISIBLE) else None
    given = worst.largest if lasting is None else lasting.largest
    best, weight = Behind(worst.equality, None, None, 0.0), None
    every = list(suspects(recording.model, loops.dofs(number), own))
    every = [one for one in every if one.sort in _RIGID] if rigid else every
    for one in every[: max(1, min(MOST, STEPS // recording.steps))]:
        model = model_without(recording, one)
        again = rerun(recording, model, parts=one.parts)
        if again is None:
            continue
        left = _left(recording, place, again.position, model, lasting is not None)
        share = max(0.0, 1.0 - left.largest / given)
        if one.sort in _ALWAYS:
            weight = share
        elif share > max(best.share, HALF):
            best = Behind(worst.equality, one, left, share, wanted=_wanted(recording.model, one, again))
    best = replace(best, weight=weight, lasting=lasting)
    if best.suspect is not None and best.suspect.scaled is not None:
        best = replace(best, factor=_factor(recording, best, place, given))
    if best.suspect is not None and best.suspect.sort == "damper" and best.suspect.on_joint:
        best = replace(best, armature=_armature(recording, best, place, given))
    return best


def _armature(recording: Recording, best: Behind, place: int, given: float) -> tuple[float, Opening] | None:
    """The least armature tried that makes a damper one that a step bears, and what is left; None: none does."""
    assert best.suspect is not None
    names = [element_name(recording.model, mujoco.mjtObj.mjOBJ_JOINT, one) for one in range(recording.model.njnt)]
    dof = int(recording.model.jnt_dofadr[names.index(best.suspect.name)])
    damping = float(recording.model.dof_damping.reshape(recording.model.nv, -1)[dof, 0])
    for steps in ARMATURES:
        model = copy.deepcopy(recording.model)
        value = float(f"{steps * float(model.opt.timestep) * damping:.1g}")
        model.dof_armature[dof] += value
        mujoco.mj_setConst(model, mujoco.MjData(model))  # which softness is scaled by
        model.eq_data[:] = recording.model.eq_data
        again = rerun(recording, model)
        if again is None:
            continue
        left = _left(recording, place, again.position, model, best.lasting is not None)
        if left.largest <= CALM * given:
            return float(model.dof_armature[dof]), left
    return None


def _left(recording: Recording, place: int, position: np.ndarray, model: mujoco.MjModel, lasts: bool) -> Opening:
    if lasts:
        return _lasting(recording, place, position, model)
    return left_about(recording, place, position, model)


def _lasting(recording: Recording, place: int, position: np.ndarray, model: mujoco.MjModel) -> Opening:
    """The median gap of an equality over the last part of a run (steps, rows)."""
    equality = recording.layout.equalities[place]
    rows = position[-max(1, len(position) // PARTS) :, recording.layout.of_equality(place)]
    return opening(model, equality, np.median(rows, axis=0))


def _wanted(model: mujoco.MjModel, one: Suspect, again: Rerun) -> tuple[float, float] | None:
    if one.sort != "limit":
        return None
    names = [element_name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) for joint in range(model.njnt)]
    coordinate = again.qpos[:, model.jnt_qposadr[names.index(one.name)]]
    return float(coordinate.min()), float(coordinate.max())


def _factor(recording: Recording, best: Behind, place: int, given: float) -> float:
    """The largest factor of a suspect with which at least half of the drift is gone; 0: none of those tried."""
    for factor in FACTORS[:4]:
        assert best.suspect is not None
        assert best.suspect.scaled is not None
        model = copy.deepcopy(recording.model)
        best.suspect.scaled(model, factor)
        again = rerun(recording, model)
        lasts = best.lasting is not None
        if again is not None and _left(recording, place, again.position, model, lasts).largest <= HALF * given:
            return factor
    return 0.0


def find_blower(recording: Recording, steps: int, size: float) -> Behind | None:
    """What makes a run diverge: that without which it stays finite, the drives first.

    Args:
        recording: MuJoCo's run as configured, which diverged.
        steps: how many it had made if it had not.
        size: of the loops, m.
    """
    model = recording.model
    dofs = range(model.nv)
    every = [*drives(model, dofs), *suspects(model, dofs, recording.layout.equalities)]
    for one in every[: max(1, min(MOST, STEPS // max(1, steps)))]:
        again = run_without(recording, one, steps)
        if again is None:
            continue
        worst = max(
            (left_about(recording, place, again.position) for place in range(len(recording.layout.equalities))),
            key=lambda opening: opening.largest,
        )
        factor = 0.0
        for tried in (*FACTORS, *SMALLER) if one.scaled is not None else ():
            changed = copy.deepcopy(model)
            assert one.scaled is not None
            one.scaled(changed, tried)
            part = rerun(recording, changed, steps=steps)
            if part is None:
                continue
            opened = []
            for at, equality in enumerate(recording.layout.equalities):
                own = part.position[:, recording.layout.of_equality(at)]
                opened.append(opening(model, equality, own[widest(model, equality, own)]))
            most = max(opened, key=lambda each: max(each.metres or 0.0, size * (each.radians or 0.0)))
            if max(most.metres or 0.0, size * (most.radians or 0.0)) <= WHOLE * size:
                factor, worst = tried, most
                break
        return Behind("", one, worst, 1.0, factor)
    return None


def find_calmer(recording: Recording, worst: Drift, actuator: int) -> tuple[float, Opening] | None:
    """The largest part of an actuator's force with which a drift is a tenth of it, and what is left; None: none."""
    place = [one.name for one in recording.layout.equalities].index(worst.equality)
    drive = next((one for one in drives(recording.model, range(recording.model.nv)) if one.index == actuator), None)
    for factor in FACTORS if drive is not None and drive.scaled is not None else ():
        assert drive is not None
        assert drive.scaled is not None
        model = copy.deepcopy(recording.model)
        drive.scaled(model, factor)
        again = rerun(recording, model)
        if again is None:
            continue
        rows = again.position[:, recording.layout.of_equality(place)]
        equality = recording.layout.equalities[place]
        left = opening(model, equality, rows[widest(model, equality, rows)])
        if left.largest <= CALM * worst.largest:
            return factor, left
    return None


def largest_force(model: mujoco.MjModel, recording: Recording, actuator: int) -> float:
    """What an actuator gives at most in a run, times its gear."""
    return float(recording.driven[actuator] * abs(model.actuator_gear[actuator]).max())
