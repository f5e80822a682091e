"""S6: an equality that is closed in the model's own pose by definition, and open in a keyframe.

The second anchor of a connect, and the relative pose of a weld where none is given, are what they are in the model's
own pose. So that pose says nothing about the mechanism; a keyframe that stands open says that one of the two is wrong.
"""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from oarlock.diagnosis.lint.view import Remark, View, told
from oarlock.mechanics.names import Equality, element_name
from oarlock.poses.assembly import anchors

OPEN = 0.01
"""Of the size of the mechanism: a keyframe that is open by less was written with few digits, or settled under load."""

EXACT = 1e-9
"""Of the size: what was computed from the pose is closed there to rounding."""

ROUNDED = 1e-9
"""m, and of a quaternion: less is rounding of a zero."""

KEYFRAMES = 50
"""So many are looked at."""


def look(view: View) -> Iterator[Remark]:
    """A remark an equality, at the keyframe in which it stands open most."""
    model = view.model
    joins = [one for one in view.equalities if one.kind.joins_points and one.sites is None]
    joins = [one for one in joins if not any(model.body_mocapid[body] >= 0 for body in one.bodies)]
    if not joins or not model.nkey:
        return
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    size = view.size
    joins = [one for one in joins if _gap(model, data, one) <= EXACT * max(size, 1.0)]
    worst: dict[str, tuple[float, int]] = {}
    for key in range(min(model.nkey, KEYFRAMES)):
        mujoco.mj_resetDataKeyframe(model, data, key)
        mujoco.mj_kinematics(model, data)
        for one in joins:
            worst[one.name] = max(worst.get(one.name, (0.0, -1)), (_gap(model, data, one), key))
    for name, (gap, key) in worst.items():
        if gap > OPEN * size:
            keyframe = element_name(model, mujoco.mjtObj.mjOBJ_KEY, key)
            figures: dict[str, Any] = {"keyframe": keyframe, "gap": gap}
            said = f"stands open by {told(gap)} m in keyframe '{keyframe}'; it is closed in the model's own pose, "
            one = next(each for each in joins if each.name == name)
            if one.kind.turns:
                mujoco.mj_resetDataKeyframe(model, data, key)
                mujoco.mj_kinematics(model, data)
                wanted = figures["wanted"] = " ".join(f"{value:.6g}" for value in relative_pose(model, data, one))
                said += f'of which it holds the relative pose: with relpose="{wanted}" it holds that of the keyframe'
            else:
                said += (
                    "but only because MuJoCo defines its second anchor there: one of the two poses is not what was "
                    "meant"
                )
            yield Remark("S6", said, name, figures=figures)


def relative_pose(model: mujoco.MjModel, data: mujoco.MjData, one: Equality) -> np.ndarray:
    """The pose (7) of the second body of a weld, at its anchor, in the frame of the first, as relpose has it in a file.

    Args:
        model: with the weld.
        data: at a state whose kinematics are done.
        one: the weld, of two bodies.
    """
    first, second = one.bodies
    place = data.xpos[second] + data.xmat[second].reshape(3, 3) @ model.eq_data[one.index, :3]
    position = data.xmat[first].reshape(3, 3).T @ (place - data.xpos[first])
    back, turn = np.zeros(4), np.zeros(4)
    mujoco.mju_negQuat(back, data.xquat[first])
    mujoco.mju_mulQuat(turn, back, data.xquat[second])
    found = np.concatenate([position, turn])
    return np.where(np.abs(found) < ROUNDED, 0.0, found)


def _gap(model: mujoco.MjModel, data: mujoco.MjData, one: Equality) -> float:
    first, second = anchors(model, data, one)
    return float(np.linalg.norm(first - second))
