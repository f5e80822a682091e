"""Servos that do not come to where they are told, too weak for a weight, a spring or a damper.

What is in the way by force alone leaves no trace in the loops: they hold, and the mechanism stands elsewhere. Each
suspect is taken away in turn, and the servo's own stiffness is raised: what brings it to its target is told.
"""

import copy
import math
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.loops import Loops
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.diagnosis.runs.suspects import Suspect, alike, drives, run_without, suspects
from oarlock.mechanics import controls
from oarlock.mechanics.names import element_name
from oarlock.mechanics.servos import Servo, servos

OFF = 0.15
"""rad, or of the mechanism's size: who stands so far from its target, and so much of what it was told, misses it."""

PART = 0.25
"""Of the commanded change, at least."""

ARRIVES = 0.5
"""Of what it misses: a run without a suspect that leaves less shows what holds it."""

STRONGER = (2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
"""Times its kp, with √ of that times its kv: the first with which it comes near."""

NEAR = 0.25
"""Of what it misses: a stronger servo is to leave no more."""

HALF = 0.5
"""Of what one thing taken away leaves: two are named where they leave less."""

LAST = 0.2
"""Of the run, at its end: over that it is told the same, and its place is a mean."""

CLIPPED = 0.01
"""Of the range: so far beyond it a control is none by rounding."""

MOST = 12
"""Suspects that are tried."""

_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True)
class Missed:
    """A servo that misses its target.

    Attributes:
        servo: it; joint: that it drives; unit: rad or m.
        group: of the loops.
        told, reached: where it is to be, and where it is over the last part of the run.
        suspect: without which it comes to ``without``; None: none was found.
        kp: with which it comes to ``stronger``; None: with none that was tried.
        given: kp that it has.
        clipped: the control that was asked for beyond the ctrlrange; None: it lies within.
        full: the bound of its force, N or N m, that it gives; None: it gives less.
    """

    servo: Servo
    joint: str
    unit: str
    group: int
    told: float
    reached: float
    given: float
    suspect: Suspect | None = None
    without: float | None = None
    kp: float | None = None
    stronger: float | None = None
    full: float | None = None


@dataclass(frozen=True)
class Clipped:
    """A control that MuJoCo cuts to its ctrlrange.

    Attributes:
        actuator: its name; asked, used: the control.
        range: of the actuator.
        loops: numbers of the groups that it drives.
        short: by how much a servo then is elsewhere, rad or m, and the unit; 0 of others.
    """

    actuator: str
    asked: float
    used: float
    range: tuple[float, float]
    loops: tuple[int, ...]
    short: float
    unit: str


def find_clipped(recording: Recording, loops: Loops) -> tuple[Clipped, ...]:
    """Controls that are held over the run and lie beyond the range of their actuator."""
    model, found = recording.model, []
    by_index = {one.index: one for one in servos(model)}
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL:
        return ()
    parsed = controls.drive(model, recording.laws).laws
    for index, law in parsed:
        if not model.actuator_ctrllimited[index] or not law.is_constant:
            continue
        low, high = model.actuator_ctrlrange[index].tolist()
        asked = float(law.at(0.0))
        used = min(max(asked, low), high)
        if abs(asked - used) <= CLIPPED * (high - low):
            continue
        joint = int(model.actuator_trnid[index, 0])
        groups = [
            number
            for number in range(len(loops.groups))
            if joint in {int(model.dof_jntid[dof]) for dof in loops.dofs(number)}
        ]
        short, unit = 0.0, ""
        if index in by_index:
            one = by_index[index]
            short = abs(one.reached(asked) - one.reached(used))
            unit = "m" if model.jnt_type[one.joint] == _SLIDE else "rad"
        name = element_name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, index)
        found.append(Clipped(name, asked, used, (low, high), tuple(groups), short, unit))
    return tuple(found)


def find_missed(recording: Recording, loops: Loops, size: float, said: set[int]) -> tuple[Missed, ...]:
    """Looks at the servos of each group, the one that misses most.

    Args:
        recording: MuJoCo's run as configured, to its end.
        loops: at the closed start.
        size: of the mechanism, m.
        said: groups of which it is known what holds a servo.
    """
    model, found = recording.model, []
    if recording.end.how != "finished" or recording.steps < 2:
        return ()
    for number in range(len(loops.groups)):
        dofs = loops.dofs(number)
        every = [one for one in servos(model) if int(model.jnt_dofadr[one.joint]) in dofs]
        off = [one for one in (_off(recording, each, number, size) for each in every) if one is not None]
        if number not in said and off:
            worst = max(off, key=lambda one: abs(one.told - one.reached) / _reach(one, size))
            found.append(_explained(recording, worst, dofs))
    return tuple(found)


