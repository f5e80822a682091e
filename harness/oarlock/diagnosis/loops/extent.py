"""How large the loops of a model are: what lengths are to be compared with."""

import mujoco
import numpy as np

from oarlock.diagnosis.loops.loops import Loops
from oarlock.poses.assembly import anchors

POINTS = 1e-6
"""Of the whole model: loops of a smaller extent are single points, such as a weld's."""


def extent(model: mujoco.MjModel, loops: Loops, data: mujoco.MjData | None = None) -> float:
    """Largest extent along an axis of the joints and anchors of one group of loops, m.

    Of all groups it is the largest one's; joints that move freely are no part of it, nor are floors and loads. A model
    without such points has the extent that MuJoCo gives it.

    Args:
        model: any; left alone.
        loops: at the pose that is measured.
        data: mocap bodies; left alone.
    """
    own = mujoco.MjData(model)
    if data is not None:
        own.mocap_pos[:], own.mocap_quat[:] = data.mocap_pos, data.mocap_quat
    own.qpos[:] = loops.qpos
    mujoco.mj_kinematics(model, own)
    largest = 0.0
    for number in range(len(loops.groups)):
        points: list[np.ndarray] = []
        for member in loops.members(number):
            loop = loops.loops[member]
            free = model.jnt_type[list(loop.path.joints)] == mujoco.mjtJoint.mjJNT_FREE
            points += [own.xanchor[joint] for joint, flies in zip(loop.path.joints, free, strict=True) if not flies]
            if loop.equality.kind.joins_points:
                points += anchors(model, own, loop.equality)
        if points:
            largest = max(largest, float(np.ptp(np.array(points), axis=0).max()))
    whole = float(model.stat.extent)
    return largest if largest > POINTS * whole else whole
