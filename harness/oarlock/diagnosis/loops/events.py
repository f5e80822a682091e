"""How the rank of the loops changes along a motion: the singular poses that it comes to, between samples too."""

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.diagnosis.loops.loops import SCALED, Loops, loops_at, scales_along
from oarlock.mechanics.folding import fold
from oarlock.mechanics.names import Equality
from oarlock.poses.assembly import Assembly

SINGULAR = 1e-3
"""Of its median along the motion: a singular value below this has vanished. A mechanism of lengths around 1 m is then
within a millimetre or so of the singular pose."""

NEAR = 0.05
"""The same: below this the motion comes near a singular pose, and reactions grow twentyfold."""

DIP = 0.3
"""The same: below this between two samples there may be a singular pose, and it is looked for."""

PROJECTED = 9
"""So many poses, equally spaced, are projected to find the rank that the motion has for the most part."""

LOOKED_FOR = 60
"""So many dips are refined at most, the deepest first."""

_HALVINGS = 24
"""Golden sections of a dip: 0.618²⁴ of two samples' distance is 1e-5."""

MANY = 60
"""So many rows and more are looked at by their products."""

LOOKS = 250
"""Of so many rows so many poses of a motion are looked at, equally spaced."""

LOW = 2.0 * DIP
"""Of the median: around values below it every pose is looked at, for there may be a dip between."""

TOGETHER = 256
"""Of fewer rows so many poses are looked at together: a call takes longer than the values of a few rows."""

SQUARED = 1e-3
"""A smallest singular value, of the largest, whose square has ten digits beside that of the largest."""

Kind = Literal["singular", "near"]


@dataclass(frozen=True)
class RankEvent:
    """A singular pose that a motion passes or comes near to.

    Attributes:
        kind: ``singular``: singular values vanish; ``near``: the smallest falls below ``NEAR`` of its median.
        time_s: when.
        start_s: since when the smallest singular value is below ``DIP`` of its median.
        end_s: until when.
        rank: at the pose.
        lost: ranks that are lost there; of a ``near`` one, that would be lost.
        smallest: smallest singular value of the whole motion's rank, of its median.
        equalities: those whose rows depend on one another there.
        qpos: the pose (nq), closed.
    """

    kind: Kind
    time_s: float
    start_s: float
    end_s: float
    rank: int
    lost: int
    smallest: float
    equalities: tuple[str, ...]
    qpos: np.ndarray


@dataclass(frozen=True)
class RankHistory:
    """The rank along a motion.

    Attributes:
        rank: what it is for the most part.
        ranks: at the closed poses that were looked at.
        smallest: smallest singular value of that rank at every sample (T), of the largest.
        dropped: largest one beyond it (T), of the largest: 1e-14 on closed poses, what drift makes of it on open ones.
        events: in the order of time.
        removable: equality → whether the rank without it is the same at every pose that was looked at.
        generic: the loops at a pose where the rank is that of the whole motion, without their dependencies.
    """

    rank: int
    ranks: tuple[int, ...]
    smallest: np.ndarray
    dropped: np.ndarray
    events: tuple[RankEvent, ...]
    removable: dict[str, bool]
    generic: Loops


