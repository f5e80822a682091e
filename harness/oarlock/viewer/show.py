"""From a file to what its page shows: a check as far as its runs, and those as a film of the model."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.text import one_line
from oarlock.diagnosis.checked import begun, parts
from oarlock.diagnosis.examination import Examination
from oarlock.diagnosis.options import CheckOptions
from oarlock.diagnosis.page.chapters.head import head
from oarlock.diagnosis.page.motion import Skeleton, drawing_plane, exaggeration
from oarlock.mechanics.controls import drive
from oarlock.mechanics.fatal import mujoco_ends_in_a_line
from oarlock.mechanics.given import Model
from oarlock.viewer.film import Film, film
from oarlock.viewer.packing import packed
from oarlock.viewer.scene import Scene, scene

NEEDED = "run"
"""The last part of an examination that is shown."""

VISIBLE = 0.08
"""Of the extent: so wide the largest gap is drawn, at most."""

LONG = 0.3
"""Of the extent: so long an arrow of a usual force is."""

TILT = 0.35
"""By so much the view of a mechanism in a plane is turned out of its normal."""

LOST = (2, 98)
"""Percentiles of a run that diverged between which the view lies."""


@dataclass(frozen=True)
class Show:
    """What a page shows.

    Attributes:
        title: of the page; head: what was run.
        centre: of what moves, (3), m; extent: its diameter, m; towards: from there to whoever looks, (3).
        factor: by which gaps are exaggerated at first; newton: length of an arrow for a newton, m.
        notes: what is not shown, or not as it is, and why.
    """

    title: str
    head: str
    scene: Scene
    film: Film
    centre: np.ndarray
    extent: float
    towards: np.ndarray
    factor: float
    newton: float
    notes: list[str]

    def document(self) -> dict[str, Any]:
        """For the page's script."""
        moving = self.film.moving
        layout = self.film.layout
        still = np.setdiff1d(np.arange(len(self.scene.names)), moving)
        joined = {place: row for row, place in enumerate(self.film.joining)}
        return {
            "scene": self.scene.document(),
            "times": packed(self.film.times),
            "moving": moving.tolist(),
            "still": still.tolist(),
            "standing": packed(self.film.sides[0].poses[0, still]),
            "sides": [side.document(moving) for side in self.film.sides],
            "equalities": [
                {
                    "name": one_line(one.name),
                    "unit": "m" if one.kind.joins_points else one.unit,
                    "joined": joined.get(place, -1),
                }
                for place, one in enumerate(layout.equalities)
            ],
            "centre": self.centre.tolist(),
            "extent": self.extent,
            "towards": self.towards.tolist(),
            "factor": self.factor,
            "newton": self.newton,
            "drift": float(np.nan_to_num(self.film.sides[0].drift).max()),
        }


def show(model: Model, options: CheckOptions, part: Callable[[str], None] | None = None) -> Show:
    """Runs a model, exactly too where that is possible, and makes of it what a page shows.

    Args:
        model: as of ``oarlock.check``.
        options: where the run starts, what drives it, how long it is.
        part: is called with the name of every part that is there.

    Raises:
        InputError: as ``oarlock.check``, no run, or too many geoms.
    """
    exam = begun(model, options)
    for name in parts(exam):
        if part is not None:
            part(name)
        if name == NEEDED:
            break
    with mujoco_ends_in_a_line(exam.file):
        return shown(exam)


def shown(exam: Examination) -> Show:
    """What a page shows of an examination that has its runs.

    Raises:
        InputError: there is no run, or too many geoms.
    """
    recording = exam.recording
    if recording is None or not recording.steps:
        raise InputError(f"nothing to show: {exam.missing.get('run', 'the run has no step')}")
    moving = film(exam, recording)
    skeleton = Skeleton(exam.model, recording.layout.equalities)
    lost = recording.end.how != "finished" and len(moving.sides) == 1
    centre, extent, points = _framed(exam, moving, skeleton, lost)
    made = scene(exam.model, skeleton, points[0], moving.sides[0].poses[0], extent)
    right, up = drawing_plane(exam, points)
    return Show(
        title=one_line(exam.file),
        head=head(exam),
        scene=made,
        film=moving,
        centre=centre,
        extent=extent,
        towards=_towards(right, up),
        factor=exaggeration(moving.gap, VISIBLE * extent),
        newton=LONG * extent / moving.force if moving.force > 0.0 else 1.0,
        notes=[one_line(note) for note in [*_exact(exam), *_cut(exam, moving), *made.notes]],
    )


