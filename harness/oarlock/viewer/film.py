"""Both motions at some steps: where bodies and tendons are, how far equalities are off, what they pull with."""

from dataclasses import dataclass
from typing import Any, Protocol

import mujoco
import numpy as np

from oarlock.diagnosis.page.motion import Opened, widest
from oarlock.mechanics.drive import Drive
from oarlock.mechanics.names import Equality
from oarlock.mechanics.shapes import body_poses
from oarlock.poses.assembly import anchors
from oarlock.poses.layout import Layout
from oarlock.viewer.packing import packed

FRAMES = 600
"""Steps of a run that are shown at most."""

FEWEST = 20
"""However large the model is, so many."""

NUMBERS = 3_000_000
"""Numbers of a page at most: with many bodies fewer steps are shown."""

TENDON_POINTS = 64
"""Of a tendon's way at most; the rest of one that touches more is left out."""

ARRAYS = ("middles", "gaps", "forces", "off", "pulls", "drift", "tendons")
"""Fields of a side that the page takes as they are."""

STILL = 1e-12
"""m, or part of a turn. A body that moves by less stands still, and has no ghost."""


class Track(Opened, Protocol):
    """A run as its steps tell it, each at its start; rows in the layout."""

    @property
    def time(self) -> np.ndarray:
        """(steps), s."""
        ...

    @property
    def qpos(self) -> np.ndarray:
        """(steps, nq)."""
        ...

    @property
    def force(self) -> np.ndarray:
        """(steps, rows), N or N m, in MuJoCo's sign; NaN where it is not known."""
        ...

    @property
    def present(self) -> np.ndarray:
        """Whether a row was there, (steps, rows)."""
        ...


@dataclass(frozen=True)
class Side:
    """One of the motions, at each of its frames; n of them.

    Attributes:
        title: whose it is.
        poses: of all bodies, (n, nbody, 7): place in the world, m, and quaternion.
        middles: between the two points of every equality that joins points, (n, E, 3), m.
        gaps: from its second to its first point, (n, E, 3), m; NaN where it is switched off.
        forces: on its first body, world axes, (n, E, 3), N.
        off: largest row of every equality, (n, Q), m or rad.
        pulls: size of the force of every equality, (n, Q): of one that joins points N, of a coupling its multiplier.
        drift: largest of all rows, (n).
        tendons: ways, (n, T, W, 3), m, the last point repeated.
    """

    title: str
    poses: np.ndarray
    middles: np.ndarray
    gaps: np.ndarray
    forces: np.ndarray
    off: np.ndarray
    pulls: np.ndarray
    drift: np.ndarray
    tendons: np.ndarray

    def document(self, moving: np.ndarray) -> dict[str, Any]:
        """For the page's script, with the poses of the bodies that move."""
        arrays = {name: packed(getattr(self, name)) for name in ARRAYS}
        return {"title": self.title, "frames": len(self.poses), "poses": packed(self.poses[:, moving]), **arrays}


@dataclass(frozen=True)
class Film:
    """What is shown over time.

    Attributes:
        times: of the frames, s, (F); steps: the numbers of their steps.
        joining: places, among the equalities of the layout, of those that join points.
        finished: whether MuJoCo's run got to its end.
        sides: MuJoCo's, and the exact one where it is known, with F frames or fewer.
        moving: numbers of the bodies that move.
    """

    layout: Layout
    times: np.ndarray
    steps: np.ndarray
    joining: list[int]
    sides: list[Side]
    moving: np.ndarray
    finished: bool

    @property
    def gap(self) -> float:
        """The largest gap of MuJoCo's motion, m."""
        return _largest(self.sides[0].gaps)

    @property
    def trusted(self) -> list[Side]:
        """The sides by which view and arrows are scaled: a motion that diverged is the last to be."""
        return self.sides if self.finished else self.sides[-1:]

    @property
    def force(self) -> float:
        """What most forces stay below, N: in nineteen of twenty frames."""
        sizes = [np.linalg.norm(side.forces, axis=2).max(axis=1, initial=0.0) for side in self.trusted]
        finite = np.concatenate(sizes)
        finite = finite[np.isfinite(finite)]
        return float(np.percentile(finite, 95)) if len(finite) else 0.0


def _largest(vectors: np.ndarray) -> float:
    return float(np.nan_to_num(np.linalg.norm(vectors, axis=-1)).max(initial=0.0))


