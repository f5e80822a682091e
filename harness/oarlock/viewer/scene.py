"""What a model looks like: its geoms as shapes on bodies, and each mesh once, coarser where it has too many triangles.

A body of which nothing is to be seen is a star of sticks, as in ``diagnosis.page.motion``.
"""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.text import one_line
from oarlock.diagnosis.page.motion import Skeleton
from oarlock.mechanics.names import element_name
from oarlock.viewer.packing import packed

TRIANGLES = 120_000
"""Of all meshes of a page together; those of a model with more are made coarser."""

FEWEST = 200
"""Triangles that a mesh may keep however many others there are."""

MOST_GEOMS = 4000
"""Geoms of a model that is drawn."""

SHOWN_GROUPS = 3
"""Geoms of the groups below are shown, as in MuJoCo's own viewer; of a body that has none of these, all."""

STICK = 0.008
"""Radius of a stick, of the extent."""

PLAIN = (0.5, 0.5, 0.5, 1.0)
"""The colour of a geom that was given none: then that of its material counts."""

INVISIBLE = 0.02
"""Nothing with a smaller alpha is drawn."""

_G = mujoco.mjtGeom
_SHAPES = {
    _G.mjGEOM_PLANE: "plane",
    _G.mjGEOM_HFIELD: "mesh",
    _G.mjGEOM_SPHERE: "sphere",
    _G.mjGEOM_CAPSULE: "capsule",
    _G.mjGEOM_ELLIPSOID: "ellipsoid",
    _G.mjGEOM_CYLINDER: "cylinder",
    _G.mjGEOM_BOX: "box",
    _G.mjGEOM_MESH: "mesh",
    _G.mjGEOM_SDF: "mesh",
}
_IDENTITY = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Shape:
    """One thing that is fixed to a body: ``pos`` and ``quat`` in the body's frame, m; ``size`` as MuJoCo has it.

    Attributes:
        kind: ``box``, ``capsule``, ``cylinder``, ``ellipsoid``, ``mesh``, ``plane``, ``sphere`` or ``stick``, from
            ``pos`` to ``size``.
        geom: its number; -1 of a stick.
        mesh: place among the meshes; -1: it has none.
    """

    body: int
    kind: str
    geom: int
    pos: tuple[float, ...]
    quat: tuple[float, ...]
    size: tuple[float, ...]
    rgba: tuple[float, ...]
    mesh: int = -1


@dataclass(frozen=True)
class Scene:
    """All that is drawn of a model.

    Attributes:
        names: of the bodies, the world's first.
        meshes: vertices (V, 3) in the frame of a geom, m, and faces (F, 3).
        notes: what is not drawn as it is, in words.
    """

    names: list[str]
    shapes: list[Shape]
    meshes: list[tuple[np.ndarray, np.ndarray]]
    notes: list[str]

    def document(self) -> dict[str, Any]:
        """For the page's script."""
        return {
            "names": self.names,
            "shapes": [
                {
                    "body": one.body,
                    "kind": one.kind,
                    "pos": one.pos,
                    "quat": one.quat,
                    "size": one.size,
                    "rgba": one.rgba,
                    "mesh": one.mesh,
                }
                for one in self.shapes
            ],
            "meshes": [
                {"vertices": packed(vertices), "faces": packed(faces, "<u4")} for vertices, faces in self.meshes
            ],
        }


def scene(model: mujoco.MjModel, skeleton: Skeleton, points: np.ndarray, poses: np.ndarray, extent: float) -> Scene:
    """What is drawn of a model.

    Args:
        model: any.
        skeleton: its lines, for bodies of which nothing else is to be seen.
        points: of the skeleton at one pose (P, 3), world, m.
        poses: of all bodies at the same, (nbody, 7).
        extent: of what is drawn, m.

    Raises:
        InputError: more geoms than a page can draw.
    """
    geoms = _shown(model)
    if len(geoms) > MOST_GEOMS:
        raise InputError(f"{len(geoms)} geoms to draw, expected at most {MOST_GEOMS}")
    meshes: list[tuple[np.ndarray, np.ndarray]] = []
    places: dict[tuple[str, int], int] = {}
    shapes = []
    for geom in geoms:
        kind = _SHAPES[mujoco.mjtGeom(model.geom_type[geom])]
        place = -1
        if kind == "mesh":
            source = _source(model, geom)
            place = places.setdefault(source, len(meshes))
            if place == len(meshes):
                meshes.append(_mesh(model, *source))
        pos, quat, size = model.geom_pos[geom], model.geom_quat[geom], model.geom_size[geom]
        shapes.append(
            Shape(int(model.geom_bodyid[geom]), kind, geom, _t(pos), _t(quat), _t(size), _rgba(model, geom), place)
        )
    seen = {shape.body for shape in shapes}
    for body, (_, lines) in enumerate(skeleton.bodies, start=1):
        if body not in seen:
            shapes += _sticks(body, [(points[a], points[b]) for a, b in lines], poses[body], STICK * extent)
    notes = _coarser(meshes)
    if model.nflex:
        notes.append("flexes are not drawn")
    names = [one_line(element_name(model, mujoco.mjtObj.mjOBJ_BODY, body)) for body in range(model.nbody)]
    return Scene(names, shapes, meshes, notes)


