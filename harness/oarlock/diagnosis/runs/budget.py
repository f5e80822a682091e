"""What the runs of a search may cost: work that is counted in advance, and a clock that can only cut them short.

Which runs are made must not depend on how fast a machine is or what else it does, so a run is charged what it takes on
an ordinary machine. The clock stands far behind that, for models whose steps take much longer than their size tells.
"""

import time

STEP_S = 30e-6
"""Charged for a step, besides its evaluations: looking at it takes so long, 25 to 35 µs on all models measured."""

EVALUATION_S = 3e-6
"""Charged for an evaluation of a model, whatever its size."""

SIZE_S = 0.6e-6
"""Charged for an evaluation, for each velocity and each row. Over the gallery and the fixtures (3 to 480 velocities and
rows; MuJoCo 4.0, one core of 2020 or later) this and ``EVALUATION_S`` are right within a factor of two."""

PATIENCE, LEAST_LIMIT_S = 10.0, 10.0
"""The clock cuts short what takes so many times the budget, and never sooner than after so many seconds."""


class CutShortError(Exception):
    """The clock ran out; the message says after how long."""


class Budget:
    """Seconds of an ordinary machine, to be spent by counted work.

    Attributes:
        seconds: all of them.
        limit_s: processor time of this process, s, that may be spent from now on; other processes do not use it up.
    """

    def __init__(self, seconds: float):
        self.seconds = seconds
        self.limit_s = max(LEAST_LIMIT_S, PATIENCE * seconds)
        self._left = seconds
        self._until = time.process_time() + self.limit_s

    def affords(self, steps: float, evaluations: float, size: int) -> bool:
        """Whether a run fits into what is left; arguments as of ``charge``."""
        return charge(steps, evaluations, size) <= self._left

    def spend(self, steps: float, evaluations: float, size: int) -> None:
        """Takes the charge of a run off; arguments as of ``charge``."""
        self._left -= charge(steps, evaluations, size)

    def tick(self) -> None:
        """Looks at the clock.

        Raises:
            CutShortError: ``limit_s`` has passed.
        """
        if time.process_time() > self._until:
            raise CutShortError(f"cut short after {self.limit_s:g} s of processor time")


def charge(steps: float, evaluations: float, size: int) -> float:
    """Seconds that a run takes on an ordinary machine.

    Args:
        steps: of the run.
        evaluations: of the model, over all steps.
        size: velocities and rows.
    """
    return STEP_S * steps + (EVALUATION_S + SIZE_S * size) * evaluations
