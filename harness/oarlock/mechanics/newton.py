"""Whether the answer of MuJoCo's Newton is the minimum that it should be.

MuJoCo 4.0.0 factors a sparse Hessian by groups of rows, and groups rows of different patterns too
(google-deepmind/mujoco#3767). Whether it does hangs on the patterns of J and M: of 250 random mechanisms with 1 to 60
connects it did in 17. Its iterations go astray then, or stop early. Where limits, friction and contacts do not act, a
right factor gives the minimum in one iteration, to rounding, and the gradient says whether it did: the cost is convex
with a curvature of M at least, so that an answer is off, in the norm of M, by the gradient in that of M⁻¹ at most.
"""

import mujoco
import numpy as np

from oarlock.base.vectors import norm
from oarlock.mechanics.engine_version import SPARSE_NEWTON_ERRS

ROUNDING = 1e-11
"""Gradient that the rounding of a right factor leaves, relative to the forces that it is the sum of: 1e-15 to 2e-13
were seen, and of wrong ones 4e-7 and more."""

TERMS = 3e-14
"""The same, relative to the terms of those forces, which are up to 1e8 times as large where rows are stiff. Of 150
random mechanisms at three softnesses right factors left 1e-15 at most, as those of dense Jacobians do, and wrong ones
9e-14 and more."""


_NEWTON = int(mujoco.mjtSolver.mjSOL_NEWTON)


def is_doubtful(model: mujoco.MjModel) -> bool:
    """Whether MuJoCo's solver may use a wrong factor."""
    # Asked at every step: what costs least comes first.
    return SPARSE_NEWTON_ERRS and bool(mujoco.mj_isSparse(model)) and model.opt.solver == _NEWTON


def gradient(model: mujoco.MjModel, data: mujoco.MjData, qacc: np.ndarray, qfrc: np.ndarray) -> float:
    """How far an answer (nv) is from the minimum that MuJoCo is after: ‖M a − f − Jᵀ λ‖ over ‖f‖ + ‖Jᵀ λ‖."""
    product = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, product, qacc)
    left, whole = norm(product - data.qfrc_smooth - qfrc), norm(data.qfrc_smooth) + norm(qfrc)
    return float(left / whole if whole > 0.0 else left)


def is_minimum(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Whether MuJoCo's own answer at a state, of a sparse Jacobian, is the minimum that it is after, to rounding."""
    left = gradient(model, data, data.qacc, data.qfrc_constraint)
    if not left > ROUNDING:
        return bool(left <= ROUNDING)
    smooth = norm(data.qfrc_smooth)
    return bool(left * (smooth + norm(data.qfrc_constraint)) <= TERMS * (smooth + norm(_terms(model, data))))


def _terms(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """|J|ᵀ D (|J| |a| + |aref|) of the rows that push: what Jᵀ λ is made of, for λ = D (aref − J a)."""
    lengths, starts = data.efc_J_rownnz[: data.nefc], data.efc_J_rowadr[: data.nefc]
    row = np.repeat(np.arange(data.nefc), lengths)
    place = np.arange(len(row)) + np.repeat(starts - (np.cumsum(lengths) - lengths), lengths)
    size, column = np.abs(data.efc_J[place]), data.efc_J_colind[place]
    # Sums from left to right.
    moved = np.bincount(row, size * np.abs(data.qacc)[column], data.nefc)
    push = np.where(data.efc_force == 0.0, 0.0, (moved + np.abs(data.efc_aref)) * data.efc_D)
    return np.bincount(column, size * push[row], model.nv)


def errs(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray) -> bool:
    """Whether MuJoCo's answer at a state is no minimum to rounding."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(model, data)
    return not is_minimum(model, data)


def forward(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """``mj_forward``, and ``confirm``."""
    mujoco.mj_forward(model, data)
    confirm(model, data)


def confirm(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Where MuJoCo's answer at a state may be wrong and is no minimum to rounding, asks once more, all stages.

    The Jacobian of the model is dense then, from there on: rows that other data of it hold are to be made anew.
    """
    if data.nefc and is_doubtful(model) and not is_minimum(model, data):
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        mujoco.mj_forward(model, data)
