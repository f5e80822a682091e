"""Sizes and differences of vectors; all axes but the last are kept, such as an axis of steps."""

import numpy as np

from oarlock.base.vectors import norm


def relative_difference(value: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Computes ‖value − reference‖ / ‖reference‖ (…) of vectors (…, n).

    Where ‖reference‖ is zero, it is the absolute difference.
    """
    scale, difference = norm(reference), norm(value - reference)
    return difference / np.where(scale > 0, scale, 1.0)


def largest(values: np.ndarray) -> np.ndarray:
    """Computes the largest magnitude (…) of the entries of vectors (…, n); 0 if n is 0."""
    return np.abs(values).max(-1, initial=0.0)
