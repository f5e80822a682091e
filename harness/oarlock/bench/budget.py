"""How long a walk may take before it is left out of a table, and how many steps one has."""

from dataclasses import dataclass

TARGET_S = 0.02
"""Time that a walk of bare ``mj_step`` should take, s."""

LEAST, MOST = 40, 1000
"""Steps of a walk."""


@dataclass(frozen=True)
class Budget:
    """What a walk may cost.

    Attributes:
        walk_s: time of a walk at most, s.
    """

    walk_s: float = 1.0

    def refusal(self, first_s: float, step_s: float, steps: int) -> str:
        """Why a walk of so many steps is left out, given what its first and a later one took; empty if it is not."""
        if first_s > self.walk_s:
            return f"its first step took {first_s:.2g} s, more than the {self.walk_s:g} s of a walk"
        needed_s = first_s + steps * step_s
        if needed_s <= self.walk_s:
            return ""
        return f"{1e3 * step_s:.3g} ms a step, {needed_s:.2g} s for {steps} of them, more than {self.walk_s:g} s"


def steps_for(step_s: float) -> int:
    """How many steps a walk has where one of ``mj_step`` takes so long."""
    return max(LEAST, min(MOST, int(TARGET_S / step_s)))