def film(model: mujoco.MjModel, driven: Drive, run: Track, exact: Track | None, *, finished: bool) -> Film:
    """Both motions at equally spaced steps, and at the one with the widest gap.

    Args:
        model: of both.
        driven: what moves its mocap bodies.
        run: MuJoCo's own motion.
        exact: the exact one, step by step beside the other, where it is known; it may be shorter.
        finished: whether MuJoCo's run got to its end.
    """
    layout = run.layout
    joining = [place for place, one in enumerate(layout.equalities) if one.kind.joins_points]
    finite = np.flatnonzero(np.isfinite(run.qpos).all(axis=1))
    each = 2 * (7 * model.nbody + 9 * len(joining) + len(layout.equalities) + 12 * model.ntendon)
    count = int(min(FRAMES, max(FEWEST, NUMBERS // each), len(finite)))
    spaced = finite[np.linspace(0, len(finite) - 1, count).astype(int)]
    steps = np.unique([*spaced, widest(run, finite)])
    sides = [_side("MuJoCo", model, run, steps, run.time[steps], joining, driven)]
    if exact is not None and len(exact.qpos):
        known = steps[steps < len(exact.qpos)]
        sides.append(_side("exact", model, exact, known, exact.time[known], joining, driven))
    ranges = [np.ptp(side.poses, axis=0).max(axis=1, initial=0.0) for side in sides]
    apart = np.abs(sides[0].poses[0] - sides[-1].poses[0]).max(axis=1)
    moving = np.flatnonzero(np.maximum(np.max(ranges, axis=0), apart) > STILL)
    return Film(layout, run.time[steps], steps, joining, sides, moving, finished)


def _side(
    title: str,
    model: mujoco.MjModel,
    run: Track,
    steps: np.ndarray,
    times: np.ndarray,
    joining: list[int],
    driven: Drive,
) -> Side:
    layout = run.layout
    poses, middles, gaps, tendons = _placed(
        model, run.qpos[steps], times, driven, [layout.equalities[place] for place in joining]
    )
    there = np.stack([run.present[steps][:, layout.of_equality(at)].any(axis=1) for at in range(len(layout.starts))], 1)
    position = np.abs(run.position[steps])
    off = np.stack([position[:, layout.of_equality(at)].max(axis=1) for at in range(len(layout.starts))], 1)
    drift = position.max(axis=1, initial=0.0)
    pulls = np.abs(run.force[steps][:, layout.starts])
    forces = np.zeros((len(steps), len(joining), 3))
    for column, place in enumerate(joining):
        forces[:, column] = run.force[steps, layout.starts[place] :][:, :3]
        pulls[:, place] = np.linalg.norm(forces[:, column], axis=1)
    gaps[~there[:, joining]] = np.nan
    forces[~there[:, joining]] = np.nan
    off[~there] = pulls[~there] = np.nan
    return Side(title, poses, middles, gaps, forces, off, pulls, drift, tendons)


def _placed(
    model: mujoco.MjModel, qpos: np.ndarray, times: np.ndarray, driven: Drive, joining: list[Equality]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Poses of bodies, middles and gaps of equalities, and ways of tendons, at poses (n, nq) and times (n), s."""
    data, count = mujoco.MjData(model), len(qpos)
    ends = np.zeros((count, len(joining), 2, 3))
    ways: list[list[np.ndarray]] = []
    spatial = [
        tendon
        for tendon in range(model.ntendon)
        if model.wrap_type[model.tendon_adr[tendon]] != mujoco.mjtWrap.mjWRAP_JOINT
    ]
    for at, pose in enumerate(qpos):
        data.qpos[:], data.time = pose, times[at]
        driven.move(data)
        mujoco.mj_kinematics(model, data)
        for place, equality in enumerate(joining):
            ends[at, place] = anchors(model, data, equality)
        if spatial:
            mujoco.mj_comPos(model, data)
            mujoco.mj_tendon(model, data)
            ways.append([_way(data, tendon) for tendon in spatial])
    width = max((len(way) for frame in ways for way in frame), default=0)
    tendons = np.zeros((count, len(spatial) if width else 0, width, 3))
    for at, frame in enumerate(ways if width else []):
        for place, way in enumerate(frame):
            tendons[at, place, : len(way)], tendons[at, place, len(way) :] = way, way[-1] if len(way) else 0.0
    return body_poses(model, qpos, times, driven), ends.mean(axis=2), ends[:, :, 0] - ends[:, :, 1], tendons


def _way(data: mujoco.MjData, tendon: int) -> np.ndarray:
    first, points = int(data.ten_wrapadr[tendon]), int(data.ten_wrapnum[tendon])
    return data.wrap_xpos.reshape(-1, 3)[first : first + points][:TENDON_POINTS].copy()
