"""Families of mechanisms that grow: what the costs of a step are held against."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.errors import choose

LEVEL = np.pi / 2
"""rad, from upright: where the rods of parallel cranks and their couplers lie in one line and the rank falls."""

_BEFORE, _RATE = 0.05, 5.0
"""rad and rad/s: a walk that goes through the singular pose begins so far before it, and is there after ten steps."""


@dataclass(frozen=True)
class Family:
    """A mechanism of many sizes.

    Attributes:
        name: in commands and figures.
        title: what grows, in words.
        model: name of a model that comes with the package, its size left open.
        sizes: the values to be measured.
        counted: what a size is counted in, against which costs are fitted.
        more: how many of these a size has more than its number; for nets, their square.
        squared: whether a size is the side of a square of them.
        crossing: whether walks begin just before a singular pose and go through it.
    """

    name: str
    title: str
    model: str
    sizes: tuple[int, ...]
    counted: str = "loops"
    more: int = 0
    squared: bool = False
    crossing: bool = False

    @property
    def symbol(self) -> str:
        """The name of its size, as the model calls it."""
        return self.model.partition("={}")[0].rpartition(":")[2]

    def model_at(self, size: int) -> str:
        """The name of the model of a size."""
        return self.model.format(size)

    def count(self, size: int) -> int:
        """The number of loops, cells or bodies of a size."""
        return size**2 if self.squared else size + self.more

    @property
    def start(self) -> Callable[[mujoco.MjModel], tuple[np.ndarray, np.ndarray]] | None:
        """Where walks begin; None: where the case does."""
        return (lambda model: turned(model, LEVEL - _BEFORE, _RATE)) if self.crossing else None


def turned(model: mujoco.MjModel, angle: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (nq = nv) of parallel cranks turned from upright, their couplers level: closed.

    Args:
        model: of hinges, all those of cranks named so.
        angle: of every crank, rad.
        rate: its rate, rad/s.
    """
    signs = np.array([1.0 if model.joint(joint).name.startswith("crank") else -1.0 for joint in range(model.njnt)])
    return angle * signs, rate * signs


_CHAIN, _NET, _CELLS = (1, 10, 40, 160, 640), (3, 6, 12, 25), (2, 5, 10, 20)

FAMILIES = (
    Family("chain", "four-bars in a chain, a connect a loop", "n_four_bar:N={}", _CHAIN),
    Family("chain-twice", "four-bars in a chain, two connects a loop", "n_four_bar:N={},connects=2", _CHAIN),
    Family(
        "chain-singular",
        "the same on its way through the singular pose",
        "n_four_bar:N={},connects=2",
        _CHAIN[:-1],
        crossing=True,
    ),
    Family("apart", "four-bars apart, each a mechanism of its own", "n_four_bar:N={},apart=1", (10, 40, 160)),
    Family("net", "nets of k × k quadrilaterals, a tree a column", "net:k={}", _NET, squared=True),
    Family("net-tree", "the same nets on one tree", "net:k={},tree=1", _NET, squared=True),
    Family("coupler", "a rigid coupler on K cranks", "n_crank:K={}", (3, 11, 41, 161), more=-1),
    Family("sarrus-apart", "Sarrus cells apart", "sarrus:cells={},apart=1", _CELLS, "cells"),
    Family("sarrus", "Sarrus cells on one tree", "sarrus:cells={}", _CELLS, "cells"),
    Family("tensegrity", "towers of tensegrity cells", "tensegrity:cells={}", _CELLS, "cells"),
    Family("ring", "a ring of hinges, one loop", "ring:bodies={},planar=1", (100, 200), "bodies"),
)


def families(names: list[str] | None = None) -> tuple[Family, ...]:
    """The families of those names, all if left out.

    Raises:
        InputError: there is no such family.
    """
    known = {family.name: family for family in FAMILIES}
    return tuple(known[choose("family", name, list(known))] for name in names) if names else FAMILIES
