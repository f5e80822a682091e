"""From a file to what its page shows: a check as far as its runs, and those as a film of the model."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.shapes import rotated
from oarlock.base.text import one_line
from oarlock.diagnosis.checked import begun, parts
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.loops.loops import Loops
from oarlock.diagnosis.options import CheckOptions
from oarlock.diagnosis.page.chapters.head import head
from oarlock.diagnosis.page.motion import Skeleton, drawing_plane, exaggeration
from oarlock.diagnosis.runs.recording import Recording
from oarlock.mechanics.controls import drive
from oarlock.mechanics.coupled import coupled, coupled_ids
from oarlock.mechanics.drive import Drive
from oarlock.mechanics.fatal import mujoco_ends_in_a_line
from oarlock.mechanics.given import Model
from oarlock.mechanics.names import Equality
from oarlock.viewer.film import Film, Side, Track, film
from oarlock.viewer.packing import packed
from oarlock.viewer.scene import Scene, scene

NEEDED = "run"
"""The last part of an examination that is shown."""

VISIBLE = 0.08
"""Of the extent: so wide the largest gap is drawn, at most."""

LONG = 0.22
"""Of the extent: so long an arrow of a usual force is."""

TILT = 0.35
"""By so much the view of a mechanism in a plane is turned out of its normal."""

LOOKS = 40
"""Frames at which it is looked what has to be in the view."""

LOST = (2, 98)
"""Percentiles of a run that diverged between which the view lies."""


@dataclass(frozen=True)
class Show:
    """What a page shows.

    Attributes:
        title: of the page; head: what was run.
        model: what is shown.
        centre: of what moves, (3), m; extent: its diameter, m; towards: from there to whoever looks, (3).
        frame: width, height and depth of what moves as it is looked at, m.
        factor: by which gaps are exaggerated at first; newton: length of an arrow for a newton, m.
        efforts: unit of the force of every equality.
        notes: what is not shown, or not as it is, and why.
    """

    title: str
    head: str
    model: mujoco.MjModel
    scene: Scene
    film: Film
    centre: np.ndarray
    extent: float
    towards: np.ndarray
    frame: np.ndarray
    factor: float
    newton: float
    efforts: list[str]
    notes: list[str]

    def document(self) -> dict[str, Any]:
        """For the page's script."""
        moving = self.film.moving
        layout = self.film.layout
        still = np.setdiff1d(np.arange(len(self.scene.names)), moving)
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
                    "effort": self.efforts[place],
                }
                for place, one in enumerate(layout.equalities)
            ],
            "unit": " or ".join(sorted({row.unit for row in layout.named})),
            "centre": self.centre.tolist(),
            "extent": self.extent,
            "towards": self.towards.tolist(),
            "frame": self.frame.tolist(),
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


@dataclass(frozen=True)
class Footage:
    """What a page is made of.

    Attributes:
        title: of the page; head: what was run.
        model: of both motions; driven: what moves its mocap bodies.
        run: MuJoCo's own motion, of at least a step; exact: the exact one, where there is one.
        finished: whether MuJoCo's run got to its end.
        loops: of the model, at a pose of the motion.
        notes: what is not shown, or not as it is, and why.
        steps: of MuJoCo's run.
    """

    title: str
    head: str
    model: mujoco.MjModel
    driven: Drive
    run: Track
    exact: Track | None
    finished: bool
    loops: Loops | None
    notes: list[str]
    steps: int


def shown(exam: Examination) -> Show:
    """What a page shows of an examination that has its runs.

    Raises:
        InputError: there is no run, or too many geoms.
    """
    recording = exam.recording
    if recording is None or not recording.steps:
        raise InputError(f"nothing to show: {exam.missing.get('run', 'the run has no step')}")
    return filmed(
        Footage(
            title=Path(exam.file).name,
            head=head(exam),
            model=exam.model,
            driven=drive(exam.model, exam.laws),
            run=recording,
            exact=exam.exact,
            finished=recording.end.how == "finished",
            loops=exam.pose.loops if exam.pose else None,
            notes=[*_exact(exam), *_ended(recording)],
            steps=recording.steps,
        )
    )


