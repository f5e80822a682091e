"""What goes through each equality over time, in newtons and newton metres, and how much of it the motion determines.

Multipliers that differ by a null vector of Jᵀ do the same. λ is split into its orthogonal projections onto range(J) and
null(Jᵀ): every solver must agree on the first, whatever it makes of the second; minimum-norm multipliers have none of
the second. The split is orthogonal in the units of MuJoCo's rows, where newtons and newton metres count alike. What no
choice of units changes is said by ``uniqueness``: which directions of a force are determined.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.diagnosis.loops.forces import coupled_to, coupling_slopes, quat_product, torque_map, turns
from oarlock.diagnosis.loops.loops import Loops, loops_at, scales_along
from oarlock.mechanics.coupled import coupled, coupled_ids
from oarlock.mechanics.folding import ALIKE, Folded, fold
from oarlock.mechanics.names import Equality
from oarlock.poses.assembly import Assembly

_CHUNK = 1 << 20
"""Numbers of J that are held at once."""


@dataclass(frozen=True)
class Series:
    """A force, a torque and couplings over time; what an equality has none of is None.

    Attributes:
        force: on the first body at its anchor, world axes (T, 3), N; the second gets the opposite.
        torque: on the first body, world axes (T, 3), N m; the second gets the opposite.
        ends: of a joint or tendon equality, what it does to each of its ends (T, 1 or 2): N m on a hinge, N on a slide
            or as the tension of a tendon that it lengthens.
    """

    force: np.ndarray | None
    torque: np.ndarray | None
    ends: np.ndarray | None


@dataclass(frozen=True)
class Wrench:
    """What goes through one equality.

    Attributes:
        equality: its name.
        ends: names of its bodies, joints or tendons.
        units: of ``ends`` of a coupling; empty for others.
        total: all of it.
        free: the part that the motion does not determine; the rest is determined.
        frames: orientations of the first and second body (T, 3, 3), for connects and welds.
    """

    equality: str
    ends: tuple[str, ...]
    units: tuple[str, ...]
    total: Series
    free: Series
    frames: tuple[np.ndarray, ...]

    def in_frame(self, vectors: np.ndarray, body: int) -> np.ndarray:
        """Vectors (T, 3) given in world axes, in those of the first (0) or second (1) body."""
        return np.einsum("tji,tj->ti", self.frames[body], vectors)


def wrenches(
    model: mujoco.MjModel,
    qpos: np.ndarray,
    multipliers: np.ndarray,
    data: mujoco.MjData | None = None,
    loops: Loops | None = None,
) -> tuple[Wrench, ...]:
    """The wrench through every active equality along a recorded motion.

    Args:
        model: any; left alone.
        qpos: poses (T, nq).
        multipliers: λ (T, n) of all rows of the active equalities, in the order of the model: MuJoCo's ``efc_force``,
            or exact ones; rows that MuJoCo leaves out are 0 (see ``Assembly.at_rows``).
        data: mocap bodies and which equalities are active; left alone.
        loops: of a closed pose, whose ranks hold for the motion; None: those of the first pose, closed.

    Raises:
        InputError: another number of rows or poses, or as ``find_loops``.
    """
    assembly = Assembly(model, data)
    expected = (len(qpos), len(assembly.rows))
    if multipliers.shape != expected:
        raise InputError(f"multipliers of the shape {multipliers.shape}, expected {expected}: poses × rows")
    if loops is None:
        assembly.place(qpos[0])
        loops = loops_at(assembly, assembly.close(), dependent=False)
    scales = scales_along(assembly, qpos)
    turned, others, free = _Turned(assembly, len(qpos)), np.zeros((len(qpos), len(assembly.equalities))), []
    classes: dict[int, Folded] = {}
    couplings = [number for number, one in enumerate(assembly.equalities) if not one.kind.joins_points]
    size = max(1, _CHUNK // max(1, len(assembly.rows) * model.nv))
    for first in range(0, len(qpos), size):
        poses = qpos[first : first + size]
        stack = np.zeros((len(poses), len(assembly.rows), model.nv))
        for at, pose in enumerate(poses):
            assembly.place(pose)
            stack[at] = scales[:, None] * assembly.jacobian()
            turned.read(first + at)
            for number in couplings:
                others[first + at, number] = coupled_to(assembly, assembly.equalities[number])
        free.append(_free_part(assembly, loops, poses, stack, scales, multipliers[first : first + size], classes))
    undetermined = np.concatenate(free) if free else np.zeros(expected)
    found = []
    for number, equality in enumerate(assembly.equalities):
        rows, loop = assembly.rows_of(number), loops.loops[number]
        slopes = coupling_slopes(model, equality, others[:, number])
        total, part = (_series(turned, equality, values[:, rows], slopes) for values in (multipliers, undetermined))
        frames = tuple(turned.matrix(body) for body in equality.bodies) if total.force is not None else ()
        found.append(Wrench(equality.name, loop.ends, _units(model, equality), total, part, frames))
    return tuple(found)


def _free_part(
    assembly: Assembly,
    loops: Loops,
    qpos: np.ndarray,
    stack: np.ndarray,
    scales: np.ndarray,
    multipliers: np.ndarray,
    classes: dict[int, Folded],
) -> np.ndarray:
    """The part of multipliers (T, n) in null(Jᵀ), at poses, from scaled rows (T, n, nv) and the ranks of the groups.

    ``classes`` keeps the proportional rows of every group, as they are at the first pose of all.
    """
    whitened: np.ndarray | None = None
    found = np.zeros_like(multipliers)
    for number, group in enumerate(loops.groups):
        rows = assembly.rows_of_all(loops.members(number))
        dead = rows[scales[rows] == 0.0]
        found[:, dead] = multipliers[:, dead]  # rows that hold nothing are free, and dependent on no other
        rows = rows[scales[rows] > 0.0]
        if len(rows) <= group.rank:
            continue
        if number not in classes:
            classes[number] = fold(stack[0, rows])
        repeats = _repeats(stack[:, rows], classes[number], group.rank)
        if repeats is not None:
            found[:, rows] = _within(*repeats, 1.0 / scales[rows], multipliers[:, rows])
            continue
        if whitened is None:
            whitened = scales[:, None] * assembly.whitened_along(qpos)
        some, given = whitened[:, rows], multipliers[:, rows, None]
        # A basis of range(J): eigenvectors to the largest eigenvalues. The rank is known, so that squares do no harm.
        wide = len(rows) <= some.shape[2]
        square = some @ some.transpose(0, 2, 1) if wide else some.transpose(0, 2, 1) @ some
        largest = np.linalg.eigh(square)[1][:, :, square.shape[1] - group.rank :]
        basis = np.linalg.qr((largest if wide else some @ largest) / scales[rows, None])[0]
        found[:, rows] = (given - basis @ (basis.transpose(0, 2, 1) @ given))[..., 0]
    return found


def _repeats(stack: np.ndarray, folded: Folded, rank: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Class of every row of (T, n, nv), (n), and what it is of the first row of that, (T, n).

    None where rows depend on one another otherwise too, or are proportional or zero at some poses only.
    """
    if len(folded.rows) > rank or (folded.owner < 0).any():
        return None
    if folded.alone.all():
        return folded.owner, np.ones(stack.shape[:2])
    first = np.unique(folded.owner, return_index=True)[1]
    again = np.flatnonzero(~folded.alone)
    rows, ones = stack[:, again], stack[:, first[folded.owner[again]]]
    squares = np.einsum("tij,tij->ti", ones, ones)
    own = np.einsum("tij,tij->ti", rows, ones) / np.where(squares > 0.0, squares, 1.0)
    rows -= own[..., None] * ones
    if (np.einsum("tij,tij->ti", rows, rows) > np.square(ALIKE) * np.square(own) * squares).any():
        return None
    part = np.ones(stack.shape[:2])
    part[:, again] = own
    return folded.owner, part


