"""The moving mechanism: MuJoCo's run beside the exact one, as points on a plane, the gaps of its loops exaggerated.

A body is a star, as in ``oarlock.sketch``: lines from its first joint to what is fixed to it, all of which moves with
it. A slide has a rail, from where it begins to where the body is. A gap is exaggerated by moving the two points of a
connect or weld apart along it; the bodies' lines follow, except where such a point is in the air (``outline``): there
the body is drawn to its own end, and a dotted line joins that to the point. Poses are MuJoCo's own.
"""

import html
import math
from dataclasses import dataclass
from typing import Any, Protocol

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.numbers import figure
from oarlock.base.shapes import Mesh, Shape, coarse
from oarlock.base.text import one_line as plain
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.loops.loops import Loops
from oarlock.mechanics.controls import drive
from oarlock.mechanics.drive import Drive
from oarlock.mechanics.names import Equality, element_name
from oarlock.mechanics.outline import distinct_joints, drawn_end, fixed_point, rails_of, stands
from oarlock.mechanics.shapes import body_poses, shapes_of, visited
from oarlock.poses.assembly import anchors
from oarlock.poses.layout import Layout
from oarlock.render.charts import VIEW
from oarlock.render.solids import ROUND, outlines

FRAMES = 140
"""Poses of a run that are drawn."""

FEWEST = 20
"""However large the model is, so many."""

NUMBERS = 300_000
"""Coordinates of a page at most: with many bodies fewer poses are drawn."""

FAINT = 0.5
"""Opacity of geoms: the lines of the joints lie over them."""

VISIBLE = 0.06
"""Of the drawing's size: so large the largest gap is drawn, at most."""

MOST = 1e6
"""By so much a gap is exaggerated at most."""

SIDE = 1000
"""Units of the drawing's longer side."""

FLAT = 1e-6
"""Of the extent: a mechanism that moves by less across a plane is in it."""

PALETTE = ("#1b9e77", "#7570b3", "#66a61e", "#a6761d", "#1f78b4", "#e7298a", "#b8860b", "#6a8caf")
RAIL = "#bbb"
GAP, MARK = "#d7301f", "#d7301f"

_JOINT, _BODY = mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_BODY


