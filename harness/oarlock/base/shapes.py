"""Simple solids on bodies, as models are drawn with them, and where turns take them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

STICK = "stick"
"""Kind of what is drawn of a body of which nothing else is to be seen: a line from ``pos`` to ``size``."""

TRIANGLES = 600
"""Of the meshes of a drawing together; those with more are made coarser."""

FEWEST = 60
"""Triangles that a mesh may keep however many others there are."""


@dataclass(frozen=True)
class Shape:
    """One thing that is fixed to a body: ``pos`` and ``quat`` in the body's frame, m; ``size`` as MuJoCo has it.

    Attributes:
        kind: ``box``, ``capsule``, ``cylinder``, ``ellipsoid``, ``mesh``, ``plane``, ``sphere`` or ``stick``, from
            ``pos`` to the first three of ``size``, of the radius that is the fourth.
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


Mesh = tuple[np.ndarray, np.ndarray]
"""Vertices (V, 3) in the frame of a shape, m, and faces (F, 3), counterclockwise from outside."""


def rotated(quats: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (…, 3) turned by unit quaternions (…, 4)."""
    w, axis = quats[..., :1], quats[..., 1:]
    twice = 2.0 * np.cross(axis, vectors)
    return vectors + w * twice + np.cross(axis, twice)


def thinned(vertices: np.ndarray, faces: np.ndarray, most: int) -> Mesh:
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


def coarse(meshes: Sequence[Mesh], most: int = TRIANGLES) -> list[Mesh]:
    """Meshes with at most so many triangles together, or as few as can be."""
    total = sum(len(faces) for _, faces in meshes)
    if total <= most:
        return list(meshes)
    return [thinned(vertices, faces, max(FEWEST, most * len(faces) // total)) for vertices, faces in meshes]
