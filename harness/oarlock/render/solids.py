"""Shapes as flat outlines, back to front: a parallel projection that needs no graphics card."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from oarlock.base.shapes import STICK, Mesh, Shape, rotated

ROUND = 24
"""Points of a circle."""

DARK = 0.5
"""Of its colour: what a face has that is seen edge on."""

_CIRCLE = np.stack([np.cos(angles := np.linspace(0.0, 2.0 * np.pi, ROUND, endpoint=False)), np.sin(angles)])


@dataclass(frozen=True)
class Outline:
    """One polygon of a drawing.

    Attributes:
        body: whose it is.
        points: (n, 2), right and up, m.
        depth: how near it is to whoever looks, m.
        fill: red, green and blue, from 0 to 1; opacity: from 0 to 1.
        floor: whether it is an endless plane, behind everything.
    """

    body: int
    points: np.ndarray
    depth: float
    fill: tuple[float, float, float]
    opacity: float
    floor: bool = False

    @property
    def colour(self) -> str:
        """Of the fill, as pages have it."""
        return "#" + "".join(f"{round(255 * min(max(part, 0.0), 1.0)):02x}" for part in self.fill)


def outlines(
    shapes: Sequence[Shape], meshes: Sequence[Mesh], poses: np.ndarray, axes: np.ndarray, wide: float = 0.0
) -> list[Outline]:
    """The outlines of shapes, those that are furthest away first.

    Shapes are sorted by their middles: where they pass through each other that is no more than an order.

    Args:
        shapes: on bodies.
        meshes: that they name.
        poses: of the bodies, (nbody, 7): place in the world, m, and quaternion.
        axes: right, up and towards whoever looks, (3, 3), world.
        wide: half the side of an endless plane, m; 0: it is not drawn.
    """
    found: list[tuple[bool, float, list[Outline]]] = []
    for shape in shapes:
        pose = poses[shape.body]
        middle = axes @ (pose[:3] + rotated(pose[3:], np.array(shape.pos)))
        turn = axes @ rotated(pose[3:], rotated(np.array(shape.quat), np.eye(3))).T
        floor = shape.kind == "plane"
        parts = [
            Outline(shape.body, points, depth, _shaded(shape, facing), shape.rgba[3], floor)
            for points, depth, facing in _parts(
                shape, meshes, middle, turn, wide, axes @ rotated(pose[3:], np.eye(3)).T
            )
        ]
        if parts:
            found.append((not floor, float(np.mean([part.depth for part in parts])), parts))
    found.sort(key=lambda one: one[:2])
    return [part for _, _, parts in found for part in parts]


def _shaded(shape: Shape, facing: float) -> tuple[float, float, float]:
    red, green, blue = (part * (DARK + (1.0 - DARK) * facing) for part in shape.rgba[:3])
    return red, green, blue


Part = tuple[np.ndarray, float, float]
"""Points (n, 2), depth, and how much of it faces whoever looks, from 0 to 1."""


def _parts(
    shape: Shape, meshes: Sequence[Mesh], middle: np.ndarray, turn: np.ndarray, wide: float, body: np.ndarray
) -> Iterator[Part]:
    """The outlines of a shape whose middle and axes, columns (3, 3), are given as they are looked at."""
    sizes = np.array([*shape.size, 0.0, 0.0])
    if shape.kind in ("sphere", "ellipsoid"):
        radii = sizes[:3] if shape.kind == "ellipsoid" else np.full(3, sizes[0])
        yield _ellipse(turn[:2] * radii) + middle[:2], middle[2], 0.85
    elif shape.kind == "capsule":
        along = sizes[1] * turn[:2, 2]
        ends = [sizes[0] * _CIRCLE.T + middle[:2] + sign * along for sign in (-1.0, 1.0)]
        yield hull(np.concatenate(ends)), middle[2], 0.85
    elif shape.kind == STICK:
        along = body[:2] @ (sizes[:3] - np.array(shape.pos))
        ends = [sizes[3] * _CIRCLE.T + middle[:2] + part * along for part in (0.0, 1.0)]
        yield hull(np.concatenate(ends)), middle[2], 0.85
    elif shape.kind == "cylinder":
        rim = (turn[:2, :2] @ (sizes[0] * _CIRCLE)).T
        along = sizes[1] * turn[:, 2] * (1.0 if turn[2, 2] >= 0.0 else -1.0)
        sides = np.concatenate([rim + middle[:2] - along[:2], rim + middle[:2] + along[:2]])
        yield hull(sides), middle[2], 0.8
        if abs(turn[2, 2]) > 1e-3:
            yield rim + middle[:2] + along[:2], middle[2], abs(turn[2, 2])
    elif shape.kind == "box":
        yield from _box(sizes[:3], middle, turn)
    elif shape.kind == "mesh":
        yield from _triangles(*meshes[shape.mesh], middle, turn)
    elif shape.kind == "plane" and wide > 0.0 and turn[2, 2] > 1e-3:
        half = [min(size, wide) if size > 0.0 else wide for size in sizes[:2]]
        corners = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]) * half
        yield corners @ turn[:2, :2].T + middle[:2], middle[2], turn[2, 2]


def _ellipse(axes: np.ndarray) -> np.ndarray:
    """The outline (n, 2) of an ellipsoid with half axes (2, 3), as columns, on the plane."""
    values, vectors = np.linalg.eigh(axes @ axes.T)
    return (vectors * np.sqrt(np.maximum(values, 0.0)) @ _CIRCLE).T


def _box(half: np.ndarray, middle: np.ndarray, turn: np.ndarray) -> Iterator[Part]:
    for axis in range(3):
        sign = 1.0 if turn[2, axis] > 0.0 else -1.0
        facing = abs(turn[2, axis])
        if facing > 1e-3:
            one, two = ((axis + 1) % 3, (axis + 2) % 3)
            first, second = turn[:, one] * half[one], turn[:, two] * half[two]
            corners = np.array([-first - second, first - second, first + second, second - first])
            yield (corners + sign * half[axis] * turn[:, axis] + middle)[:, :2], middle[2], facing


def _triangles(vertices: np.ndarray, faces: np.ndarray, middle: np.ndarray, turn: np.ndarray) -> Iterator[Part]:
    placed = vertices @ turn.T + middle
    corners = placed[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes = np.linalg.norm(normals, axis=1)
    seen = np.flatnonzero(normals[:, 2] > 1e-3 * sizes)
    depths = corners[seen, :, 2].mean(axis=1)
    for at in np.argsort(depths):
        face = seen[at]
        yield corners[face, :, :2], float(depths[at]), float(normals[face, 2] / sizes[face])


def hull(points: np.ndarray) -> np.ndarray:
    """The convex hull (m, 2) of points (n, 2), counterclockwise; of points on a line its two ends."""
    order = np.unique(points, axis=0).tolist()

    def chain(row: list[list[float]]) -> list[list[float]]:
        kept: list[list[float]] = []
        for x, y in row:
            while len(kept) > 1:
                (ax, ay), (bx, by) = kept[-2:]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0:
                    break
                kept.pop()
            kept.append([x, y])
        return kept

    lower, upper = chain(order), chain(order[::-1])
    return np.array([*lower[:-1], *upper[:-1]] or order)
