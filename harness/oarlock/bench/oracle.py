"""The exact answer to the constraint problem of one state, in sixty digits.

M, J, a₀ and aref are taken as the exact values of their doubles. A = J M⁻¹ Jᵀ is taken apart into F Fᵀ by Cholesky's
method with complete pivoting, until what is left is rounding of the doubles; A⁺b = F (FᵀF)⁻² Fᵀ b.
"""

from decimal import MAX_EMAX, MIN_EMIN, Context, Decimal, localcontext
from typing import Any, NamedTuple

import numpy as np

DIGITS = 60

CUT = Decimal("1e-25")
"""Pivots below this part of the first count as zero: far below the 1e-12 of a state 1e-6 from a singular pose, far
above the (1e-16)² that doubles leave of a row that repeats others."""

Numbers = Any
"""An array of decimals: numpy knows them as objects."""


class Exact(NamedTuple):
    """The answer, rounded to doubles.

    Attributes:
        multipliers: A⁺b (n), of minimum norm.
        acceleration: a₀ + M⁻¹ Jᵀ A⁺ b (nv).
        rank: of A.
    """

    multipliers: np.ndarray
    acceleration: np.ndarray
    rank: int


def exact(
    mass: np.ndarray, jacobian: np.ndarray, unconstrained: np.ndarray, aref: np.ndarray, rank: int | None = None
) -> Exact:
    """Solves A λ = b.

    Args:
        mass: M (nv, nv).
        jacobian: J (n, nv).
        unconstrained: a₀ = M⁻¹ f (nv).
        aref: accelerations asked of the rows (n).
        rank: of A, where the structure tells: loops that stand open by 1e-12 make rows differ that are the same by
            structure. Pivots decide, if left out.
    """
    with localcontext(Context(prec=DIGITS, Emax=MAX_EMAX, Emin=MIN_EMIN)):
        J, free = _decimals(jacobian), _decimals(unconstrained)
        L = _cholesky(_decimals(mass))
        W = _forward(L, J.T)  # A = Wᵀ W
        F = _factor(W, rank)
        b = _decimals(aref) - J @ free
        multipliers = b * 0
        if F.shape[1]:
            G = _cholesky(F.T @ F)
            multipliers = F @ _solve(G, _solve(G, F.T @ b))
        acceleration = free + _backward(L, W @ multipliers)
        return Exact(multipliers.astype(float), acceleration.astype(float), F.shape[1])


def _decimals(values: np.ndarray) -> Numbers:
    return np.array([Decimal(float(value)) for value in values.flat], dtype=object).reshape(values.shape)


def _cholesky(matrix: Numbers) -> Numbers:
    """L, lower triangular, with L Lᵀ = M."""
    left, L = matrix.copy(), matrix * 0
    for k in range(len(left)):
        L[k:, k] = left[k:, k] / left[k, k].sqrt()
        left[k + 1 :, k + 1 :] -= np.outer(L[k + 1 :, k], L[k + 1 :, k])
    return L


def _factor(W: Numbers, rank: int | None) -> Numbers:
    """F (n, rank) with F Fᵀ = Wᵀ W but for what is below the cut, or beyond the rank."""
    left = (W * W).sum(axis=0)
    columns: list[Numbers] = []
    first = max(left, default=Decimal(0))
    while first > 0 and len(columns) < (len(left) if rank is None else rank):
        pivot = int(np.argmax(left))
        if left[pivot] <= CUT * first:
            break
        column = W.T @ W[:, pivot]
        for known in columns:
            column = column - known[pivot] * known
        column = column / left[pivot].sqrt()
        columns.append(column)
        left = left - column * column
    return np.array(columns, dtype=object).reshape(len(columns), len(left)).T


def _forward(L: Numbers, right: Numbers) -> Numbers:
    """L⁻¹ X."""
    found = right.copy()
    for k in range(len(L)):
        found[k] = (right[k] - L[k, :k] @ found[:k]) / L[k, k] if k else right[k] / L[k, k]
    return found


def _backward(L: Numbers, right: Numbers) -> Numbers:
    """L⁻ᵀ x."""
    found = right.copy()
    for k in reversed(range(len(L))):
        found[k] = found[k] / L[k, k]
        found[:k] = found[:k] - L[k, :k] * found[k]
    return found


def _solve(L: Numbers, right: Numbers) -> Numbers:
    """(L Lᵀ)⁻¹ x."""
    return _backward(L, _forward(L, right))