class Skeleton:
    """The points of a model that are drawn, in a fixed order, and the lines between them."""

    def __init__(self, model: mujoco.MjModel, equalities: tuple[Equality, ...]):
        self.model, self._data = model, mujoco.MjData(model)
        self._sources: list[tuple[str, int, int]] = []
        self._of: dict[tuple[str, int, int], int] = {}
        self._locals: list[np.ndarray] = []
        self._closing = [one for one in equalities if one.kind.joins_points]
        self._equalities = {one.index: one for one in self._closing}
        mujoco.mj_kinematics(model, self._data)
        ends = {(one.index, end): self._point("anchor", one.index, end) for one in self._closing for end in (0, 1)}
        self.loops = [(ends[one.index, 0], ends[one.index, 1]) for one in self._closing]
        self.still = [tuple(body == 0 for body in one.bodies) for one in self._closing]
        self.bodies: list[tuple[str, list[tuple[int, int]]]] = []
        self.grounded: list[int] = [
            ends[one.index, end] for one in self._closing for end in (0, 1) if not one.bodies[end]
        ]
        self.joints: list[int] = []
        self.rails: list[tuple[int, int]] = []
        self.air: list[tuple[int, int]] = []
        for body in range(1, model.nbody):
            self._add(body, ends)
        self.couplings = [
            (self._joint(first), self._joint(second))
            for one in equalities
            if one.kind.holds == "joints"
            and (first := int(model.eq_obj1id[one.index])) >= 0
            and (second := int(model.eq_obj2id[one.index])) >= 0
        ]

    def _point(self, kind: str, index: int, end: int = 0) -> int:
        source = kind, index, end
        if source not in self._of:
            self._of[source] = len(self._sources)
            self._sources.append(source)
        return self._of[source]

    def _fixed(self, body: int, local: np.ndarray) -> int:
        """A point of a body by its place (3) in the body's frame."""
        at = next((at for at, known in enumerate(self._locals) if np.array_equal(known, local)), len(self._locals))
        if at == len(self._locals):
            self._locals.append(np.array(local))
        return self._point("fixed", body, at)

    def _joint(self, joint: int) -> int:
        """A joint's point of its own body."""
        return self._fixed(int(self.model.jnt_bodyid[joint]), self.model.jnt_pos[joint])

    def _entered(self, body: int) -> int:
        """Where the parent carries a body: at its first joint, before a slide moves it, or the body itself."""
        joint = int(self.model.body_jntadr[body])
        if joint < 0:
            return self._point("body", body)
        return self._point("rail", joint) if rails_of(self.model, body) else self._joint(joint)

    def _add(self, body: int, ends: dict[tuple[int, int], int]) -> None:
        model = self.model
        own = [self._joint(joint) for joint in distinct_joints(model, body)]
        hub = own[0] if own else self._point("body", body)
        points = own[1:]
        children = [child for child in range(body + 1, model.nbody) if model.body_parentid[child] == body]
        points += [self._entered(child) for child in children]
        for one, end in ((one, end) for one in self._closing for end in (0, 1) if one.bodies[end] == body):
            drawn = drawn_end(model, one, end)
            points.append(ends[one.index, end] if drawn is None else self._fixed(body, drawn))
            if drawn is not None:
                self.air.append((points[-1], ends[one.index, end]))
        if not points:
            points.append(self._point("centre", body))
        if own:
            (self.grounded if stands(model, body) else self.joints).append(hub)
        self.rails += [(self._point("rail", joint), self._point("slid", joint)) for joint in rails_of(model, body)]
        name = plain(element_name(model, _BODY, body))
        self.bodies.append((name, [(hub, point) for point in dict.fromkeys(points) if point != hub]))

    @property
    def size(self) -> int:
        """How many points there are."""
        return len(self._sources)

    def read(self, qpos: np.ndarray, times: np.ndarray | None = None, driven: Drive | None = None) -> np.ndarray:
        """The points (P, 3) of poses (T, nq): (T, P, 3), world, m; mocap bodies as a drive has them at times (T), s."""
        model, data = self.model, self._data
        found = np.zeros((len(qpos), self.size, 3))
        for at in visited(model, data, qpos, times, driven):
            both = {index: anchors(model, data, one) for index, one in self._equalities.items()}
            for place, (kind, index, end) in enumerate(self._sources):
                if kind == "anchor":
                    found[at, place] = both[index][end]
                elif kind == "fixed":
                    found[at, place] = fixed_point(data, index, self._locals[end])
                elif kind == "rail":
                    found[at, place] = data.xanchor[index]
                elif kind == "slid":
                    slid = data.qpos[model.jnt_qposadr[index]] - model.qpos0[model.jnt_qposadr[index]]
                    found[at, place] = data.xanchor[index] + slid * data.xaxis[index]
                else:
                    found[at, place] = data.xpos[index] if kind == "body" else data.xipos[index]
        return found

    def gaps(self, points: np.ndarray) -> np.ndarray:
        """Of every loop, from its second to its first point, (T, loops, 3)."""
        first, second = ([pair[end] for pair in self.loops] for end in (0, 1))
        return points[:, first] - points[:, second]

    def exaggerated(self, points: np.ndarray, factor: float) -> np.ndarray:
        """Points (T, P, 3) with the gaps of the loops so many times as wide; a point of the world stays."""
        moved, gaps = points.copy(), self.gaps(points)
        for place, ((first, second), (still, other)) in enumerate(zip(self.loops, self.still, strict=True)):
            more = (factor - 1.0) * gaps[:, place]
            share = 0.0 if still else 1.0 if other else 0.5
            moved[:, first] += share * more
            moved[:, second] -= (1.0 - share) * more
        return moved


Solid = tuple[str, float, np.ndarray]
"""Colour, opacity and corners (n, 2) on the drawing of a part of a geom."""


