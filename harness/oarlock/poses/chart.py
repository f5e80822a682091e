"""The poses of a part of a mechanism in coordinates of their own: its rows, its ranges, and steps along both.

A pose is q₀ ⊞ x: every degree of freedom of the part has a coordinate, what it turned or moved by since q₀; the three
of a ball, or of a free joint's rotation, are a rotation vector. Lengths are divided by the mechanism's arm, so that the
norm of x is in radians whatever moves: it is the metric in which a pose is near another.

Ranges are bounds on coordinates (hinges, slides) or rows of their own (balls, tendons), as MuJoCo computes them. A step
p that meets rows and ranges to first order, J p = −c and G p ≥ −g, with the smallest norm is a least-distance problem;
it becomes one of non-negative least squares (Lawson and Hanson 1974, Solving Least Squares Problems, chapter 23).
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.mechanics.engine_version import tendon_dofs
from oarlock.mechanics.inequalities import row_name
from oarlock.mechanics.rows import jacobian as every_row
from oarlock.poses.assembly import Assembly
from oarlock.stepping.closing import CONSISTENT

INSET = 1e-10
"""rad or m. Poses stay so far inside of ranges: closing to rounding moves them by far less, and for MuJoCo, and for
``stops``, they are at the limit."""

ALIKE = 1e-9
"""Of the largest singular value of a closed pose: those below are rounding."""

OPEN = 10.0
"""Of a row's gap over the arm: a singular value of an open pose that is smaller comes from the gap."""

ROUGH = 0.03
"""Of the largest singular value at most: below it nothing counts, however far open a pose is."""

SHORTEST = 1e-6
"""Of the longest row: one that is shorter at the base is not magnified further."""

LONGEST = 0.5
"""Of a step, in any coordinate (rad)."""

ROUNDS = 40
"""Newton steps onto the rows, at most."""

BEYOND = 1e100
"""Deviations and derivatives from there on have squares that overflow."""

_HALVINGS = 5
_FAR = 1e9
"""Margin of a limit: it always has a row."""

_FREE, _BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)
_LIMIT_TENDON = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON)


def fenced(model: mujoco.MjModel, data: mujoco.MjData | None = None) -> Assembly:
    """An assembly that has a row for every limited ball and tendon beside those of equalities, however far it is."""
    assembly = Assembly(model, data)
    own = assembly.model
    balls = own.jnt_type == _BALL
    own.jnt_limited[~balls] = 0
    if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_LIMIT and (
        (balls & own.jnt_limited.astype(bool)).any() or own.tendon_limited.any()
    ):
        own.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
        own.jnt_margin[:], own.tendon_margin[:] = _FAR, _FAR
    return assembly


def bounds(model: mujoco.MjModel) -> np.ndarray:
    """Least and largest value (nq, 2) of every entry of qpos: ranges of hinges and slides, else infinite."""
    found = np.tile([-np.inf, np.inf], (model.nq, 1))
    if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_LIMIT:
        for joint in np.flatnonzero(model.jnt_limited):
            if model.jnt_type[joint] not in (_FREE, _BALL):
                found[model.jnt_qposadr[joint]] = model.jnt_range[joint]
    return found


def arm_of(assembly: Assembly) -> float:
    """The longest arm of a turning joint about a point that an equality holds, in the model's own pose, m.

    By so much a length counts as a radian. Where no joint turns a point it is the model's extent.
    """
    model, pose = assembly.model, assembly.data.qpos.copy()
    assembly.place(model.qpos0)
    turning = ~lengths(model)
    jacobian, longest = assembly.jacobian(), 0.0
    for equality, start in zip(assembly.equalities, assembly.starts, strict=True):
        if equality.kind.joins_points:
            arms = np.linalg.norm(jacobian[start : start + 3][:, turning], axis=0)
            longest = max(longest, float(arms.max(initial=0.0)))
    assembly.place(pose)
    return longest or float(model.stat.extent) or 1.0


def lengths(model: mujoco.MjModel) -> np.ndarray:
    """Which degrees of freedom (nv) are lengths, and not angles."""
    found = model.jnt_type[model.dof_jntid] == _SLIDE
    for joint in np.flatnonzero(model.jnt_type == _FREE):
        found[model.jnt_dofadr[joint] : model.jnt_dofadr[joint] + 3] = True
    return found


