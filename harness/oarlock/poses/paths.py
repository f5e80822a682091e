"""The paths through the kinematic tree that equalities close to loops: which joints they pass, and in what plane."""

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from oarlock.base.vectors import crossed
from oarlock.mechanics.coupled import coupled, coupled_ids
from oarlock.mechanics.names import Equality

PARALLEL = 1e-5
"""rad. Two axes that differ by less are meant to be parallel: six digits of a quaternion are 1e-6."""

Shape = Literal["planar", "spatial", "coupling"]

_BALL, _FREE = int(mujoco.mjtJoint.mjJNT_BALL), int(mujoco.mjtJoint.mjJNT_FREE)
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True)
class Path:
    """The part of the kinematic tree that an equality closes to a loop.

    Attributes:
        joints: on the way from one end to the other; of a coupling, those that it couples.
        dofs: theirs.
        shape: ``planar``: hinges parallel, slides across them; ``spatial``; ``coupling``: of joints or tendons.
        normal: of the plane, world axes (3); None where there is none.
    """

    joints: tuple[int, ...]
    dofs: tuple[int, ...]
    shape: Shape
    normal: np.ndarray | None


def path_of(model: mujoco.MjModel, data: mujoco.MjData, equality: Equality) -> Path:
    """The joints that an equality closes to a loop; axes are those of the present pose."""
    if not equality.kind.joins_points:
        dofs = coupled(equality.kind).dofs(model, coupled_ids(model, equality.index))
        joints = dict.fromkeys(int(model.dof_jntid[dof]) for dof in dofs)
        return Path(tuple(joints), tuple(dofs), "coupling", None)
    above = [_to_world(model, body) for body in equality.bodies]
    bodies = sorted(set(above[0]) ^ set(above[1]))
    starts, counts = model.body_jntadr, model.body_jntnum
    joints = [joint for body in bodies for joint in range(starts[body], starts[body] + counts[body])]
    dofs = [
        dof
        for body in bodies
        for dof in range(model.body_dofadr[body], model.body_dofadr[body] + model.body_dofnum[body])
    ]
    normal = _common_normal(model, data, joints)
    return Path(tuple(map(int, joints)), tuple(map(int, dofs)), "spatial" if normal is None else "planar", normal)


def _to_world(model: mujoco.MjModel, body: int) -> list[int]:
    found = []
    while body:
        found.append(body)
        body = int(model.body_parentid[body])
    return found


def _common_normal(model: mujoco.MjModel, data: mujoco.MjData, joints: list[int]) -> np.ndarray | None:
    """The normal (3) of the plane that joints move in, or None."""
    if not joints:
        return None
    kinds = model.jnt_type[joints]
    if np.isin(kinds, (_BALL, _FREE)).any():
        return None
    axes = data.xaxis[joints]
    hinges, slides = axes[kinds != _SLIDE], axes[kinds == _SLIDE]
    if len(hinges):
        normal = hinges[0]
    else:
        sizes, directions = np.linalg.svd(slides)[1:]
        if len(slides) < 2 or sizes[1] <= PARALLEL:
            return None  # a straight line is in many planes
        normal = directions[2]
    tilts = np.linalg.norm(crossed(normal, hinges.T), axis=0) if len(hinges) else np.zeros(0)
    if tilts.max(initial=0.0) > PARALLEL or np.abs(slides @ normal).max(initial=0.0) > PARALLEL:
        return None
    largest = int(np.abs(normal).argmax())
    return normal * np.sign(normal[largest])


def share_dofs(paths: list[Path]) -> list[list[int]]:
    """Numbers of the paths that share degrees of freedom, directly or through others."""
    groups: list[tuple[set[int], list[int]]] = []
    for number, path in enumerate(paths):
        dofs, members = set(path.dofs), [number]
        apart = []
        for other_dofs, others in groups:
            if dofs & other_dofs:
                dofs |= other_dofs
                members = others + members
            else:
                apart.append((other_dofs, others))
        groups = [*apart, (dofs, members)]
    return sorted(sorted(members) for _, members in groups)


def common_shape(paths: list[Path]) -> tuple[Shape, np.ndarray | None]:
    """The shape of several paths together, and the normal (3) of their plane if they have one."""
    shapes = [path for path in paths if path.shape != "coupling"]
    if not shapes:
        return "coupling", None
    normals = [path.normal for path in shapes if path.normal is not None]
    if len(normals) < len(shapes) or np.linalg.norm(np.cross(normals, normals[0]), axis=1).max() > PARALLEL:
        return "spatial", None
    return "planar", normals[0]