def _t(values: np.ndarray) -> tuple[float, ...]:
    return tuple(float(f"{value:.9g}") for value in values)


def _shown(model: mujoco.MjModel) -> list[int]:
    """The geoms that are drawn."""
    drawn = [
        geom
        for geom in range(model.ngeom)
        if mujoco.mjtGeom(model.geom_type[geom]) in _SHAPES and _rgba(model, geom)[3] > INVISIBLE
    ]
    usual = [geom for geom in drawn if model.geom_group[geom] < SHOWN_GROUPS]
    bodies = {int(model.geom_bodyid[geom]) for geom in usual}
    return sorted({*usual, *(geom for geom in drawn if int(model.geom_bodyid[geom]) not in bodies)})


def _rgba(model: mujoco.MjModel, geom: int) -> tuple[float, ...]:
    own, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    return _t(model.mat_rgba[material] if material >= 0 and np.allclose(own, PLAIN) else own)


def _sticks(body: int, lines: list[tuple[np.ndarray, np.ndarray]], pose: np.ndarray, radius: float) -> list[Shape]:
    """The lines (world, m) of a body's star, in its own frame."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, pose[3:])
    own = [[turn.reshape(3, 3).T @ (point - pose[:3]) for point in line] for line in lines]
    return [Shape(body, "stick", -1, _t(a), _IDENTITY, (*_t(b), radius), (0.45, 0.5, 0.58, 1.0)) for a, b in own]


def _source(model: mujoco.MjModel, geom: int) -> tuple[str, int]:
    field = model.geom_type[geom] == _G.mjGEOM_HFIELD
    return ("hfield" if field else "mesh"), int(model.geom_dataid[geom])


def _mesh(model: mujoco.MjModel, kind: str, index: int) -> tuple[np.ndarray, np.ndarray]:
    if kind == "hfield":
        return _field(model, index)
    first, count = model.mesh_vertadr[index], model.mesh_vertnum[index]
    face, faces = model.mesh_faceadr[index], model.mesh_facenum[index]
    return model.mesh_vert[first : first + count].astype(float), model.mesh_face[face : face + faces].astype(int)


def _field(model: mujoco.MjModel, index: int) -> tuple[np.ndarray, np.ndarray]:
    rows, columns, start = (int(of[index]) for of in (model.hfield_nrow, model.hfield_ncol, model.hfield_adr))
    half_x, half_y, high, _ = model.hfield_size[index]
    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    heights = high * model.hfield_data[start : start + rows * columns].reshape(rows, columns)
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1].ravel(), number[:-1, 1:].ravel(), number[1:, 1:].ravel(), number[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.stack([x, y, heights], axis=2).reshape(-1, 3), faces


def _coarser(meshes: list[tuple[np.ndarray, np.ndarray]]) -> list[str]:
    """Makes meshes coarser where all of them have too many triangles together; says so."""
    total = sum(len(faces) for _, faces in meshes)
    if total <= TRIANGLES:
        return []
    for place, (vertices, faces) in enumerate(meshes):
        meshes[place] = thinned(vertices, faces, max(FEWEST, TRIANGLES * len(faces) // total))
    left = sum(len(faces) for _, faces in meshes)
    return [f"meshes are drawn coarser, with {left:,} triangles in place of {total:,}".replace(",", " ")]


def thinned(vertices: np.ndarray, faces: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """A mesh with at most so many triangles: vertices of one cell of a grid become one, in their middle."""
    low, size = vertices.min(axis=0, initial=np.inf), float(np.ptp(vertices, axis=0).max()) or 1.0
    cells = max(2.0, np.sqrt(most))
    while len(faces) > most:
        keys = np.floor((vertices - low) / size * cells).astype(np.int64)
        _, owner = np.unique(keys, axis=0, return_inverse=True)
        owner = owner.ravel()
        count = int(owner.max()) + 1
        middles = np.stack([np.bincount(owner, column, count) for column in vertices.T], axis=1)
        middles /= np.bincount(owner, minlength=count)[:, None]
        kept = owner[faces]
        kept = kept[(kept[:, 0] != kept[:, 1]) & (kept[:, 1] != kept[:, 2]) & (kept[:, 2] != kept[:, 0])]
        if len(kept) <= most or cells < 2.0:
            return middles, kept[: max(most, 0)]
        cells *= 0.8
    return vertices, faces
