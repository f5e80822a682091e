"""Which reactions a rigid model leaves open because of what pushes beside the loops.

A limit, a contact or a friction that sticks is one more constraint of a rigid model while it holds. Where a vector n of
multipliers of the equalities does with some forces of those what it does without them, J_eᵀ n ∈ range(J_aᵀ), only the
softness of both decides between them: the reaction is unique without the contact, and is not beside it.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.runs.pushes import pushing_rows
from oarlock.mechanics.flexes import flex_equalities
from oarlock.mechanics.inequalities import row_name
from oarlock.mechanics.names import element_name
from oarlock.mechanics.reactions import VANISHES
from oarlock.mechanics.rows import jacobian


@dataclass(frozen=True)
class Beside:
    """An equality whose reaction is not unique beside others.

    Attributes:
        equality: its name.
        others: the limits, frictions and contacts that share its load.
        time_s: at which state it was looked.
    """

    equality: str
    others: tuple[str, ...]
    time_s: float


def find_beside(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Beside, ...]:
    """Looks at one state, whose forces are known."""
    ne, pushing = data.ne, pushing_rows(data)
    if not ne or not len(pushing):
        return ()
    rows = jacobian(model, data)
    sizes = np.linalg.norm(rows, axis=1)
    loops_only = ~np.isin(data.efc_id[:ne], flex_equalities(model))
    chosen = [
        *np.flatnonzero((sizes[:ne] > 0.0) & loops_only).tolist(),
        *[row for row in pushing.tolist() if sizes[row] > 0.0],
    ]
    unit = rows[chosen] / sizes[chosen, None]
    owners = np.array([int(data.efc_id[row]) if row < ne else -1 for row in chosen])
    loops = owners >= 0
    without, beside = _null(unit[loops]), _null(unit)
    found = []
    for owner in dict.fromkeys(owners[loops].tolist()):
        own = owners == owner
        free = beside[own]
        if _rank(free) == _rank(without[own[loops]]):
            continue
        # The part of null vectors that this equality takes part in.
        takes = np.linalg.svd(free)[2][: _rank(free)]
        shared = np.abs(beside[~loops] @ takes.T).max(axis=1, initial=0.0) > VANISHES
        names = [row_name(model, data, row) for row, here in zip(np.array(chosen)[~loops], shared, strict=True) if here]
        if names:
            name = element_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, owner)
            found.append(Beside(name, tuple(dict.fromkeys(names)), float(data.time)))
    return tuple(found)


def _null(rows: np.ndarray) -> np.ndarray:
    """Orthonormal basis (n, k) of the multipliers of unit rows (n, nv) that do nothing."""
    directions, sizes, _ = np.linalg.svd(rows)
    return directions[:, int((sizes > VANISHES * max(float(sizes.max(initial=0.0)), 1.0)).sum()) :]


def _rank(vectors: np.ndarray) -> int:
    return int((np.linalg.svd(vectors, compute_uv=False) > VANISHES).sum()) if vectors.size else 0
