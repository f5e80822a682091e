"""Driven coordinates that the equalities of a group leave no motion, and the fewest equalities that take it."""

import itertools
from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from oarlock.diagnosis.loops.loops import MOVES, Loops
from oarlock.diagnosis.loops.mobility import admitted, reached_from
from oarlock.poses.assembly import Assembly

_STEPS = 4
"""So many poses around at most tell a coordinate that is held from one in a dead point."""


@dataclass(frozen=True)
class Held:
    """Coordinates that some equalities hold, and no fewer of them.

    Attributes:
        group: number of their group.
        dofs: the coordinates that are driven and held by these.
        members: numbers of the equalities, as in ``Loops.loops``.
    """

    group: int
    dofs: tuple[int, ...]
    members: tuple[int, ...]


def find_held(assembly: Assembly, loops: Loops, driven: Collection[int]) -> list[Held]:
    """Looks at a closed pose and at closed ones around it; the pose is kept.

    Args:
        assembly: at the pose, which is closed.
        loops: there.
        driven: degrees of freedom that an actuator moves.
    """
    pose = assembly.data.qpos.copy()
    found: list[Held] = []
    for number in range(len(loops.groups)):
        members, dofs = loops.members(number), loops.dofs(number)
        left = sorted(set(dofs) & set(driven))
        if not left or not _still(assembly, members, dofs, [pose]).intersection(left):
            continue
        poses = [pose, *itertools.islice(_around(assembly, members, dofs, pose), _STEPS)]
        still = _still(assembly, members, dofs, poses)
        left = [dof for dof in left if dof in still]
        while left:
            fewest = list(members)
            for one in members:
                rest = [other for other in fewest if other != one]
                if left[0] in _still(assembly, rest, dofs, poses):
                    fewest = rest
            still = _still(assembly, fewest, dofs, poses)
            found.append(Held(number, tuple(dof for dof in left if dof in still), tuple(fewest)))
            left = [dof for dof in left if dof not in still]
    assembly.place(pose)
    return found


def _around(assembly: Assembly, members: list[int], dofs: list[int], pose: np.ndarray) -> Iterator[np.ndarray]:
    """Closed poses that the motions of a group lead to."""
    yield from reached_from(assembly, admitted(assembly, members, dofs, pose), pose)


def _still(assembly: Assembly, members: list[int], dofs: list[int], poses: list[np.ndarray]) -> set[int]:
    """The degrees of freedom that some equalities leave no motion at any of some poses."""
    moved = np.zeros(assembly.model.nv, dtype=bool)
    for pose in poses:
        moved |= np.abs(admitted(assembly, members, dofs, pose)).max(axis=0, initial=0.0) > MOVES
    return {dof for dof in dofs if not moved[dof]}