@dataclass(frozen=True)
class Seen:
    """A pose of a chart.

    Attributes:
        x: its coordinates (k), rad.
        rest: deviations of the rows (n), each over the length of its block's longest row: rad.
        rows: derivatives of ``rest`` by x, (n, k).
        room: of ranges that are no bounds: what is left (l), rad or m.
        fences: derivatives of ``room`` by x, (l, k).
    """

    x: np.ndarray
    rest: np.ndarray
    rows: np.ndarray
    room: np.ndarray
    fences: np.ndarray

    @property
    def gap(self) -> float:
        """The largest deviation."""
        return float(np.abs(self.rest).max(initial=0.0))

    def split(self, rank: int | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """Left vectors (n, r), singular values (r) and right vectors (k, k) of the rows; and the rank r.

        Args:
            rank: None: by the size of the singular values, where those that the gap makes do not count.
        """
        left, sizes, right = np.linalg.svd(self.rows)
        if rank is None:
            cut = min(max(ALIKE, OPEN * self.gap), ROUGH)
            rank = int((sizes > cut * sizes.max(initial=0.0)).sum())
        rank = min(rank, int((sizes > ALIKE * sizes.max(initial=0.0)).sum()))
        return left[:, :rank], sizes[:rank], right, rank


class Chart:
    """Coordinates of the poses around one.

    Args:
        assembly: of ``fenced``.
        base: the pose q₀ (nq).
        dofs: degrees of freedom that move; the others stay as they are in q₀.
        rows: rows of the assembly that are to be closed.
        arm: a length that counts as a radian, m.
        ranges: least and largest value (nq, 2) of every entry of qpos, as of ``bounds``; with None nothing is limited,
            balls and tendons neither.
    """

    def __init__(
        self,
        assembly: Assembly,
        base: np.ndarray,
        dofs: list[int],
        rows: np.ndarray,
        arm: float,
        ranges: np.ndarray | None,
    ):
        model = assembly.model
        self.assembly, self.base, self.rows, self.arm = assembly, base.copy(), rows, arm
        self.dofs = np.array(dofs, dtype=int)
        self.unit = np.where(lengths(model)[self.dofs], arm, 1.0)
        owners = model.dof_jntid[self.dofs]
        within = self.dofs - model.jnt_dofadr[owners]
        kinds = model.jnt_type[owners]
        self.single = ~np.isin(kinds, (_FREE, _BALL)) | ((kinds == _FREE) & (within < 3))
        self._limits = ranges is not None
        self._weights = np.ones(len(rows))
        self.low, self.high = np.full(len(dofs), -np.inf), np.full(len(dofs), np.inf)
        self.addresses = (model.jnt_qposadr[owners] + within)[self.single]
        self._own = set(owners.tolist())
        self._ranges = ranges
        self._fence()
        # Rotation vectors of balls and free joints: where they stand among the coordinates.
        self._turns: list[np.ndarray] = []
        for joint in sorted(self._own):
            if model.jnt_type[joint] in (_FREE, _BALL):
                first = int(model.jnt_dofadr[joint]) + (3 if model.jnt_type[joint] == _FREE else 0)
                at = np.flatnonzero(np.isin(self.dofs, range(first, first + 3)))
                if len(at) == 3:
                    self._turns.append(at)

        self.turning = bool(self._turns)
        self._weights = self._row_sizes()

    def _row_sizes(self) -> np.ndarray:
        """What makes the longest row of every block 1 long at the base, so that deviations are in radians."""
        sizes = np.linalg.norm(self.see(np.zeros(self.size)).rows, axis=1)
        found = np.zeros(len(self.assembly.rows))
        found[self.rows] = sizes
        for block in self.assembly.blocks:
            found[block] = found[block].max(initial=0.0)
        return np.maximum(found[self.rows], SHORTEST * max(float(sizes.max(initial=0.0)), SHORTEST))

    def move(self, base: np.ndarray) -> None:
        """Takes another pose (nq) for q₀; degrees of freedom, rows, their lengths and ranges stay."""
        self.base[:] = base
        self._fence()

    def _fence(self) -> None:
        if self._ranges is None:
            return
        ranges = self._ranges
        base, unit = self.base[self.addresses], self.unit[self.single]
        least, most = ranges[self.addresses].T
        inset = np.minimum(INSET, 0.5 * np.maximum(most - least, 0.0))
        self.low[self.single] = (least + inset - base) / unit
        self.high[self.single] = (most - inset - base) / unit

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.dofs)

    def pose(self, x: np.ndarray) -> np.ndarray:
        """The pose (nq) of some coordinates (k)."""
        change = np.zeros(self.assembly.model.nv)
        change[self.dofs] = x * self.unit
        found = self.base.copy()
        mujoco.mj_integratePos(self.assembly.model, found, change, 1.0)
        return found

    def coordinates(self, pose: np.ndarray) -> np.ndarray:
        """The coordinates (k) of a pose (nq)."""
        return self.assembly.difference(self.base, pose)[self.dofs] / self.unit

    def see(self, x: np.ndarray) -> Seen:
        """Goes to a pose and looks at it; one whose squares are no numbers is open without end."""
        assembly = self.assembly
        assembly.place(self.pose(x))
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is told below
            rest = assembly.residual()[self.rows] / self._weights
            rows = self._by_x(x, assembly.jacobian()[self.rows][:, self.dofs] / self._weights[:, None])
            room, fences = self._fences(x)
        if not all(bool((np.abs(part) < BEYOND).all()) for part in (rest, rows, room, fences)):
            nothing = np.zeros_like(rows), np.zeros(0), np.zeros((0, self.size))
            return Seen(x, np.full(len(rest), np.inf), *nothing)
        return Seen(x, rest, rows, room, fences)

    def _by_x(self, x: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """From derivatives by velocities to derivatives by coordinates."""
        rows = rows * self.unit
        for at in self._turns:
            rows[:, at] = rows[:, at] @ _turned(x[at])
        return rows

    def _fences(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        model, data = self.assembly.model, self.assembly.data
        if not self._limits or data.nefc == data.ne:
            return np.zeros(0), np.zeros((0, self.size))
        every = every_row(model, data)[data.ne :]
        concerned = np.array([self._concerned(row) for row in range(data.ne, data.nefc)], dtype=bool)
        moved = self._by_x(x, every[concerned][:, self.dofs])
        return data.efc_pos[data.ne : data.nefc][concerned] - INSET, moved

    def _concerned(self, row: int) -> bool:
        """Whether a limit is of a joint, or of a tendon that a joint moves, of this chart."""
        model, data = self.assembly.model, self.assembly.data
        index = int(data.efc_id[row])
        if data.efc_type[row] != _LIMIT_TENDON:
            return index in self._own
        return bool(np.isin(tendon_dofs(model, index), self.dofs).any())

    def inside(self, seen: Seen) -> bool:
        """Whether a pose is inside of all ranges."""
        free = INSET
        return bool(
            (seen.x >= self.low - free / self.unit).all()
            and (seen.x <= self.high + free / self.unit).all()
            and (seen.room >= -free).all()
        )

    def step(self, seen: Seen, wanted: np.ndarray, free: np.ndarray, shape: np.ndarray | None = None) -> np.ndarray:
        """The step p = wanted + Z u inside of ranges, to first order, with the least uᵀ B u.

        Args:
            seen: where it starts.
            wanted: (k).
            free: Z (k, d), orthonormal: along these it may differ.
            shape: B = Lᵀ L, by its L (d, d); None: 1.

        Returns:
            The step; where ranges leave none, the nearest that leaves them least, cut off at the bounds.
        """
        sides = np.vstack([np.eye(self.size), -np.eye(self.size), seen.fences])
        room = np.concatenate([seen.x - self.low, self.high - seen.x, seen.room])
        short = -(room + sides @ wanted)
        if not (short > 0.0).any():
            return wanted
        near = np.isfinite(short)
        along = sides[near] @ free
        if shape is not None:
            along = np.linalg.solve(shape.T, along.T).T
        change = _least_distance(along, short[near])
        if change is None:
            return np.clip(seen.x + wanted, self.low, self.high) - seen.x
        if shape is not None:
            change = np.linalg.solve(shape, change)
        return np.clip(seen.x + wanted + free @ change, self.low, self.high) - seen.x

    def close(self, x: np.ndarray, rounds: int = ROUNDS) -> Seen | None:
        """The closed pose that Newton's steps of least norm lead to, inside of ranges.

        Args:
            x: where they begin (k).
            rounds: steps at most.

        Returns:
            None where they lead nowhere.
        """
        seen, damping = self.see(np.clip(x, self.low, self.high)), 0.0
        if not np.isfinite(seen.gap):
            return None
        for _ in range(rounds):
            outside = not self.inside(seen)
            if seen.gap <= _rounding(self) and not outside:
                return seen
            nearer = self._nearer(seen, damping)
            if nearer is None:
                if not outside and (seen.gap <= 1e3 * _rounding(self) or _contradicts(seen)):
                    return seen
                if damping > 1.0:
                    return None
                damping = max(10.0 * damping, 1e-4)
                continue
            seen, damping = nearer, 0.1 * damping if damping > 1e-6 else 0.0
        return None

    def _nearer(self, seen: Seen, damping: float) -> Seen | None:
        left, sizes, right, rank = seen.split(len(seen.rest) if damping else None)  # damped, small ones do no harm
        wanted = -right[:rank].T @ ((sizes / (sizes**2 + damping)) * (left.T @ seen.rest))
        wanted *= min(1.0, LONGEST / max(float(np.abs(wanted).max(initial=0.0)), LONGEST))
        step = self.step(seen, wanted, right[rank:].T)
        error = _error(self, seen)
        for _ in range(_HALVINGS):
            there = self.see(seen.x + step)
            if _error(self, there) < error:
                return there
            step = 0.5 * step
        return None

    def names_outside(self, seen: Seen) -> list[str]:
        """Limits of balls and tendons that a pose is beyond, in words; the pose must be the last one seen."""
        model, data = self.assembly.model, self.assembly.data
        rows = [row for row in range(data.ne, data.nefc) if self._concerned(row)]
        return [row_name(model, data, row) for row, room in zip(rows, seen.room, strict=True) if room < -INSET]


def _rounding(chart: Chart) -> float:
    """What rounding leaves open of a closed pose, rad."""
    size = float(np.abs(chart.base).max(initial=1.0))
    return 4.0 * float(np.finfo(float).eps) * max(1.0, size)


def _contradicts(seen: Seen) -> bool:
    """Whether rows contradict one another by what is left open, as the digits of a file do: no step closes it."""
    left = seen.split()[0]
    return seen.gap <= CONSISTENT and float(np.linalg.norm(left.T @ seen.rest)) <= 1e-3 * seen.gap


def _error(chart: Chart, seen: Seen) -> float:
    outside = np.minimum(np.concatenate([seen.x - chart.low, chart.high - seen.x, seen.room]), 0.0)
    return float(np.linalg.norm(seen.rest) + np.linalg.norm(outside))


def _least_distance(sides: np.ndarray, least: np.ndarray) -> np.ndarray | None:
    """The shortest u with sides · u ≥ least; None if there is none."""
    from scipy.optimize import nnls  # a seventh of a second, for what most starts do not need

    scale = max(float(np.abs(least).max()), 1e-300)
    both = np.vstack([sides.T, least / scale])
    target = np.zeros(len(both))
    target[-1] = 1.0
    try:
        weights, size = nnls(both, target, maxiter=10 * both.shape[1])
    except RuntimeError:
        return None
    rest = both @ weights - target
    if size < 1e-9 or rest[-1] > -1e-12:
        return None
    return -scale * rest[:-1] / rest[-1]


def _turned(turn: np.ndarray) -> np.ndarray:
    """Angular velocity in the turned frame by rate of the rotation vector (3, 3): the right Jacobian of SO(3)."""
    angle = float(np.linalg.norm(turn))
    a, b, c = turn
    cross = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
    if angle < 1e-4:
        return np.eye(3) - 0.5 * cross + cross @ cross / 6.0
    return np.eye(3) - (1.0 - np.cos(angle)) / angle**2 * cross + (angle - np.sin(angle)) / angle**3 * cross @ cross
