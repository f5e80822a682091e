"""The exact answer to the constraint problem of one state, in sixty digits, with the rank given.

M, J, a₀, aref and R are taken as the exact values of their doubles. Each group of loops is solved for itself: the null
space of its A = J M⁻¹ Jᵀ + R is spanned by the eigenvectors of its n − rank smallest eigenvalues.
"""

from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np

_DIGITS = 60

_mp = mpmath.MPContext()
_mp.dps = _DIGITS

Number = Any
"""A number of so many digits: mpmath's own types do not say that a real product is real."""

Row = list[Number]


@dataclass(frozen=True)
class Exact:
    """The answer of one group of loops, rounded to doubles.

    Attributes:
        multipliers: A⁺b (n).
        acceleration: a₀ + M⁻¹ Jᵀ A⁺ b (nv).
        condition: largest over smallest eigenvalue that counts.
        gap: smallest eigenvalue that counts over the largest that does not: where it is small, only the structure says
            what the rank is. Infinite where none is left out or all of those are zero.
    """

    multipliers: np.ndarray
    acceleration: np.ndarray
    condition: float
    gap: float


def exact(
    mass: np.ndarray,
    jacobian: np.ndarray,
    unconstrained: np.ndarray,
    aref: np.ndarray,
    rank: int,
    softness: np.ndarray | None = None,
) -> Exact:
    """Solves one group.

    Args:
        mass: M (nv, nv).
        jacobian: J (n, nv).
        unconstrained: a₀ = M⁻¹ f (nv).
        aref: accelerations asked of the rows (n).
        rank: of A; of A + R, n.
        softness: R (n); None for 0.
    """
    J, free = _rows(jacobian), _rows(unconstrained)
    factor = _cholesky(_rows(mass))
    half = [_forward(factor, row) for row in J]  # L⁻¹ Jᵀ, so that A is the product of its rows
    A = [[_dot(one, other) for other in half] for one in half]
    if softness is not None:
        for index, value in enumerate(_rows(softness)):
            A[index][index] += value
    b = [asked - _dot(row, free) for row, asked in zip(J, _rows(aref), strict=True)]
    n = len(A)
    values, vectors = _mp.eigsy(_mp.matrix(A))
    order = sorted(range(n), key=lambda index: values[index])
    multipliers = [_mp.zero] * n
    for index in order[n - rank :]:
        vector = [vectors[row, index] for row in range(n)]
        share = _dot(vector, b) / values[index]
        multipliers = [entry + share * part for entry, part in zip(multipliers, vector, strict=True)]
    force = [_mp.fdot(multipliers, column) for column in zip(*half, strict=True)]
    change = _backward(factor, force)
    acceleration = [start + more for start, more in zip(free, change, strict=True)]
    counted = [values[index] for index in order[n - rank :]]
    left = max((abs(values[index]) for index in order[: n - rank]), default=_mp.zero)
    nothing = _mp.mpf(10) ** (10 - _DIGITS) * max(map(abs, values))
    return Exact(
        np.array([float(entry) for entry in multipliers]),
        np.array([float(entry) for entry in acceleration]),
        float(counted[-1] / counted[0]),
        float(counted[0] / left) if left > nothing else np.inf,
    )


def _rows(values: np.ndarray) -> list[Any]:
    """An array as lists of numbers of many digits, each that of its double."""
    return [_rows(value) if isinstance(value, np.ndarray) else _mp.mpf(float(value)) for value in values]


def _dot(one: Row, other: Row) -> Number:
    return _mp.fdot(one, other)


def _cholesky(matrix: list[Row]) -> list[Row]:
    """L, lower triangular, with L Lᵀ = M."""
    factor: list[Row] = []
    for i, row in enumerate(matrix):
        found: Row = []
        for j in range(i):
            found.append((row[j] - _dot(found, factor[j][:j])) / factor[j][j])
        found.append(_mp.sqrt(row[i] - _dot(found, found)))
        factor.append(found)
    return factor


def _forward(factor: list[Row], right: Row) -> Row:
    """L⁻¹ x."""
    found: Row = []
    for row, value in zip(factor, right, strict=True):
        found.append((value - _dot(row[:-1], found)) / row[-1])
    return found


def _backward(factor: list[Row], right: Row) -> Row:
    """L⁻ᵀ x."""
    found = list(right)
    for i in reversed(range(len(factor))):
        found[i] = found[i] / factor[i][i]
        for j in range(i):
            found[j] -= factor[i][j] * found[i]
    return found