def _reach(one: Missed, size: float) -> float:
    return size if one.unit == "m" else 1.0


def _off(recording: Recording, one: Servo, group: int, size: float) -> Missed | None:
    model = recording.model
    first = min(recording.steps - 2, int((1.0 - LAST) * recording.steps))
    if (
        np.ptp(recording.ctrl[first:, one.index])
        or not recording.driven[one.index]
        or model.actuator_dyntype[one.index]
    ):
        return None
    address = model.jnt_qposadr[one.joint]
    start = float(recording.qpos[0, address])
    reached = float(np.mean(recording.qpos[first:, address]))
    told = one.reached(one.told(model, float(recording.ctrl[-1, one.index])))
    unit = "m" if model.jnt_type[one.joint] == _SLIDE else "rad"
    name = element_name(model, mujoco.mjtObj.mjOBJ_JOINT, one.joint)
    made = Missed(one, name, unit, group, told, reached, one.stiffness)
    short = abs(told - reached)
    if short <= OFF * _reach(made, size) or short <= PART * abs(told - start):
        return None
    return made


def _explained(recording: Recording, one: Missed, dofs: list[int]) -> Missed:
    model, index = recording.model, one.servo.index
    address, first = model.jnt_qposadr[one.servo.joint], int((1.0 - LAST) * recording.steps)
    short = abs(one.told - one.reached)

    def place(changed: mujoco.MjModel) -> float | None:
        again = rerun(recording, changed)
        return None if again is None else float(np.mean(again.qpos[first:, address]))

    best, suspect, without = ARRIVES * short, None, None
    others = [each for each in drives(model, dofs) if each.name != one.servo.name]
    for each in [*suspects(model, dofs), *others][:MOST]:
        again = run_without(recording, each)
        if again is None:
            continue
        there = float(np.mean(again.qpos[first:, address]))
        if abs(one.told - there) < best:
            best, suspect, without = abs(one.told - there), each, there
    if suspect is None:
        suspect, without = _together(recording, one, dofs, best)
    full, own = None, copy.deepcopy(model)
    limit = np.abs(model.actuator_forcerange[index]).max() if model.actuator_forcelimited[index] else math.inf
    if recording.driven[index] >= 0.99 * limit:
        full = float(limit)
        own.actuator_forcelimited[index] = 0
    kp = stronger = None
    for times in (1.0, *STRONGER) if full is not None else STRONGER:
        changed = copy.deepcopy(own)
        changed.actuator_gainprm[index, 0] *= times
        changed.actuator_biasprm[index, :2] *= times
        changed.actuator_biasprm[index, 2] *= math.sqrt(times)
        there = place(changed)
        if there is not None and abs(one.told - there) <= NEAR * short:
            kp, stronger = times * one.given, there
            break
    return Missed(
        one.servo,
        one.joint,
        one.unit,
        one.group,
        one.told,
        one.reached,
        one.given,
        suspect,
        without,
        kp,
        stronger,
        full,
    )


def _together(recording: Recording, one: Missed, dofs: list[int], best: float) -> tuple[Suspect | None, float | None]:
    """What all joints of the loops have alike, as of a default class: none of them alone is in the way.

    Armature is lessened and not taken away, for a run without any may not stay finite. Both are named where they
    leave less than half of what one of them does.
    """
    address, first = recording.model.jnt_qposadr[one.servo.joint], int((1.0 - LAST) * recording.steps)
    suspect, without = None, None
    for fields in (("damping",), ("armature",), ("damping", "armature")):
        made = alike(recording.model, dofs, fields)
        again = run_without(recording, made) if made is not None else None
        if again is None:
            continue
        there = float(np.mean(again.qpos[first:, address]))
        if abs(one.told - there) < (best if suspect is None else HALF * best):
            best, suspect, without = abs(one.told - there), made, there
    return suspect, without