@dataclass(frozen=True)
class Motion:
    """What the page draws and moves.

    Attributes:
        skeleton: lines between points.
        factor: by which gaps are exaggerated.
        gap: the largest one of the poses that are drawn, m.
        times: of the poses, s, (F).
        sides: title → coordinates (F or fewer, P, 2) on the drawing.
        height: of the drawing; its width is ``SIDE``.
        worst: pose with the largest gap.
        solids: title → the geoms of each pose on the drawing, back to front; empty where there are too many.
    """

    skeleton: Skeleton
    factor: float
    gap: float
    times: np.ndarray
    sides: dict[str, np.ndarray]
    height: int
    worst: int
    solids: dict[str, list[list[Solid]]]

    @property
    def caption(self) -> str:
        """What is to be seen, with the factor."""
        exact = " beside the exact solution" if len(self.sides) > 1 else ""
        if not self.skeleton.loops:
            return (
                f"MuJoCo{exact}. No loop of this model has two points that could gape; its couplings are dashed lines."
            )
        factor = figure(int(self.factor))
        times = "gaps as they are" if self.factor == 1.0 else f"the gaps of its loops exaggerated {factor} times"
        if self.skeleton.air:
            times += "; dotted in red where the anchor of an equality is not at its body, but in the air"
        return (
            f"MuJoCo{exact}, {times}: red lines join the two points of every connect and weld. The largest gap is "
            f"{figure(self.gap, 'm')}, at t = {self.times[self.worst]:.6g} s. Angles and couplings are not exaggerated."
        )

    def document(self) -> dict[str, Any]:
        """For the page's script."""
        bone = self.skeleton
        return {
            "size": [SIDE, self.height],
            "times": [float(f"{time:.6g}") for time in self.times],
            "worst": self.worst,
            "factor": self.factor,
            "faint": FAINT,
            "bodies": [
                {"name": name, "colour": PALETTE[at % len(PALETTE)], "lines": lines}
                for at, (name, lines) in enumerate(bone.bodies)
            ],
            "loops": bone.loops,
            "couplings": bone.couplings,
            "rails": bone.rails,
            "air": bone.air,
            "grounded": bone.grounded,
            "joints": bone.joints,
            "sides": [
                {
                    "title": title,
                    "frames": [points.ravel().tolist() for points in frames],
                    "solids": [
                        [[colour, opacity, *points.ravel().tolist()] for colour, opacity, points in frame]
                        for frame in self.solids.get(title, [])
                    ],
                }
                for title, frames in self.sides.items()
            ],
        }


