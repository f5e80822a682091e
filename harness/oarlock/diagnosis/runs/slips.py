"""Objects that a gripper lets go: held between bodies of its loops, and lost, with what would hold them.

A free body that touches two bodies of the loops or more, and later moves away from them, slipped, was dropped or
pressed out. What would have held it is found by runs: with friction where a contact has none, with a higher
coefficient, with a larger force of the grip.
"""

import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.loops import Loops
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.mechanics.names import element_name
from oarlock.mechanics.servos import moments

LOST = 0.5
"""Of the size of an object: who is so much further from what held it slipped."""

KEPT = 0.3
"""Of the way: with a cure less is left."""

SAMPLES = 60
"""Poses of the run at which contacts are looked at."""

FRICTION, GRIP = (2.0, 4.0), (3.0, 10.0)
"""Times the sliding friction, and the force of the actuators: what is tried."""

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_BODY, _GEOM = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_GEOM


@dataclass(frozen=True)
class Slip:
    """An object that was lost.

    Attributes:
        body: its name; holders: those that held it.
        way: how far it went from them, m; time_s: when it was half of that away.
        cure: what keeps it, in words; empty: nothing that was tried.
        left: the way with that, m.
        equalities: of the loops that held it.
    """

    body: str
    holders: tuple[str, ...]
    way: float
    time_s: float
    cure: str
    left: float
    equalities: tuple[str, ...]


def find_slips(recording: Recording, loops: Loops) -> tuple[Slip, ...]:
    """Looks at every free body that bodies of the loops touch from two sides.

    Args:
        recording: MuJoCo's run as configured, to its end.
        loops: at the closed start.
    """
    model, found = recording.model, []
    if recording.end.how != "finished" or recording.steps < 2 or not model.nu:
        return ()
    free = [int(model.jnt_bodyid[joint]) for joint in np.flatnonzero(model.jnt_type == _FREE)]
    free = [body for body in free if body == model.body_rootid[body] and not _has_joints(model, body)]
    if not free:
        return ()
    parts = {int(model.dof_bodyid[dof]) for number in range(len(loops.groups)) for dof in loops.dofs(number)}
    held = _held(recording, set(free), parts)
    for body, holders in held.items():
        size = 2.0 * float(model.geom_rbound[model.geom_bodyid == body].max())
        steps, away = _away(recording, body, holders, recording.qpos)
        if away.max() <= LOST * size:
            continue
        half = int(steps[int((away > 0.5 * away.max()).argmax())])
        cure, left = _cure(recording, body, holders, loops, float(away.max()))
        touched = {
            name
            for number, group in enumerate(loops.groups)
            if {int(model.dof_bodyid[dof]) for dof in loops.dofs(number)} & set(holders)
            for name in group.equalities
        }
        names = tuple(element_name(model, _BODY, one) for one in holders)
        when = float(recording.time[half])
        name = element_name(model, _BODY, body)
        found.append(Slip(name, names, float(away.max()), when, cure, left, tuple(sorted(touched))))
    return tuple(found)


def _has_joints(model: mujoco.MjModel, root: int) -> bool:
    """Whether a tree has joints besides the free one: then it is no object."""
    return int((model.body_rootid[model.jnt_bodyid] == root).sum()) > 1


def _held(recording: Recording, free: set[int], parts: set[int]) -> dict[int, tuple[int, ...]]:
    """Object → the bodies of loops that touch it at one time, two of them or more."""
    model, data = recording.model, recording.restart(recording.model)
    found: dict[int, tuple[int, ...]] = {}
    for step in _samples(len(recording.qpos)):
        data.qpos[:] = recording.qpos[step]
        mujoco.mj_fwdPosition(model, data)
        touching: dict[int, set[int]] = {}
        for contact in data.contact:
            pair = [int(model.body_weldid[model.geom_bodyid[geom]]) for geom in contact.geom]
            for body, other in (pair, pair[::-1]):
                if body in free and other in parts:
                    touching.setdefault(body, set()).add(other)
        for body, others in touching.items():
            if len(others) > 1 and body not in found:
                found[body] = tuple(sorted(others))
    return found


def _samples(count: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(SAMPLES, count)).astype(int))


def _away(recording: Recording, body: int, holders: tuple[int, ...], qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Steps, and how far an object has moved from the middle of what held it since it was nearest to it, m."""
    model, data = recording.model, recording.restart(recording.model)
    steps, places = _samples(len(qpos)), []
    for step in steps:
        data.qpos[:] = qpos[step]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        places.append(data.xipos[body] - np.mean([data.xipos[one] for one in holders], axis=0))
    off = np.array(places)
    nearest = int(np.linalg.norm(off, axis=1).argmin())
    return steps, np.where(np.arange(len(off)) >= nearest, np.linalg.norm(off - off[nearest], axis=1), 0.0)


def _cure(recording: Recording, body: int, holders: tuple[int, ...], loops: Loops, way: float) -> tuple[str, float]:
    for said, change in _cures(recording, body, holders, loops):
        model = copy.deepcopy(recording.model)
        change(model)
        again = rerun(recording, model)
        if again is None:
            continue
        left = float(_away(recording, body, holders, again.qpos)[1].max())
        if left <= KEPT * way:
            return said, left
    return "", way


def _cures(
    recording: Recording, body: int, holders: tuple[int, ...], loops: Loops
) -> Iterator[tuple[str, Callable[[mujoco.MjModel], None]]]:
    model = recording.model
    geoms = np.flatnonzero(np.isin(model.body_weldid[model.geom_bodyid], [body, *holders]))
    slippery = geoms[model.geom_condim[geoms] == 1]
    names = ", ".join(f"'{element_name(model, _GEOM, int(geom))}'" for geom in slippery[:3])

    def rough(copied: mujoco.MjModel) -> None:
        copied.geom_condim[geoms] = np.maximum(copied.geom_condim[geoms], 3)

    if len(slippery):
        yield f'condim="1" of {names} leaves contacts without friction: condim="3"', rough
    for times in FRICTION:

        def rougher(copied: mujoco.MjModel, times: float = times) -> None:
            rough(copied)
            copied.geom_friction[geoms, 0] *= times

        most = float(model.geom_friction[geoms, 0].max())
        condim = ' and condim="3"' if len(slippery) else ""
        yield f"it is too smooth for the grip: friction {times * most:g} in place of {most:g}{condim}", rougher
    dofs = [dof for number in range(len(loops.groups)) for dof in loops.dofs(number)]
    data = recording.restart(model)
    mujoco.mj_fwdPosition(model, data)
    own = np.flatnonzero(np.abs(moments(model, data)[:, dofs]).max(axis=1) > 0.0)
    for times in GRIP:

        def stronger(copied: mujoco.MjModel, times: float = times) -> None:
            copied.actuator_forcerange[own] *= times
            copied.actuator_gainprm[own, 0] *= times
            copied.actuator_biasprm[own, :2] *= times

        yield f"the grip is too weak: {times:g} times the kp and forcerange of its actuators", stronger