def rank_events(
    model: mujoco.MjModel, qpos: np.ndarray, times_s: np.ndarray, data: mujoco.MjData | None = None
) -> RankHistory:
    """Follows the rank along a recorded motion.

    The samples may be open by what a soft loop drifts: the rank comes from some that are projected, and the singular
    values of that rank are followed along all of them. Where they dip, the pose between the samples at which they are
    least is looked for, and projected.

    Args:
        model: any; left alone.
        qpos: recorded poses (T, nq).
        times_s: their times (T).
        data: mocap bodies and which equalities are active; left alone.

    Raises:
        InputError: no pose, or one that is not finite; or as ``find_loops``.
    """
    if len(qpos) == 0 or not np.isfinite(qpos).all():
        raise InputError(f"{len(qpos)} poses, expected one or more, all finite")
    assembly = Assembly(model, data)
    looked_at = []
    for index in np.unique(np.linspace(0, len(qpos) - 1, PROJECTED).astype(int)):
        assembly.place(qpos[index])
        looked_at.append(loops_at(assembly, assembly.close(), dependent=False))
    closed = tuple(loops.rank for loops in looked_at if loops.closed)
    # A start next to a singular pose may have a rank of its own; of the others one that is less is passed.
    generic = max(looked_at, key=lambda loops: (closed.count(loops.rank), loops.rank, loops.closed))
    kept = [loops for loops in looked_at if loops.rank == generic.rank]
    removable = {loop.name: all(at.loops[k].removable for at in kept) for k, loop in enumerate(generic.loops)}
    if generic.rank == 0:
        none = np.zeros(len(qpos))
        return RankHistory(0, closed, none, none.copy(), (), removable, generic)
    view = _View(assembly, qpos, generic.rank)
    at_rank, beyond = view.along(qpos)
    usual = float(np.median(at_rank))
    events = [_refined(view, qpos, times_s, run, at_rank, usual) for run in _dips(at_rank, usual)]
    found = tuple(event for event in events if event is not None)
    return RankHistory(generic.rank, closed, at_rank, beyond, found, removable, generic)


