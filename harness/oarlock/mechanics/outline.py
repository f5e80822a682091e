"""Where the parts of a mechanism are drawn: points that move with their bodies, rails of slides, ends of links.

MuJoCo's ``xanchor`` of a joint is where it is before the body slides: of a hinge that turns a body the place itself, of
a slide the end of its rail that the parent carries. A point of an equality may lie where its body has nothing: MuJoCo
computes the second anchor from the first at the model's own pose, and if two links do not meet there it is in the air.
"""

import mujoco
import numpy as np

from oarlock.mechanics.names import Equality

AIR = 0.02
"""Of the model's extent: a point that is further from its body's geoms is in the air. The boxes around geoms of a pin
and its hole differ by less."""

_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)


def rails_of(model: mujoco.MjModel, body: int) -> list[int]:
    """The slides of a body, each of which has a rail from its ``xanchor`` along its axis."""
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    return [joint for joint in range(first, first + count) if model.jnt_type[joint] == _SLIDE]


def fixed_point(data: mujoco.MjData, body: int, local: np.ndarray) -> np.ndarray:
    """Where a point (3) of a body's frame is, world (3); the kinematics of ``data`` must be valid."""
    return data.xpos[body] + data.xmat[body].reshape(3, 3) @ local


def distinct_joints(model: mujoco.MjModel, body: int) -> list[int]:
    """Joints of a body, one of those that are at the same point of it."""
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    found: list[int] = []
    for joint in range(first, first + count):
        if not any(np.allclose(model.jnt_pos[joint], model.jnt_pos[known]) for known in found):
            found.append(joint)
    return found


def stands(model: mujoco.MjModel, body: int) -> bool:
    """Whether a body turns about a point of the ground: its first joint is of the world, and no slide or free joint."""
    joint, free = int(model.body_jntadr[body]), int(mujoco.mjtJoint.mjJNT_FREE)
    if joint < 0 or model.body_parentid[body]:
        return False
    count = int(model.body_jntnum[body])
    return not any(model.jnt_type[one] in (_SLIDE, free) for one in range(joint, joint + count))


def drawn_end(model: mujoco.MjModel, equality: Equality, end: int) -> np.ndarray | None:
    """The point (3) of a body's geoms, in its frame, that is nearest to its anchor, where that is in the air.

    Geoms count with the boxes around them. None where the anchor is at the body, was put there as a site, or the body
    is the world or has no geom.
    """
    body = equality.bodies[end]
    first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
    if equality.sites or not body or not count:
        return None
    anchor, best, least = equality.anchor(model, end), None, np.inf
    turn = np.zeros(9)
    for geom in range(first, first + count):
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        axes = turn.reshape(3, 3)
        centre, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        inside = np.clip(axes.T @ (anchor - model.geom_pos[geom]), centre - half, centre + half)
        point = model.geom_pos[geom] + axes @ inside
        far = float(np.linalg.norm(point - anchor))
        if far < least:
            best, least = point, far
    return best if least > AIR * float(model.stat.extent) else None
