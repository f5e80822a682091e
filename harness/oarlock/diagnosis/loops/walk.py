"""Steps from one closed pose to the next, along what rows admit: continuous, inside of ranges, past no singular pose.

A step goes along a tangent and returns to the rows by Newton's steps (a numerical continuation: Rheinboldt 1988, On the
computation of multi-dimensional solution manifolds of parametrized equations). It is refused where it leaves a range,
where it does not return near by, and where the smallest singular value σ of the rows changes sign on it: with its
vectors u and v at the old pose, uᵀ J v is σ there, and what becomes of it at the new one.
"""

from dataclasses import dataclass

import numpy as np

from oarlock.poses.chart import Chart, Seen

STRIDE = 0.2
"""rad. Length of a step: a thirtieth of a turn, over which the rows bend by some hundredths."""

ON_THE_WAY = 1e-6
"""rad. So far rows may be open between two steps of a way, over their lengths; at its end they are closed."""

LEAST_GAIN = 0.2
"""Of a step: a way to a pose that comes nearer by less leads elsewhere."""

CORRECTIONS = 8
"""Newton steps back to the rows, at most: a stride away they square the gap."""

RETURNS = 0.5
"""Of a stride: a correction that is longer does not return, it goes elsewhere."""

SHORTER = 4
"""So often a stride is halved before the way counts as closed."""

POLISHES = 3
"""Corrections at the end of a way, at most, while they bring rows nearer."""

ARRIVED = 1e-5
"""rad. Two poses that are so near are one."""

LEFT = 1e-14
"""rad. What may be left open of a row, over its length, per 1 of the coordinates: some roundings."""


@dataclass(frozen=True)
class Place:
    """A closed pose.

    Attributes:
        qpos: (nq).
        free: orthonormal basis (k, d) of what the rows admit.
        x: its coordinates from the start (k), angles that turn on and on within half a turn.
        smallest: smallest singular value of the rows that counts.
        signed: its left (n) and right (k) vector.
    """

    qpos: np.ndarray
    x: np.ndarray
    free: np.ndarray
    smallest: float
    signed: tuple[np.ndarray, np.ndarray]


