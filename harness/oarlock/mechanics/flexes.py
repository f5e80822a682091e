"""Equalities of flexes, whose rows are not known here: which they are, and what is joined to them."""

import copy

import mujoco
import numpy as np

from oarlock.mechanics.names import element_name, equalities


def flex_equalities(model: mujoco.MjModel) -> list[int]:
    """Numbers of the equalities of a kind whose rows are not known."""
    return [equality.index for equality in equalities(model) if not equality.kind.known]


def flex_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of the flexes that equalities hold."""
    ids = dict.fromkeys(int(model.eq_obj1id[index]) for index in flex_equalities(model))
    return tuple(element_name(model, mujoco.mjtObj.mjOBJ_FLEX, index) for index in ids)


def without_flexes(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy whose flexes are not held by equalities; the model itself where there are none."""
    held = flex_equalities(model)
    if not held:
        return model
    own = copy.deepcopy(model)
    own.eq_active0[held] = 0
    return own


def joined(model: mujoco.MjModel, dofs: list[int]) -> bool:
    """Whether a vertex of such a flex moves in a kinematic tree that has one of some degrees of freedom (``dofs``)."""
    trees = {int(model.dof_treeid[dof]) for dof in dofs}
    for index in flex_equalities(model):
        flex = int(model.eq_obj1id[index])
        first, count = int(model.flex_vertadr[flex]), int(model.flex_vertnum[flex])
        bodies = np.unique(model.flex_vertbodyid[first : first + count])
        if trees & set(model.body_treeid[bodies].tolist()):
            return True
    return False
