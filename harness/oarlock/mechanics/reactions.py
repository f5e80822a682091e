"""Which constraint reactions a rigid model determines.

Multipliers that the motion cannot tell apart differ by null vectors of Jᵀ: Jᵀ(λ + n) = Jᵀλ wherever Jᵀn = 0. The
multipliers of an equality are unique exactly if every such n vanishes on its rows (Frączek & Wojtyra, Mechanism and
Machine Theory 46 (2011) 312–334). A row of J that is zero, such as the out-of-plane row of a planar loop, carries no
reaction and makes none ambiguous.
"""

import mujoco
import numpy as np

from oarlock.cases.case_file import Reactions
from oarlock.mechanics.names import element_name
from oarlock.mechanics.rows import closing_jacobian

ZERO_ROW = 1e-12
"""Relative to the largest entry of J: the core folds away rows that are no larger."""

VANISHES = 1e-6
"""Null vectors of unit length share a redundancy among the equalities that have a part in it, each with some tenths;
where an equality has no part they carry rounding over the gap of the singular values, 1e-10 or less."""


def unique_reactions(model: mujoco.MjModel, data: mujoco.MjData, rank: int) -> dict[str, bool]:
    """Equality → whether its multipliers are unique, at a state whose position stage is done.

    The rank is not decided here again: it is the one that the start was found with, from the eigenvalues of
    A = J M⁻¹ Jᵀ. With M = L Lᵀ the singular values of J L⁻ᵀ are their square roots, so that its left singular vectors
    beyond ``rank`` span null(A) = null(Jᵀ), without the squared condition number of A.
    """
    ne = data.ne
    jacobian = closing_jacobian(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    sizes = np.abs(jacobian).max(axis=1)
    rows = np.flatnonzero(sizes > ZERO_ROW * sizes.max())
    scaled = np.linalg.solve(np.linalg.cholesky(mass), jacobian[rows].T).T
    null = np.linalg.svd(scaled)[0][:, rank:]
    part = np.zeros(ne)
    part[rows] = np.linalg.norm(null, axis=1)  # the same for every basis of the null space
    unique: dict[str, bool] = {}
    for row in range(ne):
        name = element_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, int(data.efc_id[row]))
        unique[name] = unique.get(name, True) and bool(part[row] <= VANISHES)
    return unique


def verdict(unique: dict[str, bool]) -> Reactions:
    """The equalities taken together: all, some or none of them determined."""
    if all(unique.values()):
        return "unique"
    return "partly unique" if any(unique.values()) else "not unique"
