"""The mechanism as points and lines, from its kinematics: what a drawing needs, without the model."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.shapes import coarse
from oarlock.mechanics.names import Equality, element_name, equalities
from oarlock.mechanics.outline import distinct_joints, drawn_end, fixed_point, rails_of, stands
from oarlock.mechanics.shapes import body_poses, shapes_of
from oarlock.tables.spool import Spool

TRACE_POINTS = 240


def traced(steps: Spool) -> np.ndarray:
    """Finite positions of a run, (steps, nq), at as many of its steps as a trace has points."""
    finite = np.concatenate([np.isfinite(path).all(axis=1) for path in _paths(steps)])
    wanted = _spread(np.flatnonzero(finite))
    found, begin = [], 0
    for path in _paths(steps):
        found.append(path[wanted[(wanted >= begin) & (wanted < begin + len(path))] - begin])
        begin += len(path)
    return np.concatenate(found)


def _paths(steps: Spool) -> Iterator[np.ndarray]:
    for chunk in steps.chunks(["qpos"]):
        width = chunk["qpos"].list.len()[0] if len(chunk) else 0
        yield chunk["qpos"].explode(empty_as_null=False).to_numpy().reshape(len(chunk), width)


def _spread(rows: np.ndarray) -> np.ndarray:
    """As many as a trace has points, equally spaced, the first and last included."""
    return rows[np.linspace(0, len(rows) - 1, min(TRACE_POINTS, len(rows))).astype(int)]


def sketch(model: mujoco.MjModel, start: np.ndarray, path: np.ndarray) -> dict[str, Any]:
    """Bodies at the start, the anchors of the equalities there, and the anchors' traces along a path (steps, nq).

    A body is drawn as a star: from its first joint to its other joints, its children's joints, the anchors on it and
    its centre of mass, all of which move with it; where an anchor is in the air, to its own end nearest to that. Points
    are world coordinates in m.
    """
    data = mujoco.MjData(model)
    ends = _ends(model)
    on_body: dict[int, list[_End]] = {}
    for end in ends:
        on_body.setdefault(end.body, []).append(end)

    def place(qpos: np.ndarray) -> None:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)

    place(start)
    bodies = []
    for body in range(1, model.nbody):
        own = [fixed_point(data, body, model.jnt_pos[joint]) for joint in distinct_joints(model, body)]
        points = own[1:]
        for child in np.flatnonzero(model.body_parentid == body).tolist():
            points += _entered(model, data, child)
        points += [
            end.point(model, data) if end.drawn is None else fixed_point(data, body, end.drawn)
            for end in on_body.get(body, ())
        ]
        points.append(data.xipos[body].copy())
        hub = own[0] if own else data.xpos[body].copy()
        bodies.append(
            {
                "name": element_name(model, mujoco.mjtObj.mjOBJ_BODY, body),
                "grounded": stands(model, body),
                "hub": hub.tolist(),
                "points": [point.tolist() for point in points if np.linalg.norm(point - hub) > 1e-9],
            }
        )
    anchors = [end.point(model, data).tolist() for end in ends]
    traces: list[list[list[float]]] = [[] for _ in anchors]
    for qpos in _spread(path[np.isfinite(path).all(axis=1)]):
        place(qpos)
        for trace, end in zip(traces, ends, strict=True):
            trace.append(end.point(model, data).tolist())
    return {
        "solids": _solids(model, start),
        "equalities": [equality.name for equality in equalities(model)],
        "bodies": bodies,
        "anchors": anchors,
        "traces": traces,
    }


def _solids(model: mujoco.MjModel, start: np.ndarray) -> dict[str, Any] | None:
    """The geoms at the start, with coarse meshes; None where there are too many to draw."""
    try:
        shapes, meshes = shapes_of(model)
    except InputError:
        return None
    return {
        "shapes": [asdict(shape) for shape in shapes if shape.kind != "plane"],
        "meshes": [[np.round(points, 6).tolist(), faces.tolist()] for points, faces in coarse(meshes)],
        "poses": body_poses(model, start[None])[0].tolist(),
    }


def _entered(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> list[np.ndarray]:
    """Where the parent carries a body: at its first joint, where a slide has not moved it yet."""
    joint = int(model.body_jntadr[body])
    if joint < 0:
        return []
    return [data.xanchor[joint].copy() if rails_of(model, body) else fixed_point(data, body, model.jnt_pos[joint])]


@dataclass(frozen=True)
class _End:
    """One end of an equality that joins points: its body, and what it is drawn to if it is in the air (see outline)."""

    equality: Equality
    end: int
    drawn: np.ndarray | None

    @property
    def body(self) -> int:
        return self.equality.bodies[self.end]

    def point(self, model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        """Where it is (3), world."""
        if self.equality.sites:
            return data.site_xpos[self.equality.sites[self.end]].copy()
        return fixed_point(data, self.body, self.equality.anchor(model, self.end))


def _ends(model: mujoco.MjModel) -> list[_End]:
    joining = [equality for equality in equalities(model) if equality.kind.joins_points]
    return [_End(one, end, drawn_end(model, one, end)) for one in joining for end in (0, 1)]
