"""S5: a connect whose second anchor stands in the air, beside a link that is drawn to end elsewhere.

MuJoCo is told the anchor in the first body's frame, and takes the second body's where that is in the model's own pose:
a gap that is drawn there is kept for good, as a lever that nobody sees. An anchor in the air alone is no mistake (a
body without geoms, a disc that stands for a platform). With a link beside it that is drawn to an end at which nothing
is held it is: the link was meant to be held there. Unless the end lies on the line of the pin: along the axis of a
hinge an anchor may stand anywhere, beside its link too, and two connects of the same bodies are the ends of a pin.

An anchor that was written in another frame, the world's or the second body's, says where it was meant: read so, it is a
place at which both bodies are.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import Remark, View, point, told
from oarlock.mechanics.names import Equality
from oarlock.poses.assembly import anchors

AIR = 0.05
"""Of the length of a body: its anchor is in the air where the nearest geom is further away than that, and than the body
is thick."""

MEETS = 0.01
"""Of the size of the mechanism: so near two bodies are at a place."""

LONG = 3.0
"""Times its other two: a box or ellipsoid that is so long is a link with two ends."""

PLACES = 81
"""Of a pin, at which it is looked for what is drawn."""

ROUNDED = 5e-7
"""m: less is written as 0."""

_GEOM = mujoco.mjtGeom
_ROUND = (int(_GEOM.mjGEOM_CAPSULE), int(_GEOM.mjGEOM_CYLINDER))
_DRAWN = (*_ROUND, int(_GEOM.mjGEOM_SPHERE), int(_GEOM.mjGEOM_BOX), int(_GEOM.mjGEOM_ELLIPSOID))
"""What has a shape of a few numbers: a body with a mesh, a plane or a height field is not judged."""


@dataclass(frozen=True)
class Drawing:
    """A body as it is drawn, in the model's own pose, world axes.

    Attributes:
        ends: of its links (n, 3), m.
        held: where joints and equalities hold it (k, 3), m.
        thickness, length: m.
    """

    ends: np.ndarray
    held: np.ndarray
    thickness: float
    length: float

    def loose_end(self, anchor: np.ndarray) -> np.ndarray | None:
        """The end (3) nearest to an anchor at which nothing holds the body; None where it is held nearer than that."""
        free = [end for end in self.ends if np.linalg.norm(self.held - end, axis=1).min() > self.thickness]
        nearest = min(free, key=lambda end: float(np.linalg.norm(end - anchor)), default=None)
        if nearest is None or np.linalg.norm(self.held - anchor, axis=1).min() < np.linalg.norm(nearest - anchor):
            return None  # the lever of a foot, say, beside the knee
        return nearest


def look(view: View) -> Iterator[Remark]:
    """A remark a connect."""
    connects = [one for one in view.equalities if one.kind.joins_points and not one.kind.turns and one.sites is None]
    if not connects:
        return
    model, data = view.model, mujoco.MjData(view.model)
    mujoco.mj_kinematics(model, data)
    for one in connects:
        if (meant := _in_another_frame(view, data, one)) is not None:
            yield meant
            continue
        places = anchors(model, data, one)
        if np.linalg.norm(places[0] - places[1]) > AIR * view.size:
            continue  # both were given, and the start tells how far apart they are
        for end, body in enumerate(one.bodies):
            geoms = view.geoms_of(body)
            if body == 0 or not len(geoms) or not np.isin(model.geom_type[geoms], _DRAWN).all():
                continue
            drawing = _drawing(view, data, one, body, geoms)
            along = _pins(view, data, one, end)
            away = min(
                _distance(model, data, geom, place) for geom in geoms for place in _line(places[end], along, view.size)
            )
            loose = drawing.loose_end(places[end])
            if loose is None or away <= max(AIR * drawing.length, drawing.thickness):
                continue
            if any(np.linalg.norm(np.cross(each, loose - places[end])) <= drawing.thickness for each in along):
                continue
            yield _remark(view, data, one, end, loose, float(np.linalg.norm(loose - places[end])))
            break


def _in_another_frame(view: View, data: mujoco.MjData, one: Equality) -> Remark | None:
    """Of an anchor that in the frame of the first body is in the air, and in another one where both bodies are."""
    model, (first, second) = view.model, one.bodies
    given = one.anchor(model, 0)
    here = data.xpos[first] + data.xmat[first].reshape(3, 3) @ given
    frames = {
        "the world": given,
        quoted(view.body(second)): data.xpos[second] + data.xmat[second].reshape(3, 3) @ given,
    }
    near = MEETS * view.size
    off = max(_away(view, data, body, here) for body in one.bodies)
    if first == 0 or off <= max(AIR * view.size, 3.0 * near):
        return None
    for frame, place in frames.items():
        if max(_away(view, data, body, place) for body in one.bodies) > near:
            continue
        wanted = data.xmat[first].reshape(3, 3).T @ (place - data.xpos[first])
        gap = float(np.linalg.norm(place - here))
        bodies = " and ".join(quoted(view.body(body)) for body in one.bodies)
        said = (
            f"its anchor {point(given)} is in the frame of {quoted(view.body(first))}, and pins {bodies} {told(gap)} m "
            f"away from where they meet, at a point in the air; read in the frame of {frame} it is that place: "
            f"write anchor={_written(wanted)}"
        )
        return Remark("S5", said, one.name, figures={"gap": gap, "wanted": wanted.tolist()})
    return None


def _away(view: View, data: mujoco.MjData, body: int, place: np.ndarray) -> float:
    """From a point (3) to what is drawn of a body, or is a place of it: a site, a joint, a body that it holds."""
    model = view.model
    if body == 0:
        return 0.0
    weld = model.body_weldid[body]
    own = np.flatnonzero(model.body_weldid[model.site_bodyid] == weld)
    children = np.flatnonzero((model.body_weldid[model.body_parentid] == weld) & (model.body_weldid != weld))
    joints = np.flatnonzero(np.isin(model.body_weldid[model.jnt_bodyid], [weld, *model.body_weldid[children]]))
    turning = joints[model.jnt_type[joints] != mujoco.mjtJoint.mjJNT_FREE]
    points = [data.xpos[body], *data.site_xpos[own], *data.xpos[children], *data.xanchor[turning]]
    geoms = [geom for geom in view.geoms_of(body) if model.geom_type[geom] in _DRAWN]
    found = [float(np.linalg.norm(one - place)) for one in points]
    return min([*found, *(_distance(model, data, int(geom), place) for geom in geoms)])


def _pins(view: View, data: mujoco.MjData, one: Equality, end: int) -> list[np.ndarray]:
    """The directions (3) of the pins that an anchor may be on: of hinges of its bodies, and of pairs of connects."""
    model = view.model
    place = anchors(model, data, one)[end]
    welded = model.body_weldid[list(one.bodies)]
    hinges = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & np.isin(model.body_weldid[model.jnt_bodyid], welded)
    twins = [
        anchors(model, data, other)[other.bodies.index(one.bodies[end])] - place
        for other in view.equalities
        if other is not one and other.kind.joins_points and sorted(other.bodies) == sorted(one.bodies)
    ]
    every = [(along, float(np.linalg.norm(along))) for along in [*data.xaxis[hinges], *twins]]
    return [along / length for along, length in every if length > 0.0]


def _line(place: np.ndarray, along: list[np.ndarray], size: float) -> list[np.ndarray]:
    """Points (3) of a pin: beside the link that it goes through an anchor may stand anywhere along it."""
    return [place, *(place + at * each for each in along for at in np.linspace(-size, size, PLACES))]


def _remark(view: View, data: mujoco.MjData, one: Equality, end: int, loose: np.ndarray, gap: float) -> Remark:
    names = [view.body(body) for body in one.bodies]
    local = [one.anchor(view.model, side) for side in (0, 1)]
    body = one.bodies[end]
    tip = data.xmat[body].reshape(3, 3).T @ (loose - data.xpos[body])
    held = " and ".join(f"{point(place)} of '{name}'" for place, name in zip(local, names, strict=True))
    sites = [tip if side == end else place for side, place in enumerate(local)]
    said = (
        f"'{names[0]}' and '{names[1]}' are drawn {told(gap)} m apart in the model's own pose: it joins {held}, but "
        f"'{names[end]}' is drawn to end at {point(tip)}, and MuJoCo keeps that gap as it is drawn; "
        f"{_by_sites(view, one, sites)}"
    )
    figures = {
        "gap": gap,
        "anchors": [place.tolist() for place in local],
        "end": tip.tolist(),
        "sites": [place.tolist() for place in sites],
    }
    return Remark("S5", said, one.name, figures=figures)


def _by_sites(view: View, one: Equality, sites: list[np.ndarray]) -> str:
    """What joins both links where they are drawn to end, and how far apart that leaves them at the start."""
    data, drawn = view.data, mujoco.MjData(view.model)
    mujoco.mj_kinematics(view.model, drawn)
    names = [view.body(body) for body in one.bodies]
    where = " and ".join(f"pos={_written(place)} of '{name}'" for place, name in zip(sites, names, strict=True))
    said = f'join two sites there, <connect site1="…" site2="…"/> with {where}'
    away, elsewhere = (_between(one, sites, each) for each in (data, drawn))
    if away <= MEETS * view.size < elsewhere:
        return f"{said}, which meet at the start to {told(away)} m; or turn the links so that they are drawn together"
    return f"{said}; or turn the links so that they are drawn together"


def _written(place: np.ndarray) -> str:
    return f'"{" ".join(f"{0.0 if abs(value) < ROUNDED else value:.6g}" for value in place.tolist())}"'


def _between(one: Equality, sites: list[np.ndarray], data: mujoco.MjData) -> float:
    """Between a point (3) of each of two bodies, m."""
    first, second = (
        data.xpos[body] + data.xmat[body].reshape(3, 3) @ place for body, place in zip(one.bodies, sites, strict=True)
    )
    return float(np.linalg.norm(first - second))


def _drawing(view: View, data: mujoco.MjData, one: Equality, body: int, geoms: np.ndarray) -> Drawing:
    model = view.model
    weld = model.body_weldid[body]
    children = np.flatnonzero(model.body_weldid[model.body_parentid] == weld)
    children = children[children > 0]
    own = np.flatnonzero(model.body_weldid[model.jnt_bodyid] == weld)
    theirs = np.flatnonzero(np.isin(model.jnt_bodyid, children))
    others = [
        anchors(model, data, other)[side]
        for other in view.equalities
        if other.kind.joins_points
        for side, at in enumerate(other.bodies)
        if other is not one and model.body_weldid[at] == weld
    ]
    held = [*data.xanchor[own], *data.xanchor[theirs], *others, *(data.xpos[child] for child in children)]
    ends = [end for geom in geoms for end in _ends(model, data, int(geom))]
    places = np.array(held or [data.xpos[body]]).reshape(-1, 3)
    every = np.vstack([places, *(np.reshape(ends, (-1, 3)),), data.geom_xpos[geoms]])
    length = float(np.linalg.norm(every.max(axis=0) - every.min(axis=0)))
    thickness = float(max(_half_sizes(model, int(geom)).min() for geom in geoms))
    return Drawing(np.reshape(ends, (-1, 3)), places, thickness, length)


def _half_sizes(model: mujoco.MjModel, geom: int) -> np.ndarray:
    return model.geom_aabb[geom, 3:6]


def _ends(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> list[np.ndarray]:
    """The two ends (3) of a geom that is a link; of a capsule, the middles of its caps."""
    kind, frame = int(model.geom_type[geom]), data.geom_xmat[geom].reshape(3, 3)
    if kind in _ROUND:
        axis, half = 2, float(model.geom_size[geom, 1])
        if half < (LONG - 1.0) * model.geom_size[geom, 0]:
            return []
    else:
        sizes = _half_sizes(model, geom)
        axis = int(sizes.argmax())
        half = float(sizes[axis])
        if half < LONG * float(np.sort(sizes)[1]):
            return []
    return [data.geom_xpos[geom] + sign * half * frame[:, axis] for sign in (-1.0, 1.0)]


def _distance(model: mujoco.MjModel, data: mujoco.MjData, geom: int, place: np.ndarray) -> float:
    """From a point (3) to a geom, m; 0 within it. An ellipsoid is taken as its box."""
    local = data.geom_xmat[geom].reshape(3, 3).T @ (place - data.geom_xpos[geom])
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == _GEOM.mjGEOM_SPHERE:
        return max(0.0, float(np.linalg.norm(local)) - float(size[0]))
    if kind == _GEOM.mjGEOM_CAPSULE:
        local[2] -= np.clip(local[2], -size[1], size[1])
        return max(0.0, float(np.linalg.norm(local)) - float(size[0]))
    if kind == _GEOM.mjGEOM_CYLINDER:
        beyond = np.maximum([np.hypot(local[0], local[1]) - size[0], abs(local[2]) - size[1]], 0.0)
        return float(np.linalg.norm(beyond))
    return float(np.linalg.norm(np.maximum(np.abs(local) - size, 0.0)))