class _View:
    """Singular values of all rows, scaled alike along the whole motion, relative to the largest."""

    def __init__(self, assembly: Assembly, qpos: np.ndarray, rank: int):
        self.assembly, self.rank = assembly, rank
        self.owners: list[Equality] = [one for one in assembly.equalities for _ in range(one.rows)]
        self._scales = scales_along(assembly, qpos)
        some = qpos[:: max(1, len(qpos) // SCALED)]
        self._largest = max(_sizes(self._folded_at(pose), rank)[0] for pose in some)

    def _folded_at(self, pose: np.ndarray) -> np.ndarray:
        """Scaled rows (k, nv) at a pose, proportional ones folded."""
        self.assembly.place(pose)
        return fold(self._scales[:, None] * self.assembly.whitened(self.assembly.jacobian())).rows

    def _look(self, poses: np.ndarray) -> np.ndarray:
        """Singular values at poses (T, nq): that of the rank, and the largest one beyond it, (T, 2)."""
        if self.rank >= MANY:
            found = np.array([_sizes(self._folded_at(pose), self.rank)[1:] for pose in poses])
        else:
            found = np.zeros((len(poses), 2))
            for first in range(0, len(poses), TOGETHER):
                some = poses[first : first + TOGETHER]
                rows = self._scales[:, None] * self.assembly.whitened_along(some)
                sizes = np.linalg.svd(rows, compute_uv=False)[:, self.rank - 1 : self.rank + 1]
                found[first : first + len(some), : sizes.shape[1]] = sizes
        return found.reshape(-1, 2) / self._largest

    def along(self, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Singular values (T): that of the rank, and the largest one beyond it.

        Of long motions of many rows they are computed at ``LOOKS`` poses, and at all of those around low ones; between
        the others they are interpolated.
        """
        found = np.full((len(qpos), 2), np.nan)

        def look(places: np.ndarray) -> None:
            unknown = places[np.isnan(found[places, 0])]
            found[unknown] = self._look(qpos[unknown])

        every = len(qpos) if self.rank < MANY else min(LOOKS, len(qpos))
        some = np.unique(np.linspace(0, len(qpos) - 1, every).astype(int))
        look(some)
        if every < len(qpos):
            values = found[some, 0]
            low = np.flatnonzero(values < LOW * np.median(values))
            for at in low:
                look(np.arange(some[max(0, at - 1)], some[min(len(some) - 1, at + 1)] + 1))
            known = np.flatnonzero(~np.isnan(found[:, 0]))
            for column in found.T:
                column[:] = np.interp(np.arange(len(qpos)), known, column[known])
        return found[:, 0], found[:, 1]

    def here(self) -> tuple[np.ndarray, np.ndarray]:
        """Left singular vectors (n, n) and singular values at the assembly's present pose."""
        assembly = self.assembly
        scaled = self._scales[:, None] * assembly.whitened(assembly.jacobian())
        directions, sigma, _ = np.linalg.svd(scaled)
        return directions, sigma / self._largest


def _sizes(rows: np.ndarray, rank: int) -> tuple[float, float, float]:
    """Singular values of rows (k, nv): the largest, that of the rank, and the largest one beyond it; 0 where none is.

    Of many rows, none of them beyond the rank, they are the roots of eigenvalues of the products, unless squares are
    too small for that.
    """
    if MANY <= len(rows) == rank:
        squares = np.linalg.eigvalsh(rows @ rows.T)
        if squares[0] > np.square(SQUARED) * squares[-1]:
            return float(np.sqrt(squares[-1])), float(np.sqrt(squares[0])), 0.0
    sizes = [*np.linalg.svd(rows, compute_uv=False)[: rank + 1].tolist(), *[0.0] * (rank + 1)]
    return sizes[0], sizes[rank - 1], sizes[rank]


def _dips(values: np.ndarray, usual: float) -> list[tuple[int, int, int]]:
    """First, least and last sample of every stretch below ``DIP`` of the usual value, in the order of time."""
    below = np.concatenate([[False], values < DIP * usual, [False]])
    edges = np.flatnonzero(below[1:] != below[:-1])
    runs = [
        (int(first), int(first + values[first:end].argmin()), int(end - 1))
        for first, end in zip(edges[::2], edges[1::2], strict=True)
    ]
    deepest = sorted(runs, key=lambda run: values[run[1]])[:LOOKED_FOR]
    return sorted(deepest)


def _refined(
    view: _View, qpos: np.ndarray, times_s: np.ndarray, run: tuple[int, int, int], values: np.ndarray, usual: float
) -> RankEvent | None:
    """The least singular value around a sample, by golden section on projected poses between its neighbours."""
    first, least, last = run
    low, high = max(0, least - 1), min(len(qpos) - 1, least + 1)
    assembly, model = view.assembly, view.assembly.model
    difference = np.zeros(model.nv)

    def smallest(place: float) -> float:
        before = min(int(place), len(qpos) - 2)
        pose = qpos[before].copy()
        mujoco.mj_differentiatePos(model, difference, 1.0, qpos[before], qpos[before + 1])
        mujoco.mj_integratePos(model, pose, difference, place - before)
        assembly.place(pose)
        assembly.close()
        return float(view.here()[1][view.rank - 1])

    ratio = 0.5 * (5.0**0.5 - 1.0)
    a, b = float(low), float(high)
    if len(qpos) > 1:
        c, d = b - ratio * (b - a), a + ratio * (b - a)
        at_c, at_d = smallest(c), smallest(d)
        for _ in range(_HALVINGS):
            if at_c < at_d:
                b, d, at_d = d, c, at_c
                c = b - ratio * (b - a)
                at_c = smallest(c)
            else:
                a, c, at_c = c, d, at_d
                d = a + ratio * (b - a)
                at_d = smallest(d)
        place = min((smallest(x), x) for x in (0.5 * (a + b), float(least)))[1]
        smallest(place)
    else:
        place = float(least)
        assembly.place(qpos[least])
    directions, sigma = view.here()
    value = float(sigma[view.rank - 1] / usual)
    if value > NEAR:
        return None
    kind: Kind = "singular" if value < SINGULAR else "near"
    # Those that vanish with the smallest: below its limit, or within ten times of it.
    limit = max(SINGULAR * usual, 10.0 * value * usual) if kind == "singular" else 2.0 * value * usual
    lost = int((sigma[: view.rank] <= limit).sum())
    part = np.abs(directions[:, view.rank - lost : view.rank]).max(axis=1)
    names = dict.fromkeys(owner.name for owner, size in zip(view.owners, part, strict=True) if size > 0.1)
    return RankEvent(
        kind,
        float(np.interp(place, np.arange(len(times_s)), times_s)),
        float(times_s[first]),
        float(times_s[last]),
        view.rank - lost if kind == "singular" else view.rank,
        lost,
        value,
        tuple(names),
        assembly.data.qpos.copy(),
    )
