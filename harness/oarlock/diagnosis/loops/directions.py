"""Directions that turn along a motion, told in the frame in which they turn least."""

from dataclasses import dataclass

import numpy as np

WORLD = "world"

STEADY = 1e-3
"""rad. Frames in which directions turn by less are alike, and the first of them is taken."""

AXIS = 1e-3
"""rad. A direction this close to an axis of its frame is called by its name."""


@dataclass(frozen=True)
class Directions:
    """How many directions of a force or torque are determined, and which are not.

    Attributes:
        unique: how many are determined.
        free: how many are not.
        idle: how many hold nothing.
        frame: ``world`` or the name of a body, in which the free ones turn least.
        basis: the free ones on average over the motion, in that frame (3, free).
        turns_rad: how far they are from that average at most.
        world_turns_rad: the same in the world.
    """

    unique: int
    free: int
    idle: int
    frame: str
    basis: np.ndarray
    turns_rad: float
    world_turns_rad: float

    def __str__(self) -> str:
        if not self.free:
            return "unique" if self.unique else "none"
        if not self.unique:
            return "not unique"
        way = "along" if self.free == 1 else "across"
        direction = _telling(self.basis)
        assert direction is not None
        return f"not unique {way} {_named(direction)} of {'the world' if self.frame == WORLD else self.frame}"


def _named(direction: np.ndarray) -> str:
    largest = int(np.abs(direction).argmax())
    numbers = np.round(direction * np.sign(direction[largest]), 3) + 0.0  # no −0
    return _axis(direction) or f"({', '.join(f'{x:g}' for x in numbers)})"


def told(bases: list[np.ndarray], idle: int, frames: dict[str, list[np.ndarray]]) -> Directions:
    """What is free along a motion.

    Args:
        bases: free directions at every pose, world axes, orthonormal (3, m).
        idle: how many directions hold nothing.
        frames: name → orientation (3, 3) at every pose; ``world`` first.
    """
    counts = [basis.shape[1] for basis in bases]
    free = max(counts)
    if free == 0:
        return Directions(max(0, 3 - idle), 0, idle, next(iter(frames)), bases[0], 0.0, 0.0)
    at = [index for index, count in enumerate(counts) if count == free]
    found: list[tuple[str, float, np.ndarray]] = []
    for name, orientations in frames.items():
        turned = [orientations[index].T @ bases[index] for index in at]
        mean = np.linalg.eigh(np.mean([basis @ basis.T for basis in turned], axis=0))[1][:, 3 - free :]
        found.append((name, max(_angle(mean, basis) for basis in turned), mean))
    least = min(away for _, away, _ in found)
    steady = [one for one in found if one[1] <= least + STEADY]
    name, away, mean = next((one for one in steady if _axis(_telling(one[2]))), steady[0])
    return Directions(max(0, 3 - free - idle), free, idle, name, mean, away, found[0][1])


def _telling(basis: np.ndarray) -> np.ndarray | None:
    """The direction (3) that tells a range: its own, or that across a plane."""
    count = basis.shape[1]
    return None if count in (0, 3) else np.linalg.svd(basis)[0][:, 0 if count == 1 else 2]


def _axis(direction: np.ndarray | None) -> str:
    """The axis that a direction is along, if it is along one."""
    if direction is None:
        return ""
    largest = int(np.abs(direction).argmax())
    return "xyz"[largest] if np.linalg.norm(np.delete(direction, largest)) <= AXIS else ""


def _angle(first: np.ndarray, second: np.ndarray) -> float:
    """Largest angle between two subspaces of equal dimension, rad."""
    if not first.shape[1]:
        return 0.0
    return float(np.arcsin(min(1.0, float(np.linalg.norm(second - first @ (first.T @ second), ord=2)))))
