"""A3: a keyframe without controls, in which position servos are told to be elsewhere.

A keyframe that gives no ctrl has zeros. A position servo takes them for a target: from the first step it pulls its
joint there with all its stiffness, as if it had been hit.
"""

from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.base.text import quoted
from oarlock.diagnosis.lint.unit import degrees
from oarlock.diagnosis.lint.view import JOINT, Remark, View, told
from oarlock.mechanics.names import element_name
from oarlock.mechanics.servos import Servo, servos

JUMP = 0.3
"""rad, on a slide of the size of the mechanism: what a servo is off by under its load is less."""

ROUNDED = 1e-6
"""Relative, of coordinates: a start that is a keyframe but for closing it to rounding."""

KEYFRAMES = 50
"""So many are looked at."""


def look(view: View) -> Iterator[Remark]:
    """A remark a keyframe, with its servo that jumps furthest."""
    model = view.model
    every = [one for one in servos(model) if model.actuator_dyntype[one.index] == mujoco.mjtDyn.mjDYN_NONE]
    for key in range(min(model.nkey, KEYFRAMES) if every else 0):
        if model.key_ctrl[key].any():
            continue
        places = [float(model.key_qpos[key, model.jnt_qposadr[one.joint]]) for one in every]
        jumps = [abs(place - one.reached(one.told(model, 0.0))) for one, place in zip(every, places, strict=True)]
        sizes = [view.size if _slides(model, one) else 1.0 for one in every]
        far = [at for at, (jump, size) in enumerate(zip(jumps, sizes, strict=True)) if jump > JUMP * size > 0.0]
        far = [at for at in far if _slides(model, every[at]) or not degrees(places[at])]  # that is another mistake (A2)
        if far:
            far.sort(key=lambda at: -jumps[at] / sizes[at])
            yield _remark(view, key, every, places, jumps, far)


def _remark(
    view: View, key: int, every: list[Servo], places: list[float], jumps: list[float], far: list[int]
) -> Remark:
    model, worst = view.model, far[0]
    holding = np.zeros(model.nu)
    for one, place in zip(every, places, strict=True):
        holding[one.index] = one.told(model, one.holding(place))
    written = " ".join(f"{value + 0.0:.6g}" for value in holding)
    unit = "m" if _slides(model, every[worst]) else "rad"
    joint = quoted(element_name(model, JOINT, every[worst].joint))
    others = f", and {len(far) - 1} more do" if far[1:] else ""
    said = (
        f"the keyframe gives no ctrl, and {joint} stands at {told(places[worst])} {unit}: servo "
        f'{quoted(every[worst].name)} jumps by {told(jumps[worst])} {unit}{others}; ctrl="{written}" holds the pose'
    )
    own = np.allclose(model.key_qpos[key], view.data.qpos, rtol=ROUNDED, atol=ROUNDED) and not view.data.ctrl.any()
    loops = view.around(every[at].joint for at in far) if own else []
    name = element_name(model, mujoco.mjtObj.mjOBJ_KEY, key)
    return Remark("A3", said, name, figures={"jump": jumps[worst], "wanted": holding.tolist(), "loops": loops})


def _slides(model: mujoco.MjModel, one: Servo) -> bool:
    return bool(model.jnt_type[one.joint] == mujoco.mjtJoint.mjJNT_SLIDE)
