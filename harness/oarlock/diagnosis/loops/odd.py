"""Which of several couplings that contradict one another was written wrong: the one that is unlike the others.

A ring of ratios can be mended at any of its couplings by some number. Nobody writes such a number: what happens is that
two joints are exchanged, which turns m into 1/m, or that a sign is lost.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco

SAME = 1e-6
"""Relative, of ratios that are alike."""

_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True)
class Ask:
    """A ratio, x = r x′, and the one with which the couplings around it agree.

    Attributes:
        sorts: types of the two joints; −1 of tendons.
        given, wanted: the ratios.
    """

    sorts: tuple[int, int]
    given: float
    wanted: float

    @property
    def swapped(self) -> bool:
        """Whether it agrees once its two joints are exchanged."""
        return abs(self.given * self.wanted - 1.0) <= SAME and not _alike(abs(self.given), 1.0)

    @property
    def oddness(self) -> int:
        """0 of exchanged joints, 1 of a sign, 2 of a number."""
        return 0 if self.swapped else 1 if _alike(self.given, -self.wanted) else 2

    @property
    def way(self) -> float:
        """How far it moves a slide per radian of a hinge, m; 0 between joints of one type."""
        first, second = (sort == _SLIDE for sort in self.sorts)
        return 0.0 if first == second else abs(self.given) if first else 1.0 / abs(self.given)


def oddest(asks: Sequence[Ask], beside: Sequence[Ask] = ()) -> list[int]:
    """Places of asks, the one first that most likely was written wrong; those of which nothing speaks keep their order.

    Exchanged joints come before signs, and signs before numbers; of those that may have been exchanged the one first
    that moves a slide furthest per radian, then those that are like more of the others once they are mended.

    Args:
        asks: couplings that contradict one another.
        beside: others of the model, as they are given.
    """

    def key(at: int) -> tuple[int, float, int]:
        one, others = asks[at], [other for other in (*asks, *beside) if other is not asks[at]]
        sorts, ratio = (one.sorts[::-1], one.given) if one.swapped else (one.sorts, one.wanted)
        mended = sum(other.sorts == sorts and _alike(other.given, ratio) for other in others)
        given = sum(other.sorts == one.sorts and _alike(other.given, one.given) for other in others)
        return one.oddness, -one.way if one.swapped else 0.0, given - mended

    return sorted(range(len(asks)), key=key)


def _alike(first: float, second: float) -> bool:
    return abs(first - second) <= SAME * abs(second)
