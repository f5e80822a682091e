"""What equalities couple: joints and tendons, each with a position x that is measured from the model's own pose."""

from typing import Protocol

import mujoco

from oarlock.cases.equality_kinds import EqualityKind
from oarlock.mechanics.engine_version import tendon_dofs

_JOINT, _TENDON = mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_TENDON
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)


class Coupled(Protocol):
    """One sort of element that equalities couple."""

    object_type: mujoco.mjtObj

    def unit(self, model: mujoco.MjModel, index: int) -> str:
        """Unit of an element's x: ``m``, ``rad``, or ``m or rad``."""
        ...

    def effort(self, model: mujoco.MjModel, index: int) -> str:
        """Unit of what acts along x: ``N`` or ``N m``."""
        ...

    def dofs(self, model: mujoco.MjModel, indices: list[int]) -> list[int]:
        """Degrees of freedom that move several elements."""
        ...

    def position(self, model: mujoco.MjModel, data: mujoco.MjData, index: int) -> float:
        """The x (m or rad) of a state whose position stage is done."""
        ...


class _Joints:
    object_type = _JOINT

    def unit(self, model: mujoco.MjModel, index: int) -> str:
        return "m" if model.jnt_type[index] == _SLIDE else "rad"

    def effort(self, model: mujoco.MjModel, index: int) -> str:
        return "N" if model.jnt_type[index] == _SLIDE else "N m"

    def dofs(self, model: mujoco.MjModel, indices: list[int]) -> list[int]:
        return [int(model.jnt_dofadr[joint]) for joint in indices]

    def position(self, model: mujoco.MjModel, data: mujoco.MjData, index: int) -> float:
        address = int(model.jnt_qposadr[index])
        return float(data.qpos[address] - model.qpos0[address])


class _Tendons:
    object_type = _TENDON

    def unit(self, model: mujoco.MjModel, index: int) -> str:
        start, count = int(model.tendon_adr[index]), int(model.tendon_num[index])
        if model.wrap_type[start] != mujoco.mjtWrap.mjWRAP_JOINT:
            return "m"
        joints = model.wrap_objid[start : start + count]
        units = {"m" if model.jnt_type[joint] == _SLIDE else "rad" for joint in joints}
        return units.pop() if len(units) == 1 else "m or rad"

    def effort(self, model: mujoco.MjModel, index: int) -> str:
        return "N"

    def dofs(self, model: mujoco.MjModel, indices: list[int]) -> list[int]:
        return sorted({dof for tendon in indices for dof in tendon_dofs(model, tendon)})

    def position(self, model: mujoco.MjModel, data: mujoco.MjData, index: int) -> float:
        return float(data.ten_length[index] - model.tendon_length0[index])


COUPLED: dict[str, Coupled] = {"joints": _Joints(), "tendons": _Tendons()}
"""What an equality kind holds → what it couples."""


def coupled(kind: EqualityKind) -> Coupled:
    """What equalities of a kind that holds joints or tendons couple."""
    return COUPLED[kind.holds]


def coupled_ids(model: mujoco.MjModel, equality: int) -> list[int]:
    """Ids of the one or two elements that an equality couples, by its number in the model."""
    ids = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
    return [index for index in ids if index >= 0]