def motion(exam: Examination) -> Motion | None:
    """The moving mechanism of an examination; None where there is no run to draw."""
    recording = exam.recording
    if recording is None or not recording.steps:
        return None
    skeleton = Skeleton(exam.model, recording.layout.equalities)
    finite = np.flatnonzero(np.isfinite(recording.qpos).all(axis=1))
    exact = exam.exact if exam.exact is not None and len(exam.exact.qpos) else None
    shapes, meshes = _drawn(exam.model)
    each = _numbers(shapes, meshes)
    if FEWEST * each > NUMBERS:
        shapes, each = [], 0
    count = int(min(FRAMES, max(FEWEST, NUMBERS / (4 * max(1, skeleton.size) + 2 * each))))
    spaced = finite[np.linspace(0, len(finite) - 1, min(count, len(finite))).astype(int)]
    chosen = np.unique([*spaced, widest(recording, finite)])
    driven = drive(exam.model, exam.laws)
    points = skeleton.read(recording.qpos[chosen], recording.time[chosen], driven)
    beside, known = points[:0], chosen[:0]
    if exact is not None:
        known = chosen[chosen < len(exact.qpos)]
        beside = skeleton.read(exact.qpos[known], exact.time[known], driven)
    ended = recording.end.how == "finished"
    everything = points if ended or not len(beside) else beside
    plane = drawing_plane(exam.pose.loops if exam.pose else None, everything)
    axes = np.array([*plane, np.cross(*plane)])
    placing = {"MuJoCo": body_poses(exam.model, recording.qpos[chosen], recording.time[chosen], driven)}
    if exact is not None and len(beside):
        placing["exact"] = body_poses(exam.model, exact.qpos[known], exact.time[known], driven)
    flats = {title: [outlines(shapes, meshes, one, axes) for one in poses] for title, poses in placing.items()}
    kept = flats["exact"] if len(beside) else flats["MuJoCo"]
    rims = [one.points for frame in kept for one in frame if one.body]
    flat = np.concatenate([(everything @ plane.T).reshape(-1, 2), *rims])
    low, high = (np.percentile(flat, q, axis=0) for q in ((0, 100) if ended or len(beside) else (2, 98)))
    span = float((high - low).max()) or 1.0
    wide = np.linalg.norm(skeleton.gaps(points), axis=2).max(axis=1, initial=0.0)
    factor = exaggeration(float(wide.max(initial=0.0)), VISIBLE * span)
    drawn = {"MuJoCo": skeleton.exaggerated(points, factor)}
    if len(beside):
        drawn["exact"] = beside
    margin = (VISIBLE + 0.04) * span
    low, high = low - margin, high + margin
    scale = SIDE / max(high[0] - low[0], 0.8 * (high[1] - low[1]))
    height = int(np.clip((high[1] - low[1]) * scale, 0.3 * SIDE, 1.25 * SIDE))
    middle = 0.5 * (low + high)

    def on_drawing(points: np.ndarray) -> np.ndarray:
        at = (points - middle) * scale * np.array([1.0, -1.0]) + 0.5 * np.array([SIDE, height])
        return np.rint(np.clip(at, -3 * SIDE, 4 * SIDE)).astype(int)

    return Motion(
        skeleton,
        factor,
        float(wide.max(initial=0.0)),
        recording.time[chosen],
        {title: on_drawing(points @ plane.T) for title, points in drawn.items()},
        height,
        int(wide.argmax()),
        {
            title: [[(one.colour, one.opacity, on_drawing(one.points)) for one in frame] for frame in frames]
            for title, frames in flats.items()
            if shapes
        },
    )


def _drawn(model: mujoco.MjModel) -> tuple[list[Shape], list[Mesh]]:
    """The geoms that are drawn; none where there are too many."""
    try:
        shapes, meshes = shapes_of(model)
    except InputError:
        return [], []
    return [shape for shape in shapes if shape.kind != "plane"], coarse(meshes)


def _numbers(shapes: list[Shape], meshes: list[Mesh]) -> int:
    """Numbers of a drawing of them, about."""
    each = {"mesh": 0, "box": 24, "cylinder": 3 * ROUND}
    triangles = sum(3 * len(meshes[shape.mesh][1]) for shape in shapes if shape.mesh >= 0)
    return triangles + sum(each.get(shape.kind, 2 * ROUND) for shape in shapes)


class Opened(Protocol):
    """A run as far as it tells how far its rows are open."""

    @property
    def layout(self) -> Layout:
        """The rows."""
        ...

    @property
    def position(self) -> np.ndarray:
        """Their deviations, (steps, rows), m or rad."""
        ...


def widest(run: Opened, finite: np.ndarray) -> int:
    """The step, one of some, at which a connect or weld is open furthest."""
    layout, position = run.layout, run.position
    wide = np.zeros(len(finite))
    for place, equality in enumerate(layout.equalities):
        if equality.kind.joins_points:
            start = layout.starts[place]
            wide = np.maximum(wide, np.nan_to_num(np.linalg.norm(position[finite, start : start + 3], axis=1)))
    return int(finite[wide.argmax()])


def exaggeration(gap: float, wanted: float) -> float:
    """1, 2 or 5 times a power of ten: the largest that draws a gap no wider than wanted, and at least 1."""
    if not gap > 0.0 or gap >= wanted:
        return 1.0
    most = min(wanted / gap, MOST)
    power = 10.0 ** math.floor(math.log10(most) + 1e-12)
    return float(round(max(step * power for step in (1, 2, 5) if step * power <= most * (1.0 + 1e-12))))