def filmed(given: Footage) -> Show:
    """What a page shows of two motions.

    Raises:
        InputError: too many geoms.
    """
    model, run = given.model, given.run
    moving = film(model, given.driven, run, given.exact, finished=given.finished)
    skeleton = Skeleton(model, run.layout.equalities)
    lost = not moving.finished and len(moving.sides) == 1
    last = given.exact if given.exact is not None and len(moving.sides) > 1 else run
    looked = moving.steps[: len(moving.sides[-1].poses)]
    points = skeleton.read(last.qpos[looked], last.time[looked], given.driven)
    axes = _axes(*drawing_plane(given.loops, points))
    corners = np.concatenate(
        [points.reshape(-1, 3), *(_corners(model, side, moving.moving) for side in moving.trusted)]
    )
    corners = corners[np.isfinite(corners).all(axis=1)]
    low, high = (
        np.percentile(corners @ axes.T, LOST if lost else (0, 100), axis=0) if len(corners) else np.zeros((2, 3))
    )
    extent = float(np.linalg.norm(high - low)) or 1.0
    made = scene(model, skeleton, points[0], moving.sides[-1].poses[0], extent)
    some = [f"{len(moving.steps)} of {given.steps} steps are shown."] if len(moving.steps) < given.steps else []
    return Show(
        title=one_line(given.title),
        head=given.head,
        model=model,
        scene=made,
        film=moving,
        centre=0.5 * (low + high) @ axes,
        extent=extent,
        towards=axes[2],
        frame=high - low,
        factor=exaggeration(moving.gap, VISIBLE * extent),
        newton=LONG * extent / moving.force if moving.force > 0.0 else 1.0,
        efforts=[_effort(model, one) for one in run.layout.equalities],
        notes=[one_line(note) for note in [*given.notes, *some, *made.notes]],
    )


def _corners(model: mujoco.MjModel, side: Side, moving: np.ndarray) -> np.ndarray:
    """Corners (n, 3) of boxes around the geoms that move, at some frames, world, m."""
    looks = np.unique(np.linspace(0, len(side.poses) - 1, LOOKS).astype(int))
    bodies = set(moving.tolist()) or set(range(model.nbody))
    geoms = [g for g in range(model.ngeom) if int(model.geom_bodyid[g]) in bodies and model.geom_rbound[g] > 0.0]
    boxes = model.geom_aabb[geoms]
    signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
    local = boxes[:, None, :3] + signs * boxes[:, None, 3:]
    own = model.geom_pos[geoms][:, None] + rotated(model.geom_quat[geoms][:, None], local)
    poses = side.poses[looks][:, model.geom_bodyid[geoms], None]
    return (poses[..., :3] + rotated(poses[..., 3:], own[None])).reshape(-1, 3)


def _axes(right: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Right, up and towards whoever looks, (3, 3), a little from the right and from above of what looks at a plane."""
    towards = np.cross(right, up) + TILT * (0.6 * right + up)
    towards /= np.linalg.norm(towards)
    # The camera stands upright, whatever the plane is.
    across = np.cross([0.0, 0.0, 1.0], towards)
    across /= np.linalg.norm(across)
    return np.array([across, np.cross(towards, across), towards])


def _effort(model: mujoco.MjModel, equality: Equality) -> str:
    if equality.kind.joins_points:
        return "N"
    return coupled(equality.kind).effort(model, coupled_ids(model, equality.index)[0])


def _exact(exam: Examination) -> list[str]:
    exact = exam.exact
    if exact is None:
        return [f"MuJoCo's motion alone: there is no exact solution: {exam.missing.get('exact', _unclosed(exam))}."]
    if not len(exact.qpos):
        return [f"MuJoCo's motion alone: there is no exact solution: {exact.end.message}."]
    notes = ["Forces of the exact solution are those of least norm."]
    if exact.note:
        notes.append(f"The exact solution steps with {exact.integrator} ({exact.note}).")
    if exact.end.how != "finished":
        notes.append(f"The exact solution ends at t = {exact.end.time_s:.6g} s: {exact.end.message}.")
    return notes


def _unclosed(exam: Examination) -> str:
    return "no pose near the start closes the loops" if not exam.closed else "not looked for"


def _ended(recording: Recording) -> list[str]:
    if recording.end.how == "finished":
        return []
    return [f"MuJoCo's run ends at t = {recording.end.time_s:.6g} s: {recording.end.message}."]
