"""Sizes and differences of arrays; a leading axis is that of steps."""

import numpy as np

from oarlock.base.vectors import norm


def relative_difference(value: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """‖value − reference‖ / ‖reference‖; the absolute difference where the reference is zero."""
    scale, difference = norm(reference), norm(value - reference)
    return difference / np.where(scale > 0, scale, 1.0)


def largest(values: np.ndarray) -> np.ndarray:
    """Largest magnitude of an entry; 0 of nothing."""
    return np.abs(values).max(-1, initial=0.0)
