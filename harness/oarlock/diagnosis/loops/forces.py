"""Where the multipliers of an equality act: forces and torques on bodies, per unit of each row's multiplier.

MuJoCo's rows and signs: a positive multiplier pushes towards a larger deviation.

- connect: a force on the first body at its anchor, the opposite on the second at its own.
- weld: the same, and a torque Gᵀλ on the first body, the opposite on the second. The rows are τ Im(q̄₂ q₁) with the
  orientations q₁ (with the relative pose) and q₂ and the torque scale τ; their rates are G (ω₁ − ω₂), and column m of G
  is ½τ Im(q̄₂ e_m q₁).
- joint y − p(x): a force or torque along y's axis between its body and the parent, and −p'(x) times as much along x's.
  On a body with several joints, what works on this one only.
- tendon: the same of tensions. A tendon pulls along each of its straight pieces; where it winds around a geom only the
  pieces that come and go act.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from oarlock.base.vectors import crossed
from oarlock.mechanics.coupled import coupled, coupled_ids
from oarlock.mechanics.names import Equality
from oarlock.poses.assembly import Assembly, anchors

_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)
_PULLEY, _SITE, _FIXED = (int(getattr(mujoco.mjtWrap, f"mjWRAP_{kind}")) for kind in ("PULLEY", "SITE", "JOINT"))


class BodyWrench(NamedTuple):
    """What a body gets: force (3, rows) and torque (3, rows) about a point (3), world axes, per unit multiplier."""

    body: int
    point: np.ndarray
    force: np.ndarray
    torque: np.ndarray

    def about(self, point: np.ndarray) -> np.ndarray:
        """Force and torque about another point, (6, rows)."""
        return np.vstack([self.force, self.torque + crossed(self.point - point, self.force)])


def body_wrenches(assembly: Assembly, number: int) -> list[BodyWrench]:
    """What the bodies get from one of an assembly's equalities, at its present pose; of a body there may be several."""
    equality = assembly.equalities[number]
    if equality.kind.joins_points:
        return _between_bodies(assembly, equality)
    model, data, act = assembly.model, assembly.data, _ALONG[equality.kind.holds]
    first, *second = coupled_ids(model, equality.index)
    found = act(model, data, first, 1.0)
    for other in second:
        slope = coupling_slopes(model, equality, np.array([coupled_to(assembly, equality)]))
        found += act(model, data, other, -float(slope[0]))
    return found


def coupled_to(assembly: Assembly, equality: Equality) -> float:
    """The x of a coupling p(x) at the present pose; 0 of what couples to a constant, or joins points."""
    model, second = assembly.model, int(assembly.model.eq_obj2id[equality.index])
    if equality.kind.joins_points or second < 0:
        return 0.0
    return coupled(equality.kind).position(model, assembly.data, second)


def coupling_slopes(model: mujoco.MjModel, equality: Equality, x: np.ndarray) -> np.ndarray:
    """p'(x) of a coupling at many x (T); 0 of what couples to a constant, or joins points."""
    if equality.kind.joins_points or model.eq_obj2id[equality.index] < 0:
        return np.zeros(len(x))
    return np.polyval(np.polyder(model.eq_data[equality.index, 4::-1]), x)


# Bodies.


def turns(model: mujoco.MjModel, equality: Equality) -> tuple[np.ndarray, np.ndarray]:
    """What is turned on a weld's two bodies: quaternions (4) in their frames."""
    if equality.sites:
        first, second = equality.sites
        return model.site_quat[first].copy(), model.site_quat[second].copy()
    return model.eq_data[equality.index, 6:10].copy(), np.array([1.0, 0.0, 0.0, 0.0])


def torque_map(quat1: np.ndarray, quat2: np.ndarray, scale: float) -> np.ndarray:
    """Gᵀ (…, 3, 3) of a weld: the torque on the first body, of what is turned by two quaternions (…, 4)."""
    conjugate = quat2 * np.array([1.0, -1.0, -1.0, -1.0])
    units = np.eye(4)[1:]
    turned = quat_product(quat_product(conjugate[..., None, :], units), quat1[..., None, :])
    return 0.5 * scale * turned[..., 1:]


