"""Joints that take less force than their actuators give: MuJoCo cuts what arrives at a joint to its actuatorfrcrange.

An actuator's own force, and its forcerange, show nothing of that. It is named where it cuts most of the run by much,
and the same run without it follows the servo, or of another actuator moves otherwise.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.loops import Loops
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.mechanics.load import collected_warnings
from oarlock.mechanics.names import element_name
from oarlock.mechanics.servos import Servo, moments, servos

TIMES = 2.0
"""Of the bound: who asks for less is at its limit as any drive is."""

MOSTLY = 0.5
"""Of the run: a peak that is cut is what a bound is for."""

ARRIVES = 0.5
"""Of what a servo misses, as a mean: the run without the bound leaves less."""

LEAST = 0.02
"""rad, or of the mechanism's size: less is not missed."""

INSTANTS = 200
"""Of a run, at most, at which forces are looked at."""

_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True)
class Throttled:
    """A joint whose actuatorfrcrange cuts what drives it.

    Attributes:
        group: of the loops.
        joint: its name; actuator: the one that asks for most; servo: whether that is one.
        range: of the joint, N or N m; asked: what its actuators ask for at the end of the run.
        misses, without: how far a servo is off as a mean over the run, and without the range; of another actuator, 0
            and how far the joint then gets from where it is.
        unit: rad or m.
    """

    group: int
    joint: str
    actuator: str
    servo: bool
    range: tuple[float, float]
    asked: float
    misses: float
    without: float
    unit: str


def find_throttled(recording: Recording, loops: Loops, size: float) -> tuple[Throttled, ...]:
    """Looks at the joints of each group of loops that have such a range.

    Args:
        recording: MuJoCo's run as configured, to its end.
        loops: at the closed start.
        size: of the mechanism, m.
    """
    model, found = recording.model, []
    if recording.end.how != "finished" or recording.steps < 2 or not model.jnt_actfrclimited.any():
        return ()
    every = [
        (number, int(model.dof_jntid[dof]))
        for number in range(len(loops.groups))
        for dof in loops.dofs(number)
        if model.jnt_actfrclimited[model.dof_jntid[dof]]
    ]
    asked = _asked(recording) if every else np.zeros((0, model.nv))
    for number, joint in every:
        low, high = model.jnt_actfrcrange[joint].tolist()
        own = asked[:, model.jnt_dofadr[joint]]
        cut = (own > TIMES * high) | (own < TIMES * low)
        if cut.mean() > MOSTLY and (one := _tried(recording, number, joint, float(own[-1]), size)) is not None:
            found.append(one)
    return tuple(found)


def _asked(recording: Recording) -> np.ndarray:
    """What the actuators ask of each degree of freedom, before any range of a joint, (instants, nv)."""
    model = recording.model
    if model.na:  # whose activations are not recorded
        return np.zeros((1, model.nv))
    data = mujoco.MjData(model)
    steps, made = np.unique(np.linspace(0, recording.steps - 1, INSTANTS).astype(int)), []
    with collected_warnings():
        for step in steps:
            data.qpos[:], data.qvel[:], data.ctrl[:] = recording.qpos[step], recording.qvel[step], recording.ctrl[step]
            mujoco.mj_forward(model, data)
            made.append(moments(model, data).T @ data.actuator_force)
    return np.array(made)


def _tried(recording: Recording, group: int, joint: int, asked: float, size: float) -> Throttled | None:
    """What the same run is without the range."""
    model = recording.model
    drives = [each for each in range(model.nu) if int(model.actuator_trnid[each, 0]) == joint]
    if not drives:
        return None
    free = copy.deepcopy(model)
    free.jnt_actfrclimited[joint] = 0
    again = rerun(recording, free)
    if again is None:
        return None
    address, slides = int(model.jnt_qposadr[joint]), int(model.jnt_type[joint]) == _SLIDE
    was, there = recording.qpos[:, address], again.qpos[:, address]
    most = max(drives, key=lambda each: float(recording.driven[each]))
    own = next((one for one in servos(model) if one.index == most), None)
    least = LEAST * (size if slides else 1.0)
    misses = 0.0 if own is None else _off(model, own, recording.ctrl, was)
    without = float(np.abs(there - was).max()) if own is None else _off(model, own, recording.ctrl, there)
    if (own is None and without <= least) or (own is not None and (misses <= least or without > ARRIVES * misses)):
        return None
    low, high = model.jnt_actfrcrange[joint].tolist()
    names = [
        element_name(model, kind, index)
        for kind, index in ((mujoco.mjtObj.mjOBJ_JOINT, joint), (mujoco.mjtObj.mjOBJ_ACTUATOR, most))
    ]
    unit = "m" if slides else "rad"
    return Throttled(group, names[0], names[1], own is not None, (low, high), asked, misses, without, unit)


def _off(model: mujoco.MjModel, one: Servo, ctrl: np.ndarray, places: Sequence[float] | np.ndarray) -> float:
    """How far a servo is from where it is told, as a mean."""
    told = [one.reached(one.told(model, float(value))) for value in ctrl[:, one.index]]
    return float(np.abs(np.array(told) - places).mean())
