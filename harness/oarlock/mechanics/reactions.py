"""Which constraint reactions a rigid model determines.

Multipliers that the motion cannot tell apart differ by null vectors of Jᵀ: Jᵀ(λ + n) = Jᵀλ wherever Jᵀn = 0. The
multipliers of an equality are unique exactly if every such n vanishes on its rows (Frączek & Wojtyra, Mechanism and
Machine Theory 46 (2011) 312–334). A row of J that is zero, such as the out-of-plane row of a planar loop, carries no
reaction and makes none ambiguous.
"""

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.cases.case_file import Reactions
from oarlock.mechanics.names import element_name
from oarlock.mechanics.rows import closing_jacobian

ZERO_ROW = 1e-12
"""Relative to the largest entry of J. The core folds away rows whose entries are all smaller."""

VANISHES = 1e-6
"""Norm up to which null vectors of unit length count as zero on a row. Where an equality has a part in a redundancy it
is some tenths; where it has none, rounding over the gap of the singular values, 1e-10 or less."""


def unique_reactions(model: mujoco.MjModel, data: mujoco.MjData, rank: int) -> dict[str, bool]:
    """Tells which equalities have unique multipliers, at a state whose position stage is done.

    With M = L Lᵀ the singular values of J L⁻ᵀ are the square roots of the eigenvalues of A = J M⁻¹ Jᵀ, so that its left
    singular vectors beyond ``rank`` span null(A) = null(Jᵀ), without the squared condition number of A.

    Args:
        model: the model.
        data: the state.
        rank: rank of A as it was decided at the start, from the eigenvalues of A.

    Returns:
        Name of an equality → whether its multipliers are unique.
    """
    ne = data.ne
    jacobian = closing_jacobian(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    sizes = np.abs(jacobian).max(axis=1)
    rows = np.flatnonzero(sizes > ZERO_ROW * sizes.max())
    try:
        scaled = np.linalg.solve(np.linalg.cholesky(mass), jacobian[rows].T).T
    except np.linalg.LinAlgError:
        raise InputError(
            "the mass matrix is not positive definite at the start, expected masses, inertias and armatures > 0"
        ) from None
    null = np.linalg.svd(scaled)[0][:, rank:]
    part = np.zeros(ne)
    part[rows] = np.linalg.norm(null, axis=1)  # the same for every basis of the null space
    unique: dict[str, bool] = {}
    for row in range(ne):
        name = element_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, int(data.efc_id[row]))
        unique[name] = unique.get(name, True) and bool(part[row] <= VANISHES)
    return unique


def verdict(unique: dict[str, bool]) -> Reactions:
    """Says whether the multipliers of all equalities are unique, of some, or of none."""
    if all(unique.values()):
        return "unique"
    return "partly unique" if any(unique.values()) else "not unique"