class Walk:
    """Goes along the closed poses of a chart.

    Args:
        chart: whose q₀ is closed.
        wraps: which of the coordinates (k) are angles that turn on and on: they are compared modulo 2π.

    Attributes:
        rank: of the rows at q₀, which all poses have.
        steps: that were tried so far.
    """

    def __init__(self, chart: Chart, wraps: np.ndarray):
        self.chart, self._wraps = chart, wraps
        self._origin = np.zeros(chart.size)
        self.start = chart.base.copy()
        self.steps = 0
        seen = chart.see(self._origin)
        self.rank = seen.split()[3]
        self._left = max(LEFT, 4.0 * seen.gap)  # rows that contradict one another close no further

    @property
    def dof(self) -> int:
        """Degrees of freedom that the rows leave."""
        return self.chart.size - self.rank

    def at(self, qpos: np.ndarray) -> Place | None:
        """The place of a closed pose (nq); None if its rank is another: it is singular, or of another mobility."""
        self.chart.move(qpos)
        return self._placed(self.chart.see(self._origin), qpos)

    def _placed(self, seen: Seen, qpos: np.ndarray) -> Place | None:
        left, sizes, right = np.linalg.svd(seen.rows)
        rank = self.rank
        if rank and not sizes[rank - 1] > 1e-9 * sizes[0]:
            return None
        if rank < len(sizes) and sizes[rank] > max(1e-9, 10.0 * seen.gap) * sizes[0]:
            return None
        last = (left[:, rank - 1], right[rank - 1]) if rank else (np.zeros(len(seen.rest)), np.zeros(len(right)))
        x = self.apart(self.start, qpos)
        return Place(qpos.copy(), x, right[rank:].T, float(sizes[rank - 1]) if rank else np.inf, last)

    def step(self, place: Place, way: np.ndarray, stride: float) -> tuple[Place, np.ndarray] | None:
        """A step from a place along a tangent (k), of norm 1.

        Returns:
            The new place, and what leads there (k); None where the way is closed.
        """
        chart = self.chart
        chart.move(place.qpos)
        for _ in range(SHORTER):
            self.steps += 1
            seen = self._returned(stride * way, stride, ON_THE_WAY)
            if seen is not None and chart.inside(seen) and not self._crosses(place, seen):
                pose = chart.pose(seen.x)
                # Of hinges and slides the derivatives are those at the new pose already.
                there = self.at(pose) if chart.turning else self._placed(seen, pose)
                if there is not None:
                    return there, seen.x
                chart.move(place.qpos)
            stride *= 0.5
        return None

    def closed(self, place: Place) -> Place | None:
        """The same place closed to rounding; None if that leads out of a range."""
        self.chart.move(place.qpos)
        seen = self._returned(self._origin, STRIDE, self._left)
        if seen is None:
            return None
        for _ in range(POLISHES):  # a row of a steep coupling is long: what is rounding over its length is none in it
            left, sizes, right, rank = seen.split(self.rank)
            there = self.chart.see(seen.x - right[:rank].T @ ((left.T @ seen.rest) / sizes))
            if not there.gap < seen.gap:
                break
            seen = there
        return self.at(self.chart.pose(seen.x)) if self.chart.inside(seen) else None

    def _returned(self, x: np.ndarray, stride: float, left_open: float) -> Seen | None:
        chart, begin = self.chart, x
        left_open = max(left_open, self._left)
        seen = chart.see(x)
        for _ in range(CORRECTIONS):
            if seen.gap <= left_open:
                return seen
            left, sizes, right, rank = seen.split(self.rank)
            if rank and sizes[-1] <= 1e-9 * sizes[0]:
                return None
            x = seen.x - right[:rank].T @ ((left.T @ seen.rest) / sizes)
            if np.linalg.norm(x - begin) > RETURNS * stride:
                return None
            there = chart.see(x)
            if there.gap >= seen.gap and seen.gap <= 1e2 * self._left:
                return seen
            seen = there
        return seen if seen.gap <= 1e2 * self._left else None

    def _crosses(self, place: Place, seen: Seen) -> bool:
        left, right = place.signed
        return bool(self.rank) and float(left @ seen.rows @ right) <= 0.0

    def leg(self, place: Place, length: float, rng: np.random.Generator) -> Place:
        """Goes some way (rad) from a place, straight on; where it is closed, on in another direction."""
        if not self.dof:
            return place
        way, walls = self._direction(place, rng), 0
        while length > 0.0 and walls < 4 * self.dof + 4:
            stride = min(STRIDE, length)
            taken = self.step(place, way, stride)
            if taken is None:
                way, walls = self._direction(place, rng), walls + 1
                continue
            place, moved = taken
            length -= max(float(np.linalg.norm(moved)), 1e-3)
            along = place.free @ (place.free.T @ moved)
            size = float(np.linalg.norm(along))
            way = along / size if size > 0.0 else self._direction(place, rng)
        return place

    def _direction(self, place: Place, rng: np.random.Generator) -> np.ndarray:
        way = place.free @ rng.normal(size=place.free.shape[1])
        return way / max(float(np.linalg.norm(way)), 1e-300)

    def apart(self, place: np.ndarray, other: np.ndarray) -> np.ndarray:
        """What leads from one pose (nq) to another, (k); the shorter way round."""
        change = self.chart.assembly.difference(place, other)[self.chart.dofs] / self.chart.unit
        return self.shorter(change)

    def shorter(self, change: np.ndarray) -> np.ndarray:
        """Changes (…, k) of coordinates, the shorter way round."""
        return np.where(self._wraps, change - 2.0 * np.pi * np.round(change / (2.0 * np.pi)), change)

    def connects(self, place: Place, other: Place) -> bool:
        """Whether steps lead from one place towards another until they arrive."""
        far = float(np.linalg.norm(self.apart(place.qpos, other.qpos)))
        for _ in range(int(20 + 4 * far / STRIDE)):
            towards = self.apart(place.qpos, other.qpos)
            far = float(np.linalg.norm(towards))
            if far <= ARRIVED:
                return True
            along = place.free @ (place.free.T @ towards)
            size = float(np.linalg.norm(along))
            if size <= 1e-3 * far:
                return False
            taken = self.step(place, along / size, min(STRIDE, size))
            if taken is None:
                return False
            place, moved = taken
            gained = far - float(np.linalg.norm(self.apart(place.qpos, other.qpos)))
            if gained < LEAST_GAIN * float(np.linalg.norm(moved)):
                return False
        return False
