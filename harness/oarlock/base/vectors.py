"""Small vector algebra in which every rounding is written down.

BLAS, NumPy's sums and MuJoCo's helpers choose by machine and build in which order they add and whether they fuse a
product with a sum. Here both are fixed, so that the native stepping gives the same bits.
"""

from collections.abc import Sequence

import numpy as np

Vector = tuple[float, float, float]


def total(terms: np.ndarray) -> np.ndarray:
    """The sums (…) of terms (…, n), from left to right."""
    if not terms.size:
        return np.zeros(terms.shape[:-1])
    # Partial sums admit no other order.
    return np.add.accumulate(terms, -1)[..., -1]


def times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """The product (…, rows) of matrices (…, rows, columns) and vectors (…, columns), each row from left to right."""
    return total(matrix * vector[..., None, :])


def norm(vector: np.ndarray) -> np.ndarray:
    """The norms √Σv² (…) of vectors (…, n), summed from left to right."""
    return np.sqrt(total(vector * vector))


def plus(a: Vector, b: Vector) -> Vector:
    """The sum a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def minus(a: Vector, b: Vector) -> Vector:
    """The difference a − b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scaled(factor: float, a: Vector) -> Vector:
    """The multiple of a vector."""
    return factor * a[0], factor * a[1], factor * a[2]


def dot(a: Vector, b: Vector) -> float:
    """The product a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """The product a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def horner(coefficients: Sequence[float], x: float) -> float:
    """The polynomial c₀ + c₁ x + c₂ x² + … at a place."""
    value = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        value = coefficient + value * x
    return value
