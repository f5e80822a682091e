"""A2: controls that lead a servo many times beyond what its joints can do: counts, per cent or millimetres for metres.

MuJoCo takes the control of a position servo for a length or an angle. One of 255 for a jaw that opens by 25 mm presses
it against its limit with kp times 255 m, and pulls apart whatever couples it to others.
"""

from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.base.text import called
from oarlock.diagnosis.lint.unit import in_degrees
from oarlock.diagnosis.lint.view import JOINT, TENDON, Remark, View
from oarlock.mechanics.names import element_name
from oarlock.mechanics.servos import Servo, servos, tendon_servos

FAR = 10.0
"""Times the whole reach, beyond its end: a target that is to press, or an open ctrlrange, is nearer."""

MILLI = 1e-3
"""What millimetres are of a metre."""

ROOM = 0.1
"""Of the reach: so far beyond it a number of millimetres still is one that was meant."""

_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)


def look(view: View) -> Iterator[Remark]:
    """A remark a servo whose control, held in the run, leads that far, and whose force nothing limits."""
    model = view.model
    for one in (*servos(model), *tendon_servos(model)):
        joints = _joints(model, one)
        reach = _reach(model, one, joints)
        if reach is None or model.actuator_forcelimited[one.index] or model.jnt_actfrclimited[joints].any():
            continue
        control = one.told(model, float(view.data.ctrl[one.index]))
        told = one.reached(control)
        low, high = reach
        if max(low - told, told - high) <= FAR * (high - low):
            continue
        if one.joint >= 0 and in_degrees(view, one.joint, told):
            continue  # which is said of all that have it
        yield _remark(view, one, joints, control, told, (low, high))


def _joints(model: mujoco.MjModel, one: Servo) -> list[int]:
    """The joints that a servo drives, itself or by a fixed tendon; none of another tendon."""
    if one.joint >= 0:
        return [one.joint]
    first, count = int(model.tendon_adr[one.tendon]), int(model.tendon_num[one.tendon])
    if (model.wrap_type[first : first + count] != mujoco.mjtWrap.mjWRAP_JOINT).any():
        return []
    return model.wrap_objid[first : first + count].tolist()


def _reach(model: mujoco.MjModel, one: Servo, joints: list[int]) -> tuple[float, float] | None:
    """What q of a servo can be, m or rad, by the ranges of its joints; None where they leave it open."""
    if not joints or not model.jnt_limited[joints].all():
        return None
    weights = np.ones(1)
    if one.joint < 0:
        first = int(model.tendon_adr[one.tendon])
        weights = model.wrap_prm[first : first + len(joints)]
    ends = np.sort(weights[:, None] * model.jnt_range[joints], axis=1).sum(axis=0)
    return (float(ends[0]), float(ends[1])) if ends[1] > ends[0] else None


def _remark(
    view: View, one: Servo, joints: list[int], control: float, told: float, reach: tuple[float, float]
) -> Remark:
    model, (low, high) = view.model, reach
    slides = all(model.jnt_type[joint] == _SLIDE for joint in joints)
    unit = "m" if slides else "rad"
    kind, index = ("joint", one.joint) if one.joint >= 0 else ("tendon", one.tendon)
    led = called(kind, element_name(model, JOINT if kind == "joint" else TENDON, index))
    end = high if told > high else low
    said = (
        f"{control:g} leads {led} to {told:.4g} {unit}, and its range ends at {end:.4g} {unit}: a control is in {unit},"
    )
    wanted = control * MILLI
    room = ROOM * (high - low)
    if slides and low - room <= one.reached(wanted) <= high + room:
        said += f" millimetres were meant? {control:g} mm are {wanted:g}"
    else:
        wanted = one.holding(end)
        said += f" another unit was meant? {wanted:.4g} leads it to its end"
        gain = _gain(model, one, end)
        if gain is not None:
            ends = " ".join(f"{value:g}" for value in model.actuator_ctrlrange[one.index])
            said += f"; for its ctrlrange {ends} to be that range, gainprm {gain:.4g} in place of {one.gain:g}"
    names = [element_name(model, JOINT, joint) for joint in joints]
    figures = {"also": [], "joints": names, "wanted": wanted, "loops": view.around(joints)}
    return Remark("A2", f"ctrl {said}", one.name, "error", figures)


def _gain(model: mujoco.MjModel, one: Servo, end: float) -> float | None:
    """The gain with which the end of its ctrlrange leads to the end of its range; None where there is no such thing."""
    if not model.actuator_ctrllimited[one.index]:
        return None
    far = max(model.actuator_ctrlrange[one.index].tolist(), key=abs)
    return one.gain * one.holding(end) / far if far and one.holding(end) * far > 0.0 and not one.constant else None
