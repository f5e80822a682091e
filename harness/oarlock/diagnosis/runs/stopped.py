"""Limits of joints that stop a loop where its equality wants to go on, by the same run without them."""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.loops import Loops
from oarlock.diagnosis.runs.drifts import Drift
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.diagnosis.runs.walking import own_copy
from oarlock.diagnosis.runs.without import MOST, about, left_about
from oarlock.mechanics.names import element_name

RESTS = 0.5
"""Of the worst deviation, as a median while the joint is beyond its limit: less is a stop that a motion strikes."""

_LIMIT = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True)
class Stopped:
    """A joint's limit that opens an equality of its loop.

    Attributes:
        equality: its name; joint: whose limit it is; both of one loop.
        limit: where it is, rad or m; wanted: where the joint goes furthest beyond it at that moment without it.
        unit: of the two.
        drift: how far the equality opens in the run, m or rad; drift_without: the same about that moment without the
            limits of ``joint`` and ``others``.
        drift_unit: of those two.
        others: joints whose limits were taken away besides, for they push at such moments too.
    """

    equality: str
    joint: str
    limit: float
    wanted: float
    unit: str
    drift: float
    drift_without: float
    drift_unit: str
    others: tuple[str, ...]


def find_stopped(recording: Recording, drifts: list[Drift], loops: Loops, least: float) -> tuple[Stopped, ...]:
    """Looks at the moment at which each equality opens furthest.

    Args:
        recording: MuJoCo's run as configured.
        drifts: of its equalities.
        loops: at the closed start; their paths say which joints are of which loop.
        least: drifts below it are not worth a run, m or rad.
    """
    worst = {one.equality: one for one in drifts if one.level == "position" and one.largest > least}
    pressed = {
        loop.name: _pressed(recording, worst[loop.name], loop.path.joints) for loop in loops.loops if loop.name in worst
    }
    joints = sorted({joint for one in pressed.values() for joint, _ in one})
    if not joints:
        return ()
    model = own_copy(recording.model)
    model.jnt_limited[joints] = 0
    again = rerun(recording, model)
    if again is None:
        return ()
    found, names = [], [one.name for one in recording.layout.equalities]
    called = {joint: element_name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) for joint in joints}
    for name, ends in pressed.items():
        place = names.index(name)
        left = left_about(recording, place, again.position)
        if left.largest > (1.0 - MOST) * worst[name].largest:
            continue
        for joint, upper in ends:
            coordinate = again.qpos[about(recording, place), model.jnt_qposadr[joint]]
            limit = float(model.jnt_range[joint, int(upper)])
            wanted = float(coordinate.max() if upper else coordinate.min())
            if (wanted > limit) if upper else (wanted < limit):
                turns = (worst[name].radians or 0.0) > (worst[name].metres or 0.0)
                found.append(
                    Stopped(
                        equality=name,
                        joint=called[joint],
                        limit=limit,
                        wanted=wanted,
                        unit="m" if model.jnt_type[joint] == _SLIDE else "rad",
                        drift=worst[name].largest,
                        drift_without=left.largest,
                        drift_unit="rad" if turns else "m",
                        others=tuple(name for other, name in called.items() if other != joint),
                    )
                )
    return tuple(found)


def _pressed(recording: Recording, drift: Drift, joints: tuple[int, ...]) -> list[tuple[int, bool]]:
    """Joints of a loop whose limit pushes when its equality opens furthest, with whether it is the upper one."""
    model = recording.model
    data = mujoco.MjData(model)
    step = int(np.abs(recording.time - drift.time_s).argmin())
    data.qpos[:], data.qvel[:] = recording.qpos[step], recording.qvel[step]
    data.ctrl[:] = recording.ctrl[step]
    mujoco.mj_forward(model, data)
    place = [one.name for one in recording.layout.equalities].index(drift.equality)
    size = np.linalg.norm(recording.position[:, recording.layout.of_equality(place)], axis=1)
    found = []
    for row in range(data.ne, data.nefc):
        joint = int(data.efc_id[row])
        if data.efc_type[row] != _LIMIT or not data.efc_force[row] > 0.0 or joint not in joints:
            continue
        if model.jnt_type[joint] in (_HINGE, _SLIDE):
            address, (low, high) = model.jnt_qposadr[joint], model.jnt_range[joint]
            upper = bool(high - data.qpos[address] < data.qpos[address] - low)
            beyond = recording.qpos[:, address] > high if upper else recording.qpos[:, address] < low
            if beyond.any() and np.median(size[beyond]) >= RESTS * size[step]:
                found.append((joint, upper))
    return found
