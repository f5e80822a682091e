"""Contacts, limits and friction loss: whether a model has any, what is refused, and how they are switched off."""

from typing import Literal

import mujoco
import numpy as np

from oarlock.base.errors import RefusedError, few
from oarlock.base.text import called
from oarlock.mechanics.names import element_name

OPTION = "--ignore-inequalities"
"""Flag of the commands that switches them off."""

_BITS = mujoco.mjtDisableBit
IGNORED = _BITS.mjDSBL_CONTACT | _BITS.mjDSBL_LIMIT | _BITS.mjDSBL_FRICTIONLOSS
"""Flags of MuJoCo that switch contacts, limits and friction off."""


Kind = Literal["friction", "limit", "contact"]

_CONSTRAINT = mujoco.mjtConstraint
PYRAMIDAL = int(_CONSTRAINT.mjCNSTR_CONTACT_PYRAMIDAL)
ELLIPTIC = int(_CONSTRAINT.mjCNSTR_CONTACT_ELLIPTIC)
"""Kinds of rows (``efc_type``) of contacts with several."""

KINDS: dict[int, Kind] = {
    int(_CONSTRAINT.mjCNSTR_FRICTION_DOF): "friction",
    int(_CONSTRAINT.mjCNSTR_FRICTION_TENDON): "friction",
    int(_CONSTRAINT.mjCNSTR_LIMIT_JOINT): "limit",
    int(_CONSTRAINT.mjCNSTR_LIMIT_TENDON): "limit",
    int(_CONSTRAINT.mjCNSTR_CONTACT_FRICTIONLESS): "contact",
    PYRAMIDAL: "contact",
    ELLIPTIC: "contact",
}
"""Kind of a row (``efc_type``) → what it is of."""

_TURNING = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_BALL))

_KINDS = {
    mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF: ("friction", "joint", mujoco.mjtObj.mjOBJ_JOINT),
    mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON: ("friction", "tendon", mujoco.mjtObj.mjOBJ_TENDON),
    mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT: ("limit", "joint", mujoco.mjtObj.mjOBJ_JOINT),
    mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON: ("limit", "tendon", mujoco.mjtObj.mjOBJ_TENDON),
}


def row_name(model: mujoco.MjModel, data: mujoco.MjData, row: int) -> str:
    """What a row of a limit, friction loss or contact is of, in words that name it."""
    kind, index = mujoco.mjtConstraint(data.efc_type[row]), int(data.efc_id[row])
    if kind in _KINDS:
        label, element, object_type = _KINDS[kind]
        if kind == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF:
            index = int(model.dof_jntid[index])
        return f"{label} of {called(element, element_name(model, object_type, index))}"
    geoms = [int(geom) for geom in data.contact[index].geom]
    if min(geoms) < 0:
        return "contact with a flex"
    return f"contact between {' and '.join(_of_body(model, geom) for geom in geoms)}"


def row_unit(model: mujoco.MjModel, data: mujoco.MjData, row: int) -> str:
    """Unit of the force of a row of a limit, friction loss or contact: N m about a hinge or ball, else N.

    A fixed tendon, which is a sum of joints, is taken for what its first joint is.
    """
    kind, index = int(data.efc_type[row]), int(data.efc_id[row])
    if kind == int(_CONSTRAINT.mjCNSTR_FRICTION_DOF):
        joint = int(model.dof_jntid[index])
        if int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_FREE):
            return "N m" if index >= model.jnt_dofadr[joint] + 3 else "N"
    elif kind == int(_CONSTRAINT.mjCNSTR_LIMIT_JOINT):
        joint = index
    elif kind in (int(_CONSTRAINT.mjCNSTR_LIMIT_TENDON), int(_CONSTRAINT.mjCNSTR_FRICTION_TENDON)):
        first = int(model.tendon_adr[index])
        if int(model.wrap_type[first]) != int(mujoco.mjtWrap.mjWRAP_JOINT):
            return "N"
        joint = int(model.wrap_objid[first])
    else:
        return "N"
    return "N m" if int(model.jnt_type[joint]) in _TURNING else "N"


def _of_body(model: mujoco.MjModel, geom: int) -> str:
    """A geom by its name, or by that of its body where it has none."""
    if model.geom(geom).name:
        return f"geom '{model.geom(geom).name}'"
    body = int(model.geom_bodyid[geom])
    return "the world" if body == 0 else f"body '{element_name(model, mujoco.mjtObj.mjOBJ_BODY, body)}'"


def may_act(model: mujoco.MjModel) -> bool:
    """Whether rows of contacts, limits or friction loss may become active."""
    disabled = model.opt.disableflags
    limited = bool(model.jnt_limited.any() or model.tendon_limited.any())
    rubs = bool(model.dof_frictionloss.any() or model.tendon_frictionloss.any())
    return (
        (limited and not disabled & _BITS.mjDSBL_LIMIT)
        or (rubs and not disabled & _BITS.mjDSBL_FRICTIONLOSS)
        or (_may_touch(model) and not disabled & _BITS.mjDSBL_CONTACT)
    )


def refuse_unsupported(model: mujoco.MjModel) -> None:
    """Refuses what MuJoCo solves in another way than by rows.

    Raises:
        RefusedError: contacts of flexes by incremental potentials, which the model's flag ``ipc`` asks for.
    """
    flag = getattr(mujoco.mjtEnableBit, "mjENBL_IPC", None)
    if flag is not None and model.opt.enableflags & flag and model.nflex:
        raise RefusedError(
            "the flag ipc is enabled and the model has a flex, whose contacts are no constraint rows then: expected it "
            f"disabled in the model, or {OPTION}"
        )


def _may_touch(model: mujoco.MjModel) -> bool:
    return bool(model.npair or model.nflex or (model.geom_contype.any() and model.geom_conaffinity.any()))


def ignore_inequalities(model: mujoco.MjModel) -> str:
    """Switches contacts, limits and friction of a model off, in place.

    Returns:
        One line that lists those that the model has.
    """
    joint, tendon = mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_TENDON
    rubbing = dict.fromkeys(int(model.dof_jntid[dof]) for dof in np.flatnonzero(model.dof_frictionloss))
    kinds = [
        ("limits of joints", joint, np.flatnonzero(model.jnt_limited)),
        ("limits of tendons", tendon, np.flatnonzero(model.tendon_limited)),
        ("friction of joints", joint, list(rubbing)),
        ("friction of tendons", tendon, np.flatnonzero(model.tendon_frictionloss)),
    ]
    said = [
        f"{label} {few([element_name(model, kind, int(index)) for index in indices], last='')}"
        for label, kind, indices in kinds
        if len(indices)
    ]
    if _may_touch(model):
        said.insert(0, "contacts")
    model.opt.disableflags |= IGNORED
    return "; ".join(said) or "none in the model"