def _framed(
    exam: Examination, moving: Film, skeleton: Skeleton, lost: bool
) -> tuple[np.ndarray, float, np.ndarray]:
    """Middle (3) and diameter of what moves, m, and the points of the skeleton at the frames, (n, P, 3)."""
    model, side = exam.model, moving.sides[-1]
    points = skeleton.read(_poses_at(exam, moving), moving.times[: len(side.poses)], drive(model, exam.laws))
    bodies = set(moving.moving.tolist()) or set(range(model.nbody))
    geoms = [
        geom
        for geom in range(model.ngeom)
        if int(model.geom_bodyid[geom]) in bodies and model.geom_rbound[geom] > 0.0
    ]
    owners, reach = model.geom_bodyid[geoms], model.geom_rbound[geoms][:, None]
    middles = side.poses[:, owners, :3] + rotated(side.poses[:, owners, 3:], model.geom_pos[geoms])
    everything = [points, middles - reach, middles + reach]
    flat = np.concatenate([values.reshape(-1, 3) for values in everything])
    flat = flat[np.isfinite(flat).all(axis=1)]
    low, high = np.percentile(flat, LOST if lost else (0, 100), axis=0) if len(flat) else np.zeros((2, 3))
    extent = float(np.linalg.norm(high - low))
    return 0.5 * (low + high), extent if extent > 0.0 else 1.0, points


def _poses_at(exam: Examination, moving: Film) -> np.ndarray:
    exact, recording = exam.exact, exam.recording
    assert recording is not None
    if len(moving.sides) > 1:
        assert exact is not None
        return exact.qpos[moving.steps[moving.steps < len(exact.qpos)]]
    return recording.qpos[moving.steps]


def rotated(quats: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (…, 3) turned by unit quaternions (…, 4)."""
    w, axis = quats[..., :1], quats[..., 1:]
    twice = 2.0 * np.cross(axis, vectors)
    return vectors + w * twice + np.cross(axis, twice)


def _towards(right: np.ndarray, up: np.ndarray) -> np.ndarray:
    """A little from the right and from above of what looks at the plane of these two."""
    found = np.cross(right, up) + TILT * (0.6 * right + up)
    return found / np.linalg.norm(found)


def _exact(exam: Examination) -> list[str]:
    exact = exam.exact
    if exact is None:
        return [f"MuJoCo's motion alone: there is no exact solution: {exam.missing.get('exact', _unclosed(exam))}"]
    if not len(exact.qpos):
        return [f"MuJoCo's motion alone: there is no exact solution: {exact.end.message}"]
    notes = ["Forces of the exact solution are those of least norm."]
    if exact.note:
        notes.append(f"The exact solution steps with {exact.integrator} ({exact.note}).")
    if exact.end.how != "finished":
        notes.append(f"The exact solution ends at t = {exact.end.time_s:.6g} s: {exact.end.message}.")
    return notes


def _unclosed(exam: Examination) -> str:
    return "no pose near the start closes the loops" if not exam.closed else "not looked for"


def _cut(exam: Examination, moving: Film) -> list[str]:
    recording, notes = exam.recording, []
    assert recording is not None
    if recording.end.how != "finished":
        notes.append(f"MuJoCo's run ends at t = {recording.end.time_s:.6g} s: {recording.end.message}.")
    if len(moving.steps) < recording.steps:
        notes.append(f"{len(moving.steps)} of {recording.steps} steps are shown.")
    return notes


def pose_of(model: mujoco.MjModel, poses: np.ndarray, geom: int) -> np.ndarray:
    """Where a geom is, world, m, (n, 3), by the poses of all bodies (n, nbody, 7)."""
    body = int(model.geom_bodyid[geom])
    return poses[:, body, :3] + rotated(poses[:, body, 3:], model.geom_pos[geom])