def _within(owner: np.ndarray, part: np.ndarray, factors: np.ndarray, given: np.ndarray) -> np.ndarray:
    """The part of multipliers (T, n) with which proportional rows, times factors (n), cancel one another."""
    own, count = factors * part, int(owner.max(initial=-1)) + 1
    sums = np.zeros((2, len(given), count))
    for row, of in enumerate(owner.tolist()):
        sums[0, :, of] += own[:, row] * given[:, row]
        sums[1, :, of] += np.square(own[:, row])
    along = sums[0] / np.where(sums[1] > 0.0, sums[1], 1.0)
    found = given - along[:, owner] * own
    found[:, np.bincount(owner, minlength=count)[owner] == 1] = 0.0
    return found


class _Turned:
    """Orientations (T, 4) of the bodies of connects and welds."""

    def __init__(self, assembly: Assembly, steps: int):
        self.assembly = assembly
        self._bodies = sorted({body for one in assembly.equalities for body in one.bodies})
        self._quats = np.zeros((steps, len(self._bodies), 4))

    def read(self, at: int) -> None:
        """Takes over the present pose as that of a sample."""
        self._quats[at] = self.assembly.data.xquat[self._bodies]

    def quat(self, body: int) -> np.ndarray:
        """Of one body."""
        return self._quats[:, self._bodies.index(body)]

    def matrix(self, body: int) -> np.ndarray:
        """Of one body, as matrices (T, 3, 3)."""
        quat = self.quat(body)
        conjugate = quat * np.array([1.0, -1.0, -1.0, -1.0])
        columns = quat_product(quat_product(quat[:, None], np.eye(4)[1:]), conjugate[:, None])
        return columns[..., 1:].transpose(0, 2, 1)


def _series(turned: _Turned, equality: Equality, multipliers: np.ndarray, slopes: np.ndarray) -> Series:
    model = turned.assembly.model
    if equality.kind.joins_points and not equality.kind.turns:
        return Series(multipliers, None, None)
    if equality.kind.turns:
        first, second = (
            quat_product(turned.quat(body), turn)
            for body, turn in zip(equality.bodies, turns(model, equality), strict=True)
        )
        map_ = torque_map(first, second, equality.torque_scale(model))
        return Series(multipliers[:, :3], np.einsum("tij,tj->ti", map_, multipliers[:, 3:]), None)
    ends = [multipliers[:, 0]]
    if model.eq_obj2id[equality.index] >= 0:
        ends.append(-slopes * multipliers[:, 0])
    return Series(None, None, np.column_stack(ends))


def _units(model: mujoco.MjModel, equality: Equality) -> tuple[str, ...]:
    if equality.kind.joins_points:
        return ()
    effort = coupled(equality.kind).effort
    return tuple(effort(model, index) for index in coupled_ids(model, equality.index))
