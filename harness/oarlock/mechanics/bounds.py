"""How large the numbers of a state may be: beyond that it has diverged."""

import mujoco
import numpy as np

HUGE = float(mujoco.mjMAXVAL)
"""MuJoCo's own bound, 1e10: a position, velocity or acceleration beyond it counts as diverged."""


def bounded(*vectors: np.ndarray) -> bool:
    """Whether all entries are below ``HUGE``; NaN is not."""
    return all(bool((np.abs(vector) < HUGE).all()) for vector in vectors)
