"""How large the numbers of a state may be: beyond that it has diverged."""

import mujoco
import numpy as np

HUGE = float(mujoco.mjMAXVAL)
"""MuJoCo's own bound, 1e10: a position, velocity or acceleration beyond it counts as diverged."""


_SQUARE = HUGE * HUGE


def bounded(*vectors: np.ndarray) -> bool:
    """Whether all entries are below ``HUGE``; NaN is not."""
    for vector in vectors:
        # The sum of squares costs a third of the comparison, and this is asked at every step of every run.
        if not np.vdot(vector, vector) < _SQUARE and not bool((np.abs(vector) < HUGE).all()):
            return False
    return True
