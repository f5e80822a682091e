"""A start in a dead point: what drives a group of loops has no lever on its motion there, however hard it pushes.

Of the motions N that the rows of a group admit at the start, and the moments R of the actuators on it,

    R N = 0    there, and not at closed poses beside it

so that all of a force goes into the links. The loops hold, nothing is in the way, and nothing moves. A pose beside it
is tried: the same run from there has to move.
"""

import itertools
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.loops import Loops
from oarlock.diagnosis.loops.mobility import Mobility, admitted
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.walking import own_copy, walk
from oarlock.mechanics.controls import drive
from oarlock.mechanics.load import collected_warnings
from oarlock.mechanics.names import element_name
from oarlock.mechanics.servos import moments
from oarlock.poses.assembly import Assembly

OFF = np.radians(5.0)
"""rad, or as much of a slide over the size of the loops: so far beside the start another one is tried."""

LEVER = 0.01
"""Of the lever beside the start: less is none."""

EARLY = 0.2
"""Of a run: what has not moved by then does not leave by itself."""

STILL = 0.01
"""rad, or sizes: what moves less stands."""

MOVES = 10.0
"""Times ``OFF``: a run from beside the start goes further than that."""

_JOINT, _ACTUATOR = mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_ACTUATOR
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True)
class Leverless:
    """Actuators without a lever at the start.

    Attributes:
        equalities: of the group; actuators: their names.
        joint: that turns most in its motion; slides: whether it is a slide.
        force: the largest of what the actuators give; effort: its unit.
        qpos: a closed start beside it, (nq); way: how far the joint goes in the run from there, rad or m.
    """

    equalities: tuple[str, ...]
    actuators: tuple[str, ...]
    joint: str
    slides: bool
    force: float
    effort: str
    qpos: np.ndarray
    way: float


def find_leverless(
    recording: Recording, loops: Loops, mobility: tuple[Mobility, ...], size: float
) -> tuple[Leverless, ...]:
    """Looks at the groups of one freedom that something drives, and that stand.

    Args:
        recording: MuJoCo's run as configured, to its end.
        loops: at the closed start.
        mobility: of its groups.
        size: of the loops, m.
    """
    model, found = recording.model, []
    if not model.nu or recording.end.how != "finished" or recording.steps < 2:
        return ()
    free = {one.equalities for one in mobility if one.moves and one.near == 1}
    for number, group in enumerate(loops.groups):
        if group.equalities in free and (one := _of(recording, loops, number, size)) is not None:
            found.append(one)
    return tuple(found)


def _of(recording: Recording, loops: Loops, number: int, size: float) -> Leverless | None:
    model, dofs, members = recording.model, loops.dofs(number), loops.members(number)
    unit = np.where(model.jnt_type[model.dof_jntid[dofs]] == _SLIDE, size, 1.0)
    data = recording.restart(model)
    assembly = Assembly(model, data)
    motions = admitted(assembly, members, dofs, loops.qpos)
    if len(motions) != 1:
        return None
    drives = moments(model, assembly.data)
    own = [
        index
        for index in range(model.nu)
        if np.any(drives[index, dofs]) and recording.driven[index] > 0.0 and np.any(drives[index])
    ]
    if not own:
        return None
    motion = motions[0] / np.abs(motions[0][dofs] / unit).max()
    if _moved(recording, motion[dofs] / unit, dofs, unit) > STILL:
        return None
    here = _levers(drives[own], motion, dofs, unit)
    for step in (OFF, -OFF):
        beside = loops.qpos.copy()
        mujoco.mj_integratePos(model, beside, step * motion, 1.0)
        assembly.place(beside)
        if not assembly.close():
            continue
        pose = assembly.data.qpos.copy()
        along = admitted(assembly, members, dofs, pose)
        if len(along) != 1:
            continue
        along = along[0] / np.abs(along[0][dofs] / unit).max()
        if (here > LEVER * _levers(moments(model, assembly.data)[own], along, dofs, unit)).any():
            return None
        lead = dofs[int(np.abs(motion[dofs] / unit).argmax())]
        way = _way(recording, pose, lead)
        wide = size if model.jnt_type[model.dof_jntid[lead]] == _SLIDE else 1.0
        if way > MOVES * OFF * wide:
            return Leverless(
                equalities=loops.groups[number].equalities,
                actuators=tuple(element_name(model, _ACTUATOR, index) for index in own),
                joint=element_name(model, _JOINT, int(model.dof_jntid[lead])),
                slides=bool(model.jnt_type[model.dof_jntid[lead]] == _SLIDE),
                force=max(recording.driven[index] * float(np.abs(model.actuator_gear[index]).max()) for index in own),
                effort=_effort(model, own),
                qpos=pose,
                way=way,
            )
    return None


def _effort(model: mujoco.MjModel, actuators: list[int]) -> str:
    """The unit of what actuators give; of some on joints of both kinds, or on tendons, both."""
    on = [int(model.actuator_trnid[index, 0]) for index in actuators]
    joints = model.actuator_trntype[actuators] == int(mujoco.mjtTrn.mjTRN_JOINT)
    slides = {bool(model.jnt_type[joint] == _SLIDE) for joint in on} if joints.all() else {True, False}
    return "N or N m" if len(slides) > 1 else "N" if slides.pop() else "N m"


def _moved(recording: Recording, motion: np.ndarray, dofs: list[int], unit: np.ndarray) -> float:
    """How far it goes along a motion in the first part of a run, rad or sizes; not by what its rows give way."""
    early = recording.qpos[: max(2, round(EARLY * recording.steps))]
    change, most = np.zeros(recording.model.nv), 0.0
    for there in early[:: max(1, len(early) // 20)]:
        mujoco.mj_differentiatePos(recording.model, change, 1.0, early[0], there)
        most = max(most, abs(float(motion @ (change[dofs] / unit)) / float(motion @ motion)))
    return most


def _levers(drives: np.ndarray, motion: np.ndarray, dofs: list[int], unit: np.ndarray) -> np.ndarray:
    """What each of some actuators moves along a motion, over what it moved if all of its joints went with it."""
    return np.abs(drives @ motion) / np.maximum(np.abs(drives[:, dofs] * unit).max(axis=1), mujoco.mjMINVAL)


def _way(recording: Recording, pose: np.ndarray, dof: int) -> float:
    """How far (rad or m) a coordinate goes in the same run from another pose, at rest; 0 where it does not last."""
    model = own_copy(recording.model)
    data = recording.restart(model)
    data.qpos[:], data.qvel[:] = pose, 0.0
    moved, place = 0.0, int(model.jnt_qposadr[model.dof_jntid[dof]])
    with np.errstate(all="ignore"), collected_warnings():
        places = [float(data.qpos[place]) for _ in walk(model, data, drive(model, recording.laws), recording.steps)]
    if len(places) == recording.steps:
        moved = sum(abs(there - here) for here, there in itertools.pairwise(places))
    return moved
