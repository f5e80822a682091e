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
from oarlock.mechanics.engine_version import full_mass
from oarlock.mechanics.folding import fold
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
    singular vectors beyond ``rank`` span null(A) = null(Jᵀ), without the squared condition number of A. Where no more
    classes of proportional rows are left than that, nothing has to be decomposed.

    Args:
        model: the model.
        data: the state.
        rank: rank of A as it was decided at the start, from the eigenvalues of A.

    Returns:
        Name of an equality → whether its multipliers are unique.
    """
    jacobian = closing_jacobian(model, data)
    sizes = np.abs(jacobian).max(axis=1)
    folded = fold(jacobian, sizes <= ZERO_ROW * sizes.max())
    count = len(folded.rows)
    # Of rows of one class every null vector is free but along their weights; of the classes, what is left of them.
    part = np.where(folded.alone | (folded.owner < 0), 0.0, 1.0 - np.square(folded.weights))
    if count > rank:
        try:
            scaled = np.linalg.solve(np.linalg.cholesky(full_mass(model, data)), folded.rows.T).T
        except np.linalg.LinAlgError:
            raise InputError(
                "the mass matrix is not positive definite at the start, expected masses, inertias and armatures > 0"
            ) from None
        null = np.linalg.svd(scaled, full_matrices=count > model.nv)[0][:, rank:]
        part += np.square(folded.weights) * np.square(null).sum(axis=1)[folded.owner]  # of every basis the same
    part = np.sqrt(np.maximum(part, 0.0))
    unique: dict[str, bool] = {}
    for row in range(data.ne):
        name = element_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, int(data.efc_id[row]))
        unique[name] = unique.get(name, True) and bool(part[row] <= VANISHES)
    return unique


def verdict(unique: dict[str, bool]) -> Reactions:
    """Says whether the multipliers of all equalities are unique, of some, or of none."""
    if all(unique.values()):
        return "unique"
    return "partly unique" if any(unique.values()) else "not unique"
