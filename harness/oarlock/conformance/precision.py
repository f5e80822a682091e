"""What a precision explains of a difference, by a rule that holds for every engine.

The rows of a state are a problem (M + Jᵀ R⁻¹ J) a = f + Jᵀ R⁻¹ aref. It is disturbed as its inputs are in that
precision, and formed and solved in it: every entry of M and J by up to an ε of the largest of its row, f by one of its
largest entry, and aref by what an ε of the mechanism's extent makes of K d r and B J v. Of some draws the largest
change of a counts, times ``MARGIN``, for an engine adds roundings of its own on the way to M and J; at most
``CREDIBLE``.
"""

import mujoco
import numpy as np

from oarlock.conformance.laws import Laws, Solved, norms, scale
from oarlock.mechanics.engine_version import full_mass
from oarlock.mechanics.rows import jacobian

DRAWS = 6

MARGIN = 10.0
"""Roundings of an engine on the way to M and J, and of its own iteration, over one of each input."""

SETTLED = 1e-6
"""What iterations leave in double precision, of q̈: proximal solvers stop at 1e-8 … 1e-11, an engine in maximal
coordinates at 4e-7 as a rule (measured)."""

CREDIBLE = 0.2
"""Relative. A precision that would explain more than this explains nothing: any other cause would hide in it."""

_SEED = 0


def allowance(laws: Laws, solved: Solved, single: bool) -> np.ndarray:
    """Relative differences of q̈ that a precision explains, of each state and mechanism (n, blocks).

    Args:
        laws: of the model and its states.
        solved: their answers, by which the differences are measured.
        single: whether of float32; else of float64, where what iterations leave is allowed too.
    """
    kind = np.float32 if single else np.float64
    rng = np.random.default_rng(_SEED)
    data, found = mujoco.MjData(laws.model), np.zeros((len(laws.states), len(laws.blocks)))
    for number in range(len(found)):
        laws.place(data, number)
        mujoco.mj_forward(laws.model, data)
        found[number] = _lost(laws, data, kind, rng)
    lost = MARGIN * found / scale(solved)
    return np.minimum(lost if single else np.maximum(lost, SETTLED), CREDIBLE)


def _lost(laws: Laws, data: mujoco.MjData, kind: type, rng: np.random.Generator) -> np.ndarray:
    """Largest change ‖δa‖ of each mechanism (blocks) of a state over the draws."""
    model = laws.model
    active = np.flatnonzero(data.efc_force[: data.nefc] != 0.0)
    active = np.union1d(np.arange(data.ne), active).astype(int)
    rows, mass = jacobian(model, data)[active].copy(), full_mass(model, data)
    force = mass @ data.qacc_smooth
    aref, stiffness = data.efc_aref[active], data.efc_D[active]
    epsilon = np.finfo(kind).eps
    terms = np.abs(data.efc_KBIP[active])
    extent = float(np.abs(data.xpos - data.xpos.mean(axis=0)).max(initial=0.0) + np.abs(data.xpos).max(initial=0.0))
    open_by = terms[:, 0] * terms[:, 2] * extent + terms[:, 1] * (np.abs(rows) @ np.abs(data.qvel)) + np.abs(aref)
    true = _solution(mass, rows, force, aref, stiffness, np.float64)
    worst = np.zeros(len(laws.blocks))
    for _ in range(DRAWS):
        found = _solution(
            _moved(mass, _largest(mass), epsilon, rng),
            _moved(rows, _largest(rows), epsilon, rng),
            _moved(force, np.abs(force).max(initial=0.0), epsilon, rng),
            _moved(aref, open_by, epsilon, rng),
            stiffness,
            kind,
        )
        worst = np.maximum(worst, np.nan_to_num(norms((found - true)[None], laws.blocks)[0], nan=np.inf))
    return worst


def _largest(matrix: np.ndarray) -> np.ndarray:
    return np.abs(matrix).max(axis=1, initial=0.0, keepdims=True)


def _moved(values: np.ndarray, size: "np.ndarray | float", epsilon: float, rng: np.random.Generator) -> np.ndarray:
    return values + epsilon * size * rng.uniform(-1.0, 1.0, values.shape)


def _solution(
    mass: np.ndarray, rows: np.ndarray, force: np.ndarray, aref: np.ndarray, stiffness: np.ndarray, kind: type
) -> np.ndarray:
    mass, rows, force, aref, stiffness = (array.astype(kind) for array in (mass, rows, force, aref, stiffness))
    weighed = rows * stiffness[:, None]
    return np.linalg.solve(mass + weighed.T @ rows, force + weighed.T @ aref).astype(float)
