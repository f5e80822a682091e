"""What a model looks like: its geoms as shapes on bodies, and each mesh once."""

from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.shapes import Mesh, Shape
from oarlock.mechanics.drive import Drive

MOST_GEOMS = 4000
"""Geoms of a model that is drawn."""

SHOWN_GROUPS = 3
"""Geoms of the groups below are shown, as in MuJoCo's own viewer; of a body that has none of these, all."""

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


def shapes_of(model: mujoco.MjModel) -> tuple[list[Shape], list[Mesh]]:
    """The geoms that are drawn, and their meshes as they are.

    Raises:
        InputError: more geoms than a page can draw.
    """
    geoms = _shown(model)
    if len(geoms) > MOST_GEOMS:
        raise InputError(f"{len(geoms)} geoms to draw, expected at most {MOST_GEOMS}")
    meshes: list[Mesh] = []
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
            Shape(
                int(model.geom_bodyid[geom]),
                kind,
                geom,
                short(pos),
                short(quat),
                short(size),
                _rgba(model, geom),
                place,
            )
        )
    return shapes, meshes


def body_poses(
    model: mujoco.MjModel, qpos: np.ndarray, times: np.ndarray | None = None, driven: Drive | None = None
) -> np.ndarray:
    """Poses of all bodies, (n, nbody, 7): place in the world, m, and quaternion.

    Args:
        model: whose they are.
        qpos: of the model, (n, nq).
        times: of them, (n), s.
        driven: what moves mocap bodies; nothing if left out.
    """
    data = mujoco.MjData(model)
    found = np.zeros((len(qpos), model.nbody, 7))
    for at in visited(model, data, qpos, times, driven):
        found[at, :, :3], found[at, :, 3:] = data.xpos, data.xquat
    return found


def visited(
    model: mujoco.MjModel, data: mujoco.MjData, qpos: np.ndarray, times: np.ndarray | None, driven: Drive | None
) -> Iterator[int]:
    """Goes through poses (n, nq); at each number that it gives, the places of all bodies are valid in a data.

    Mocap bodies are where a drive has them at times (n), s.
    """
    for at, pose in enumerate(qpos):
        data.qpos[:] = pose
        if driven is not None and times is not None:
            data.time = times[at]
            driven.move(data)
        mujoco.mj_kinematics(model, data)
        yield at


def short(values: np.ndarray) -> tuple[float, ...]:
    """Numbers with the digits that are drawn."""
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
    return short(model.mat_rgba[material] if material >= 0 and np.allclose(own, PLAIN) else own)


def _source(model: mujoco.MjModel, geom: int) -> tuple[str, int]:
    field = model.geom_type[geom] == _G.mjGEOM_HFIELD
    return ("hfield" if field else "mesh"), int(model.geom_dataid[geom])


def _mesh(model: mujoco.MjModel, kind: str, index: int) -> Mesh:
    if kind == "hfield":
        return _field(model, index)
    first, count = model.mesh_vertadr[index], model.mesh_vertnum[index]
    face, faces = model.mesh_faceadr[index], model.mesh_facenum[index]
    return model.mesh_vert[first : first + count].astype(float), model.mesh_face[face : face + faces].astype(int)


def _field(model: mujoco.MjModel, index: int) -> Mesh:
    rows, columns, start = (int(of[index]) for of in (model.hfield_nrow, model.hfield_ncol, model.hfield_adr))
    half_x, half_y, high, _ = model.hfield_size[index]
    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    heights = high * model.hfield_data[start : start + rows * columns].reshape(rows, columns)
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1].ravel(), number[:-1, 1:].ravel(), number[1:, 1:].ravel(), number[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.stack([x, y, heights], axis=2).reshape(-1, 3), faces
