"""Actuators that are position servos: where a control leads to, and which one holds a position."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.mechanics.names import element_name

_ON_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_ONE = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)
_GROUPS = 31
"""Of actuators that can be switched off."""
_FIXED = int(mujoco.mjtGain.mjGAIN_FIXED)


@dataclass(frozen=True)
class Servo:
    """A position servo: a force g u + b0 + b1 l of its control u and its length l = gear · q.

    Attributes:
        index: of the actuator; joint: that it drives, or tendon, of which q is the length; −1: not of that kind.
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
    tendon: int = -1

    def reached(self, control: float) -> float:
        """Where a control leads q to without a load, rad or m."""
        return (self.gain * control + self.constant) / (self.stiffness * self.gear)

    def holding(self, position: float) -> float:
        """The control that leads q there."""
        return (self.stiffness * self.gear * position - self.constant) / self.gain

    def told(self, model: mujoco.MjModel, control: float) -> float:
        """What MuJoCo makes of a control: the nearest one within the ctrlrange."""
        if not model.actuator_ctrllimited[self.index]:
            return control
        return float(np.clip(control, *model.actuator_ctrlrange[self.index]))


def moments(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """What every velocity gets of an actuator's force, (nu, nv); 0 of those that are switched off.

    The position stage of ``data`` is done.
    """
    found = np.zeros((model.nu, model.nv))
    if not model.nu or model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_ACTUATION:
        return found
    mujoco.mju_sparse2dense(found, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    group = model.actuator_group
    off = (group >= 0) & (group < _GROUPS) & (int(model.opt.disableactuator) >> np.clip(group, 0, _GROUPS - 1) & 1 == 1)
    found[off] = 0.0
    return found


def servos(model: mujoco.MjModel) -> Iterator[Servo]:
    """The position servos on hinges and slides."""
    for index in range(model.nu):
        joint = int(model.actuator_trnid[index, 0])
        if model.actuator_trntype[index] in _ON_JOINT and model.jnt_type[joint] in _ONE:
            yield from _servo(model, index, joint=joint)


def tendon_servos(model: mujoco.MjModel) -> Iterator[Servo]:
    """The position servos on tendons."""
    for index in np.flatnonzero(model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON).tolist():
        yield from _servo(model, index, tendon=int(model.actuator_trnid[index, 0]))


def holding(model: mujoco.MjModel, qpos: np.ndarray) -> np.ndarray | None:
    """Controls (nu) with which the position servos of a model hold a pose (nq), the others 0; None where all are.

    Those of joints and of tendons, each as far as its ctrlrange allows.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_fwdPosition(model, data)
    found = np.zeros(model.nu)
    for one in (*servos(model), *tendon_servos(model)):
        found[one.index] = one.told(model, one.holding(float(data.actuator_length[one.index]) / one.gear))
    return found if found.any() else None


def _servo(model: mujoco.MjModel, index: int, *, joint: int = -1, tendon: int = -1) -> Iterator[Servo]:
    gear, gain = float(model.actuator_gear[index, 0]), float(model.actuator_gainprm[index, 0])
    constant, slope = model.actuator_biasprm[index, :2].tolist()
    affine = model.actuator_biastype[index] == _AFFINE and model.actuator_gaintype[index] == _FIXED
    if affine and slope < 0.0 and gear and gain:
        name = element_name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, index)
        yield Servo(index, joint, name, gain, constant, -slope, gear, tendon)
