"""Closed poses spread over all that a mechanism can reach from its start, and over the other ways to assemble it.

Every group of equalities is looked at by itself, and so is every joint of none. A branch of a group is what steps reach
from one another (``walk``): a part of its closed poses, inside of ranges, that no singular pose divides. Branches are
looked for from random poses, which are closed and then joined to those that steps reach; in each a random walk goes
some way straight on, turns, and goes on (hit and run: Smith 1984, Efficient Monte Carlo procedures for generating
points uniformly distributed over bounded regions), so that poses fill a branch evenly in the metric of ``chart``.

A joint without a range is taken within half a turn of the start, and a slide or a free joint within an arm of it: what
turns on and on is the same again, and a coupled one or a slide would go on for ever.
"""

from dataclasses import dataclass, field

import mujoco
import numpy as np

from oarlock.diagnosis.loops.walk import Place, Walk
from oarlock.mechanics.coupled import coupled, coupled_ids
from oarlock.mechanics.engine_version import tendon_dofs
from oarlock.poses.assembly import Assembly
from oarlock.poses.chart import Chart, arm_of, bounds
from oarlock.poses.nearest import groups_of

ORIGINS = 40
"""Random poses from which branches are looked for, for every group, at most."""

ENOUGH = 20
"""So many of them in a row that lead to nothing new end the search."""

ORIGIN_ROUNDS = 20
"""Newton steps that close one, at most."""

EFFORT = 15_000
"""Steps along closed poses that the search may take; the clock has no say."""

MOST = 12
"""Branches of a group at most, the start's own among them."""

PILOTS = 30
"""Legs of a walk by which a branch gets to know its own extent."""

LEG = 2.0
"""rad. A leg between two samples is up to so long."""

TURNS_BACK = 10
"""So often a leg is gone anew whose end, closed to rounding, is beyond a range by as much."""

RESTART = 20
"""Samples after which a walk goes on from elsewhere in its branch."""

TRIED = 3
"""Pairs of poses, one of each of two branches, between which a way is looked for."""

_HINGE, _FREE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_FREE)
_BALL, _SLIDE = int(mujoco.mjtJoint.mjJNT_BALL), int(mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True)
class Spread:
    """Poses of one group.

    Attributes:
        dofs: its degrees of freedom.
        rank: of its rows.
        poses: (n, nq), of which only the group's own coordinates count.
        branch: of each, (n); 0 is the start's own.
        smallest: smallest singular value of the rows that counts, (n); infinite where there are none.
    """

    dofs: np.ndarray
    rank: int
    poses: np.ndarray
    branch: np.ndarray
    smallest: np.ndarray


@dataclass
class _Branch:
    places: list[Place] = field(default_factory=list)


def spread(
    assembly: Assembly, start: np.ndarray, own: int, others: int, seed: int, ranges: np.ndarray | None = None
) -> list[Spread]:
    """Poses of every group: so many of the start's own branch, and so many of others, or of the same if there are none.

    Args:
        assembly: of ``fenced``.
        start: a closed pose (nq), inside of ranges.
        own: of the start's branch.
        others: of other branches; they share them evenly.
        seed: of the random numbers.
        ranges: as of ``bounds``, of the user's own model.
    """
    model = assembly.model
    arm = arm_of(assembly)
    assembly.place(start)
    within = reach(assembly, start, arm, bounds(model) if ranges is None else ranges)
    tied = _tied(assembly)
    found = []
    for number, (numbers, dofs) in enumerate(groups_of(assembly)):
        rng = np.random.default_rng([seed, number])
        chart = Chart(assembly, start, dofs, assembly.rows_of_all(numbers), arm, within)
        owners = model.dof_jntid[dofs]
        limited = np.isfinite((bounds(model) if ranges is None else ranges)[model.jnt_qposadr[owners]]).any(axis=1)
        wraps = (model.jnt_type[owners] == _HINGE) & ~limited & ~np.isin(dofs, sorted(tied))
        found.append(_Group(chart, wraps, rng).sample(own, others))
    return found


def reach(assembly: Assembly, start: np.ndarray, arm: float, ranges: np.ndarray) -> np.ndarray:
    """Ranges (nq, 2), with some for what has none but goes on for ever: coupled hinges, slides, free joints."""
    model, found, tied = assembly.model, ranges.copy(), _tied(assembly)
    for joint in range(model.njnt):
        kind, at, dof = int(model.jnt_type[joint]), int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        spans = {_SLIDE: [arm], _FREE: [arm] * 3, _HINGE: [np.pi] * (dof in tied)}.get(kind, [])
        for entry, span in enumerate(spans):
            if not np.isfinite(found[at + entry]).any():
                found[at + entry] = start[at + entry] - span, start[at + entry] + span
    return found


def _tied(assembly: Assembly) -> set[int]:
    """Degrees of freedom whose turns count, and not only their angle: of couplings, and of tendons with a range."""
    model = assembly.model
    found: set[int] = set()
    for equality in assembly.equalities:
        if not equality.kind.joins_points:
            found |= set(coupled(equality.kind).dofs(model, coupled_ids(model, equality.index)))
    for tendon in np.flatnonzero(model.tendon_limited):
        found |= set(tendon_dofs(model, int(tendon)))
    return found


