"""What a model looks like: its geoms as shapes on bodies, and each mesh once, coarser where it has too many triangles.

A body of which nothing is to be seen is a star of sticks, as in ``diagnosis.page.motion``.
"""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from oarlock.base.shapes import STICK, Mesh, Shape, thinned
from oarlock.base.text import one_line
from oarlock.diagnosis.page.motion import Skeleton
from oarlock.mechanics.names import element_name
from oarlock.mechanics.shapes import shapes_of, short
from oarlock.viewer.packing import packed

TRIANGLES = 120_000
"""Of all meshes of a page together; those of a model with more are made coarser."""

FEWEST = 200
"""Triangles that a mesh may keep however many others there are."""

THICK = 0.008
"""Radius of a stick, of the extent."""

_IDENTITY = (1.0, 0.0, 0.0, 0.0)


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
    meshes: list[Mesh]
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
    shapes, meshes = shapes_of(model)
    seen = {shape.body for shape in shapes}
    for body, (_, lines) in enumerate(skeleton.bodies, start=1):
        if body not in seen:
            shapes += _sticks(body, [(points[a], points[b]) for a, b in lines], poses[body], THICK * extent)
    notes = _coarser(meshes)
    if model.nflex:
        notes.append("flexes are not drawn")
    names = [one_line(element_name(model, mujoco.mjtObj.mjOBJ_BODY, body)) for body in range(model.nbody)]
    return Scene(names, shapes, meshes, notes)


def _sticks(body: int, lines: list[tuple[np.ndarray, np.ndarray]], pose: np.ndarray, radius: float) -> list[Shape]:
    """The lines (world, m) of a body's star, in its own frame."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, pose[3:])
    own = [[turn.reshape(3, 3).T @ (point - pose[:3]) for point in line] for line in lines]
    return [Shape(body, STICK, -1, short(a), _IDENTITY, (*short(b), radius), (0.45, 0.5, 0.58, 1.0)) for a, b in own]


def _coarser(meshes: list[Mesh]) -> list[str]:
    """Makes meshes coarser where all of them have too many triangles together; says so."""
    total = sum(len(faces) for _, faces in meshes)
    if total <= TRIANGLES:
        return []
    for place, (vertices, faces) in enumerate(meshes):
        meshes[place] = thinned(vertices, faces, max(FEWEST, TRIANGLES * len(faces) // total))
    left = sum(len(faces) for _, faces in meshes)
    return [f"meshes are drawn coarser, with {left:,} triangles in place of {total:,}".replace(",", " ")]
