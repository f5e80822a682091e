"""Along what a pin would have to slide for a loop to move that it locks: a slot, closed as if it were a hole."""

import mujoco
import numpy as np

from oarlock.base.errors import few
from oarlock.base.text import quoted
from oarlock.mechanics.names import element_name
from oarlock.poses.assembly import Assembly

PROBE = 0.02
"""rad or m of the joint that moves most: a step along the motion that sliding admits."""

MOVES = 0.01
"""Of the joint that moves most: a joint with less does not take part, and sliding moves something else."""

SAME = 1e-6
"""Relative: singular values below are zero."""

TURNS = 20
"""Of Newton's method from that step back to the loop."""

CLOSED = 1e-9
"""m. What rounding leaves of a loop that is closed but for its slide."""

_AXES = "xyz"


def find_release(assembly: Assembly, number: int, dofs: list[int], pose: np.ndarray) -> str:
    """The directions in words, such as ``along z of 'yoke'``; empty where there is none; the pose is kept.

    Those axes of both bodies along which a slide moves every joint of the loop; the ones first that move the slowest
    most. Which of them is the slot, only its author knows.

    Args:
        assembly: whatever its pose.
        number: of an equality, that closes a loop of its own and leaves it no motion.
        dofs: of the joints of its loop.
        pose: closed, (nq).
    """
    equality = assembly.equalities[number]
    if not equality.kind.joins_points or equality.kind.turns:
        return ""
    assembly.place(pose)
    found: dict[str, tuple[float, list[str]]] = {}
    for body in equality.bodies:
        for axis in range(3):
            share, motion = _motion(assembly, number, dofs, assembly.data.xmat[body].reshape(3, 3)[:, axis].copy())
            if share > MOVES and _gets_away(assembly, number, motion, (body, axis), pose):
                most, bodies = found.get(_AXES[axis], (0.0, []))
                found[_AXES[axis]] = max(most, share), [*bodies, _called(assembly, body)]
            assembly.place(pose)
    ordered = sorted(found, key=lambda axis: -found[axis][0])
    return few([f"along {axis} of {' or '.join(found[axis][1])}" for axis in ordered], last="or")


def _called(assembly: Assembly, body: int) -> str:
    return quoted(element_name(assembly.model, mujoco.mjtObj.mjOBJ_BODY, body)) if body else "the world"


def _motion(assembly: Assembly, number: int, dofs: list[int], direction: np.ndarray) -> tuple[float, np.ndarray]:
    """The motion (nv) that sliding admits, 1 at its largest, and the part of it that the slowest joint has."""
    across = np.eye(3) - np.outer(direction, direction)
    rows = across @ assembly.jacobian()[assembly.rows_of(number)][:, dofs]
    _, sizes, directions = np.linalg.svd(rows)
    free = directions[int((sizes > SAME * sizes.max(initial=0.0)).sum()) :]
    motion = np.zeros(assembly.model.nv)
    if len(free) != 1:
        return 0.0, motion
    motion[dofs] = free[0] / np.abs(free[0]).max()
    return float(np.abs(motion[dofs]).min()), motion


def _gets_away(assembly: Assembly, number: int, motion: np.ndarray, frame: tuple[int, int], pose: np.ndarray) -> bool:
    """Whether a step along a motion is one that a pin could make that slides along an axis of a body."""
    body, axis = frame
    there = pose.copy()
    mujoco.mj_integratePos(assembly.model, there, PROBE * motion, 1.0)
    for _ in range(TURNS):
        assembly.place(there)
        direction = assembly.data.xmat[body].reshape(3, 3)[:, axis]
        across = np.eye(3) - np.outer(direction, direction)
        rows = assembly.rows_of(number)
        left = across @ assembly.residual()[rows]
        if np.abs(left).max() <= CLOSED:
            return float(np.abs(assembly.difference(pose, there)).max()) > 0.5 * PROBE
        back = -np.linalg.pinv(across @ assembly.jacobian()[rows], rcond=SAME) @ left
        mujoco.mj_integratePos(assembly.model, there, back, 1.0)
    return False
