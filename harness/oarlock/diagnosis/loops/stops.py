"""Whether a mechanism can still move at a closed pose with its limits as stops.

Limits that are reached admit the velocities v with J_e v = 0 and J_l v ≥ 0. With a basis Z of null(J_e) and G = J_l Z
that is G z ≥ 0, and only z = 0 is left if G has full column rank and 0 is a positive combination of its rows (Stiemke
1915).
"""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.mechanics.inequalities import KINDS, row_name
from oarlock.mechanics.reactions import VANISHES
from oarlock.mechanics.rows import jacobian

REACHED = 1e-9
"""rad or m. A limit so near is reached: closing a pose leaves rounding."""

_ROUNDS = 2000
_LIMITS = [kind for kind, of in KINDS.items() if of == "limit"]


@dataclass(frozen=True)
class Stops:
    """The limits that lock a mechanism at a pose: by name, with the degrees of freedom that its loops leave."""

    limits: tuple[str, ...]
    dof: int


def find_stops(model: mujoco.MjModel, data: mujoco.MjData) -> Stops | None:
    """The limits that leave no motion at a closed pose; None if something can move, or could not without them.

    Args:
        model: any with equalities.
        data: the pose; its position stage is computed anew.
    """
    model = copy.copy(model)
    model.jnt_margin[:] = np.maximum(model.jnt_margin, 2.0 * REACHED)
    model.tendon_margin[:] = np.maximum(model.tendon_margin, 2.0 * REACHED)
    mujoco.mj_fwdPosition(model, data)
    rows, kinds = jacobian(model, data), data.efc_type
    reached = np.flatnonzero(np.isin(kinds, _LIMITS) & (data.efc_pos <= REACHED))
    if not len(reached):
        return None
    _, sizes, directions = np.linalg.svd(rows[: data.ne])
    rank = int((sizes > VANISHES * sizes.max(initial=0.0)).sum())
    free = directions[rank:].T
    if not free.shape[1]:
        return None
    along = rows[reached] @ free
    lengths = np.linalg.norm(along, axis=1)
    holding = lengths > VANISHES
    unit = along[holding] / lengths[holding, None]
    # Coordinates that no limit concerns are free.
    if np.linalg.matrix_rank(unit, tol=1e-6) < free.shape[1] or not _balances(unit):
        return None
    names = [row_name(model, data, int(row)) for row in reached[holding]]
    return Stops(tuple(dict.fromkeys(names)), free.shape[1])


def _balances(rows: np.ndarray) -> bool:
    """Whether some positive combination of unit rows (k, d) is zero."""
    weights = np.ones(len(rows))
    step = 1.0 / max(float(np.linalg.eigvalsh(rows @ rows.T).max(initial=0.0)), 1.0)
    for _ in range(_ROUNDS):
        weights = np.maximum(weights - step * (rows @ (rows.T @ weights)), 1.0)
    return float(np.linalg.norm(rows.T @ weights)) < 1e-6 * float(weights.max())
