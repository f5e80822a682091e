"""Actuators that are position servos of one joint: where a control leads to, and which one holds a position."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.mechanics.names import element_name

_ON_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_ONE = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)
_FIXED = int(mujoco.mjtGain.mjGAIN_FIXED)


@dataclass(frozen=True)
class Servo:
    """A position servo on a hinge or slide: a force g u + b0 + b1 l of its control u and its length l = gear · q.

    Attributes:
        index: of the actuator; joint: that it drives.
        name: of the actuator.
        gain: g; constant: b0; stiffness: −b1; gear.
    """

    index: int
    joint: int
    name: str
    gain: float
    constant: float
    stiffness: float
    gear: float

    def reached(self, control: float) -> float:
        """Where a control leads the joint to without a load, rad or m."""
        return (self.gain * control + self.constant) / (self.stiffness * self.gear)

    def holding(self, position: float) -> float:
        """The control that leads the joint there."""
        return (self.stiffness * self.gear * position - self.constant) / self.gain

    def told(self, model: mujoco.MjModel, control: float) -> float:
        """What MuJoCo makes of a control: the nearest one within the ctrlrange."""
        if not model.actuator_ctrllimited[self.index]:
            return control
        return float(np.clip(control, *model.actuator_ctrlrange[self.index]))


def servos(model: mujoco.MjModel) -> Iterator[Servo]:
    """The position servos on hinges and slides."""
    for index in range(model.nu):
        joint, gear = int(model.actuator_trnid[index, 0]), float(model.actuator_gear[index, 0])
        constant, slope = model.actuator_biasprm[index, :2].tolist()
        gain = float(model.actuator_gainprm[index, 0])
        if model.actuator_biastype[index] != _AFFINE or model.actuator_gaintype[index] != _FIXED:
            continue
        if model.actuator_trntype[index] not in _ON_JOINT or model.jnt_type[joint] not in _ONE:
            continue
        if slope < 0.0 and gear and gain:
            name = element_name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, index)
            yield Servo(index, joint, name, gain, constant, -slope, gear)