def quat_product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The products of quaternions (…, 4)."""
    p0, p1, p2, p3 = np.moveaxis(p, -1, 0)
    q0, q1, q2, q3 = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3,
            p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2,
            p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1,
            p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0,
        ],
        axis=-1,
    )


def _between_bodies(assembly: Assembly, equality: Equality) -> list[BodyWrench]:
    model, data = assembly.model, assembly.data
    force, torque = np.zeros((2, 3, equality.rows))
    force[:, :3] = np.eye(3)
    if equality.kind.turns:
        first, second = (
            quat_product(data.xquat[body], turn)
            for body, turn in zip(equality.bodies, turns(model, equality), strict=True)
        )
        torque[:, 3:] = torque_map(first, second, equality.torque_scale(model))
    points = anchors(model, data, equality)
    return [
        BodyWrench(body, point, sign * force, sign * torque)
        for body, point, sign in zip(equality.bodies, points, (1.0, -1.0), strict=True)
    ]


# Joints and tendons.


def _along_joint(model: mujoco.MjModel, data: mujoco.MjData, joint: int, factor: float) -> list[BodyWrench]:
    """A pair between a joint's body and its parent: of those that work on this joint only, the smallest.

    With one joint on the body it is along the joint's axis. Others on the same body, which has no body between them,
    must not feel it.
    """
    body, anchor = int(model.jnt_bodyid[joint]), data.xanchor[joint].copy()
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    motions = np.zeros((6, count))  # of the point and of the body, per unit of each joint
    for at, other in enumerate(range(first, first + count)):
        axis = data.xaxis[other]
        if model.jnt_type[other] == _SLIDE:
            motions[:3, at] = axis
        else:
            motions[:3, at], motions[3:, at] = np.cross(axis, anchor - data.xanchor[other]), axis
    wrench = factor * np.linalg.pinv(motions)[joint - first]
    force, torque = wrench[:3, None], wrench[3:, None]
    return [
        BodyWrench(body, anchor, force, torque),
        BodyWrench(int(model.body_parentid[body]), anchor, -force, -torque),
    ]


def _along_tendon(model: mujoco.MjModel, data: mujoco.MjData, tendon: int, factor: float) -> list[BodyWrench]:
    start, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    wraps = range(start, start + count)
    if model.wrap_type[start] == _FIXED:
        return [
            pair
            for at in wraps
            for pair in _along_joint(model, data, int(model.wrap_objid[at]), factor * float(model.wrap_prm[at]))
        ]
    # The path as MuJoCo laid it: site, or the two points where it meets a geom, or a pulley that breaks it.
    sites = iter([int(model.wrap_objid[at]) for at in wraps if model.wrap_type[at] == _SITE])
    divisors = iter([float(model.wrap_prm[at]) for at in wraps if model.wrap_type[at] == _PULLEY])
    first, points = int(data.ten_wrapadr[tendon]), int(data.ten_wrapnum[tendon])
    found: list[BodyWrench] = []
    before: tuple[int, np.ndarray, int] | None = None
    divisor = 1.0
    for at in range(first, first + points):
        item, place = int(data.wrap_obj.flat[at]), data.wrap_xpos.reshape(-1, 3)[at].copy()
        if item == -2:
            before, divisor = None, next(divisors)
            continue
        body = int(model.site_bodyid[next(sites)] if item == -1 else model.geom_bodyid[item])
        if before is not None and not before[2] == item != -1:  # between two points of one geom it lies on it
            way = place - before[1]
            pull = factor / divisor * (way / np.linalg.norm(way))[:, None] if way.any() else np.zeros((3, 1))
            found.append(BodyWrench(before[0], before[1], -pull, np.zeros((3, 1))))
            found.append(BodyWrench(body, place, pull, np.zeros((3, 1))))
        before = body, place, item
    return found


_ALONG = {"joints": _along_joint, "tendons": _along_tendon}
"""How what a kind couples is pushed along its position."""
