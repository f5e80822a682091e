"""Contacts, limits and friction, which are refused or switched off.

MuJoCo solves them jointly with the loops; oarlock's solvers do not know them.
"""

import mujoco
import numpy as np

from oarlock.base.errors import RefusedError, few
from oarlock.mechanics.names import element_name

OPTION = "--ignore-inequalities"

_BITS = mujoco.mjtDisableBit
IGNORED = _BITS.mjDSBL_CONTACT | _BITS.mjDSBL_LIMIT | _BITS.mjDSBL_FRICTIONLOSS
"""Flags of MuJoCo that switch contacts, limits and friction off."""

_KINDS = {
    mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF: ("friction of joint", mujoco.mjtObj.mjOBJ_JOINT),
    mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON: ("friction of tendon", mujoco.mjtObj.mjOBJ_TENDON),
    mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT: ("limit of joint", mujoco.mjtObj.mjOBJ_JOINT),
    mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON: ("limit of tendon", mujoco.mjtObj.mjOBJ_TENDON),
}


def _row_name(model: mujoco.MjModel, data: mujoco.MjData, row: int) -> str:
    kind, index = mujoco.mjtConstraint(data.efc_type[row]), int(data.efc_id[row])
    if kind in _KINDS:
        label, object_type = _KINDS[kind]
        if kind == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF:
            index = int(model.dof_jntid[index])
        return f"{label} '{element_name(model, object_type, index)}'"
    geoms = [int(geom) for geom in data.contact[index].geom]
    if min(geoms) < 0:
        return "a contact of a flex"
    names = [element_name(model, mujoco.mjtObj.mjOBJ_GEOM, geom) for geom in geoms]
    return f"contact between geoms '{names[0]}' and '{names[1]}'"


def refuse_inequalities(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Checks that only equality rows are active.

    Raises:
        RefusedError: rows of contacts, limits or friction are active; the message names the elements and the time.
    """
    if data.nefc == data.ne:
        return
    rows = np.flatnonzero(data.efc_type != mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    names = list(dict.fromkeys(_row_name(model, data, int(row)) for row in rows))
    verb, them = ("is", "it") if len(names) == 1 else ("are", "them")
    raise RefusedError(
        f"{few(names, last='')} {verb} active at t = {data.time:g} s, expected equality rows only: disable {them} "
        f"in the model (contype/conaffinity, limited, frictionloss), or run with {OPTION}"
    )


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
    if model.npair or (model.geom_contype.any() and model.geom_conaffinity.any()) or model.nflex:
        said.insert(0, "contacts")
    model.opt.disableflags |= IGNORED
    return "; ".join(said) or "none in the model"