class _Group:
    def __init__(self, chart: Chart, wraps: np.ndarray, rng: np.random.Generator):
        self._chart, self._wraps, self._rng = chart, wraps, rng
        self._walk = Walk(chart, wraps)

    def sample(self, own: int, others: int) -> Spread:
        """Poses of the start's branch, then of others."""
        walk, chart = self._walk, self._chart
        here = walk.at(walk.start)
        branches = [_Branch([here])] if here is not None else []
        if here is not None and len(chart.rows):
            self._explore(branches, others > 0)
        counts = [own + others] if len(branches) < 2 else [own, *_shares(others, len(branches) - 1)]
        places: list[Place] = []
        labels: list[int] = []
        for label, (branch, count) in enumerate(zip(branches, counts, strict=True)):
            places += self._fill(branch, count)
            labels += [label] * count
        if here is None:  # a singular start: nothing leads away from it that is known to be its own
            poses, smallest = np.tile(walk.start, (own + others, 1)), np.zeros(own + others)
            return Spread(chart.dofs, walk.rank, poses, np.zeros(own + others, dtype=int), smallest)
        poses = np.array([place.qpos for place in places]).reshape(-1, len(walk.start))
        smallest = np.array([place.smallest for place in places])
        return Spread(chart.dofs, walk.rank, poses, np.array(labels, dtype=int), smallest)

    # Branches.

    def _explore(self, branches: list[_Branch], wanted: bool) -> None:
        walk = self._walk
        self._wander(branches[0], PILOTS)
        known = 0  # origins in a row that led to nothing new
        for _ in range(ORIGINS if wanted else 0):
            if known >= ENOUGH or walk.steps > EFFORT:
                break
            known += 1
            origin = self._origin()
            if origin is None or self._met([origin], branches, 1) is not None:
                continue
            new = _Branch([origin])
            self._wander(new, PILOTS)
            home = self._met(new.places, branches, TRIED)
            if home is not None:
                home.places += new.places
            elif len(branches) < MOST:
                branches.append(new)
                known = 0
        # What has grown since may meet.
        for late in reversed(range(1, len(branches))):
            home = self._met(branches[late].places, branches[:late], TRIED)
            if home is not None:
                home.places += branches.pop(late).places

    def _origin(self) -> Place | None:
        """A closed pose from a random one, if it has the start's rank."""
        chart, walk = self._chart, self._walk
        chart.move(walk.start)
        least, most = np.maximum(chart.low, -np.pi), np.minimum(chart.high, np.pi)
        seen = chart.close(self._rng.uniform(least, most), ORIGIN_ROUNDS)
        return None if seen is None or not chart.inside(seen) else walk.at(chart.pose(seen.x))

    def _wander(self, branch: _Branch, legs: int) -> None:
        place = branch.places[0]
        for _ in range(legs):
            place = self._walk.leg(place, self._rng.uniform(0.0, LEG), self._rng)
            branch.places.append(place)

    def _met(self, some: list[Place], branches: list[_Branch], tries: int) -> _Branch | None:
        """The branch to which steps lead from some places; between the nearest pairs they are tried."""
        walk = self._walk
        here = np.array([place.x for place in some])
        for branch in branches:
            far = np.linalg.norm(walk.shorter(here[:, None] - np.array([place.x for place in branch.places])), axis=2)
            for pair in np.argsort(far, axis=None, kind="stable")[:tries]:
                a, b = np.unravel_index(pair, far.shape)
                if walk.connects(some[a], branch.places[b]) or walk.connects(branch.places[b], some[a]):
                    return branch
        return None

    # Poses.

    def _fill(self, branch: _Branch, count: int) -> list[Place]:
        if not len(self._chart.rows):
            return self._alone(count)
        found: list[Place] = []
        place = branch.places[0]
        for number in range(count):
            if number % RESTART == 0:
                place = branch.places[int(self._rng.integers(len(branch.places)))]
            for _ in range(TURNS_BACK):
                new = self._walk.leg(place, self._rng.uniform(0.0, LEG), self._rng)
                closed = self._walk.closed(new)
                if closed is not None:
                    place = closed
                    break
            found.append(self._wrapped(place))
        return found

    def _alone(self, count: int) -> list[Place]:
        """Of joints of no equality: uniform; rotations of balls and free joints too."""
        chart, walk, model = self._chart, self._walk, self._chart.assembly.model
        chart.move(walk.start)
        least, most = np.maximum(chart.low, -np.pi), np.minimum(chart.high, np.pi)
        found: list[Place] = []
        here = walk.at(walk.start)
        assert here is not None
        while len(found) < count:
            pose = chart.pose(self._rng.uniform(least, most))
            for joint in sorted(set(model.dof_jntid[chart.dofs].tolist())):
                if model.jnt_type[joint] in (_BALL, _FREE):
                    at = int(model.jnt_qposadr[joint]) + (3 if model.jnt_type[joint] == _FREE else 0)
                    turn = self._rng.normal(size=4)
                    pose[at : at + 4] = turn / np.linalg.norm(turn)
            chart.move(pose)
            if chart.inside(chart.see(np.zeros(chart.size))):
                found.append(Place(pose, here.x, here.free, np.inf, here.signed))
            chart.move(walk.start)
        return found

    def _wrapped(self, place: Place) -> Place:
        """The same pose with angles within half a turn of the start."""
        model, walk, pose = self._chart.assembly.model, self._walk, place.qpos.copy()
        at = model.jnt_qposadr[model.dof_jntid[self._chart.dofs[self._wraps]]]
        turns = np.round((pose[at] - walk.start[at]) / (2.0 * np.pi))
        pose[at] -= 2.0 * np.pi * turns
        if not turns.any():
            return place
        return walk.at(pose) or place


def _shares(count: int, among: int) -> list[int]:
    return [count // among + (number < count % among) for number in range(among)]
