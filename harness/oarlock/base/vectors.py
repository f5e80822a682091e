"""Small vector algebra with a fixed order of all operations.

In which order BLAS, NumPy's sums and MuJoCo's helpers add, and whether they fuse products with sums, depends on the
machine and the build. Here both are fixed, so that the native path gives the same bits.
"""

from collections.abc import Sequence

import numpy as np

Vector = tuple[float, float, float]


def total(terms: np.ndarray) -> np.ndarray:
    """Sums terms (…, n) over the last axis, from left to right."""
    if not terms.size:
        return np.zeros(terms.shape[:-1])
    # Partial sums admit no other order.
    return np.add.accumulate(terms, -1)[..., -1]


def times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Multiplies matrices (…, rows, columns) by vectors (…, columns) to (…, rows), summing from left to right."""
    return total(matrix * vector[..., None, :])


def norm(vector: np.ndarray) -> np.ndarray:
    """Computes the norms √Σv² (…) of vectors (…, n), summing from left to right."""
    return np.sqrt(total(vector * vector))


def plus(a: Vector, b: Vector) -> Vector:
    """Computes a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def minus(a: Vector, b: Vector) -> Vector:
    """Computes a − b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scaled(factor: float, a: Vector) -> Vector:
    """Computes factor · a."""
    return factor * a[0], factor * a[1], factor * a[2]


def dot(a: Vector, b: Vector) -> float:
    """Computes the inner product a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Computes the cross product a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def crossed(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Computes a × b of a vector (3) and columns (3, …), rounded as ``np.cross`` rounds, in a tenth of its time."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def horner(coefficients: Sequence[float], x: float) -> float:
    """Evaluates the polynomial c₀ + c₁ x + c₂ x² + … at x by Horner's scheme."""
    value = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        value = coefficient + value * x
    return value