def drawing_plane(loops: Loops | None, points: np.ndarray) -> np.ndarray:
    """Right and up of the drawing in world axes (2, 3): the plane of the loops, or the usual view."""
    normals = [group.normal for group in loops.groups if group.dofs] if loops else []
    planar = [normal for normal in normals if normal is not None]
    if (
        planar
        and len(planar) == len(normals)
        and all(np.linalg.norm(np.cross(planar[0], one)) < 1e-4 for one in planar)
    ):
        return _facing(planar[0])
    extent = np.ptp(points.reshape(-1, 3), axis=0)
    flat = extent <= FLAT * extent.max()
    return np.eye(3)[~flat] if flat.sum() == 1 else VIEW


def _facing(normal: np.ndarray) -> np.ndarray:
    upward = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    up = upward - (upward @ normal) * normal
    up /= np.linalg.norm(up)
    right = np.cross(up, normal)
    return np.array([right if right[np.abs(right).argmax()] > 0 else -right, up])


# As a still.


def still(moving: Motion) -> str:
    """The worst moment as SVG, the sides beside one another."""
    gutter, label = 40, 50
    width = SIDE * len(moving.sides) + gutter * (len(moving.sides) - 1)
    parts = []
    for column, (title, frames) in enumerate(moving.sides.items()):
        at = min(moving.worst, len(frames) - 1)
        solids = moving.solids.get(title, [])
        content = _solid(solids[at]) if solids else ""
        content, left = content + _drawing(moving, frames[at]), column * (SIDE + gutter)
        words = html.escape(f"{title}, t = {moving.times[at]:.4g} s")
        parts.append(
            f'<svg x="{left}" y="{label}" width="{SIDE}" height="{moving.height}">{content}</svg>'
            f'<text x="{left + 10}" y="36" font-size="32">{words}</text>'
        )
    total = moving.height + label
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {total}" width="{width // 2}" '
        f'height="{total // 2}" font-family="sans-serif"><rect width="{width}" height="{total}" fill="#fff"/>'
        f"{''.join(parts)}</svg>\n"
    )


def _solid(parts: list[Solid]) -> str:
    paths = []
    for colour, opacity, points in parts:
        d = "M" + "L".join(f"{x} {y}" for x, y in points.tolist()) + "Z"
        paths.append(f'<path d="{d}" fill="{colour}" stroke="{colour}" opacity="{FAINT * opacity:.3g}"/>')
    return "".join(paths)


def _drawing(moving: Motion, points: np.ndarray) -> str:
    bone, parts = moving.skeleton, []

    def path(pairs: list[tuple[int, int]], style: str, name: str = "") -> None:
        d = "".join(f"M{points[a][0]} {points[a][1]}L{points[b][0]} {points[b][1]}" for a, b in pairs)
        title = f"<title>{html.escape(name)}</title>" if name else ""
        parts.append(f'<path d="{d}" fill="none" stroke-linecap="round" {style}>{title}</path>')

    path(bone.couplings, 'stroke="#999" stroke-width="3" stroke-dasharray="10 10"')
    path(bone.rails, f'stroke="{RAIL}" stroke-width="4"')
    path(bone.air, f'stroke="{GAP}" stroke-width="4" stroke-dasharray="4 9"')
    for at, (name, lines) in enumerate(bone.bodies):
        path(lines, f'stroke="{PALETTE[at % len(PALETTE)]}" stroke-width="12" opacity="0.85"', name)
    path(bone.loops, f'stroke="{GAP}" stroke-width="5"')
    for point in [*bone.joints, *bone.grounded]:
        x, y = points[point]
        mark = (
            f"M{x - 13} {y + 12}h26l-13 -24z"
            if point in bone.grounded
            else f"M{x - 8} {y}a8 8 0 1 0 16 0a8 8 0 1 0 -16 0z"
        )
        parts.append(f'<path d="{mark}" fill="#222"/>')
    for point, _ in bone.air:
        x, y = points[point]
        parts.append(f'<path d="M{x - 11} {y - 11}l22 22M{x - 11} {y + 11}l22 -22" stroke="{GAP}" stroke-width="5"/>')
    for point in (end for pair in bone.loops for end in pair):
        x, y = points[point]
        parts.append(f'<path d="M{x - 9} {y}l9 -9l9 9l-9 9z" fill="{MARK}"/>')
    return "".join(parts)
