"""Rows of equalities as MuJoCo writes them, from the motion of bodies that an engine has: J, J̇v and the deviations.

An engine gives, of every body, where it is, how it moves, and how it accelerates at q̈ = 0. With r the deviation of a
row, J = ∂r/∂q and J̇v = r̈ at q̈ = 0; all in MuJoCo's coordinates.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from shared.compiled import (
    JOINT,
    TENDON,
    WRAP_JOINT,
    WRAP_PULLEY,
    WRAP_SITE,
    Compiled,
    Joining,
    conjugate,
    matrix,
    product,
    pure,
)


class Body(NamedTuple):
    """How a body moves, world axes.

    Attributes:
        place: of its origin (3), m.
        turn: its orientation, w x y z.
        velocity: of its origin (3), m/s.
        spin: its angular velocity (3), rad/s.
        bend: acceleration of its origin at q̈ = 0 (3), m/s².
        twist: angular acceleration at q̈ = 0 (3), rad/s².
        jacobian: of the origin's velocity and of the angular velocity (6, nv).
    """

    place: np.ndarray
    turn: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    bend: np.ndarray
    twist: np.ndarray
    jacobian: np.ndarray


class Rows(NamedTuple):
    """Some rows: J (n, nv), J̇v (n), deviations r (n)."""

    jacobian: np.ndarray
    curvature: np.ndarray
    deviation: np.ndarray


Motion = Callable[[int], Body]
"""Of a body, by its number, at the state that is looked at."""


def point(body: Body, place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Place, velocity, J̇v (3) and J (3, nv) of a point that is given in the frame of its body."""
    arm = matrix(body.turn) @ place
    velocity = body.velocity + np.cross(body.spin, arm)
    bend = body.bend + np.cross(body.twist, arm) + np.cross(body.spin, np.cross(body.spin, arm))
    jacobian = body.jacobian[:3] - np.cross(arm, body.jacobian[3:], axisb=0, axisc=0)
    return body.place + arm, velocity, bend, jacobian


def joined(joining: Joining, motion: Motion) -> Rows:
    """The rows of a connect (3), or of a weld (6)."""
    first, second = (motion(body) for body in joining.bodies)
    x1, _, bend1, jacobian1 = point(first, joining.places[0])
    x2, _, bend2, jacobian2 = point(second, joining.places[1])
    held = Rows(jacobian1 - jacobian2, bend1 - bend2, x1 - x2)
    if not joining.scale:
        return held
    # r = s vec(b̄ a) with a, b the orientations of the two frames; ȧ = ½ ω₁ a, and with ω = ω₁ − ω₂
    # ṙ = ½ s vec(b̄ ω a),   r̈ = ½ s vec(b̄ (ω̇ − ½ ω₂ ω + ½ ω ω₁) a).
    a, b = (product(body.turn, turn) for body, turn in zip((first, second), joining.turns, strict=True))
    half = 0.5 * joining.scale
    turning = half * np.column_stack([_between(b, pure(axis), a) for axis in np.eye(3)])
    spin = pure(first.spin - second.spin)
    change = pure(first.twist - second.twist)
    change = change - 0.5 * product(pure(second.spin), spin) + 0.5 * product(spin, pure(first.spin))
    return Rows(
        np.vstack([held.jacobian, turning @ (first.jacobian[3:] - second.jacobian[3:])]),
        np.concatenate([held.curvature, half * _between(b, change, a)]),
        np.concatenate([held.deviation, joining.scale * product(conjugate(b), a)[1:]]),
    )


def _between(b: np.ndarray, middle: np.ndarray, a: np.ndarray) -> np.ndarray:
    return product(conjugate(b), product(middle, a))[1:]


class Coupled:
    """The rows of the joint and tendon equalities of a model."""

    def __init__(self, compiled: Compiled):
        self._compiled = compiled
        self._indices = [index for index in compiled.active() if compiled.eq_type[index] in (JOINT, TENDON)]

    def __len__(self) -> int:
        return len(self._indices)

    def wrapped(self) -> list[int]:
        """Numbers of the tendons among them that run around geoms, which is not known here."""
        compiled = self._compiled
        tendons = [
            tendon
            for index in self._indices
            if compiled.eq_type[index] == TENDON
            for tendon in _pair(compiled, index)
            if tendon >= 0
        ]
        return [tendon for tendon in dict.fromkeys(tendons) if around_geoms(compiled, tendon)]

    def rows(self, qpos: np.ndarray, qvel: np.ndarray, motion: Motion) -> dict[int, Rows]:
        """Number of an equality → its row y − p(x), with x and y measured from the model's own pose."""
        return {index: self._row(index, qpos, qvel, motion) for index in self._indices}

    def _row(self, index: int, qpos: np.ndarray, qvel: np.ndarray, motion: Motion) -> Rows:
        first, second = _pair(self._compiled, index)
        tendon = self._compiled.eq_type[index] == TENDON
        look = self._tendon if tendon else self._joint
        y, y_jacobian, y_bend = look(first, qpos, qvel, motion)
        p = np.polynomial.Polynomial(self._compiled.eq_data[index, :5])
        if second < 0:
            return Rows(y_jacobian[None], np.array([y_bend]), np.array([y - p.coef[0]]))
        x, x_jacobian, x_bend = look(second, qpos, qvel, motion)
        slope, rate = p.deriv()(x), float(x_jacobian @ qvel)
        bend = y_bend - slope * x_bend - p.deriv(2)(x) * rate * rate
        return Rows((y_jacobian - slope * x_jacobian)[None], np.array([bend]), np.array([y - p(x)]))

    def _joint(self, joint: int, qpos: np.ndarray, qvel: np.ndarray, motion: Motion) -> tuple[float, np.ndarray, float]:
        compiled = self._compiled
        at, jacobian = int(compiled.jnt_qposadr[joint]), np.zeros(len(qvel))
        jacobian[int(compiled.jnt_dofadr[joint])] = 1.0
        return float(qpos[at] - compiled.qpos0[at]), jacobian, 0.0

    def _tendon(
        self, tendon: int, qpos: np.ndarray, qvel: np.ndarray, motion: Motion
    ) -> tuple[float, np.ndarray, float]:
        length, jacobian, bend = stretched(self._compiled, tendon, qpos, qvel, motion)
        return length - float(self._compiled.tendon_length0[tendon]), jacobian, bend


def _pair(compiled: Compiled, index: int) -> tuple[int, int]:
    return int(compiled.eq_obj1id[index]), int(compiled.eq_obj2id[index])


def around_geoms(compiled: Compiled, tendon: int) -> bool:
    """Whether a tendon runs around geoms."""
    first, count = int(compiled.tendon_adr[tendon]), int(compiled.tendon_num[tendon])
    return bool((compiled.wrap_type[first : first + count] > WRAP_SITE).any())


def stretched(
    compiled: Compiled, tendon: int, qpos: np.ndarray, qvel: np.ndarray, motion: Motion
) -> tuple[float, np.ndarray, float]:
    """Length (m), its gradient (nv) and its J̇v of a fixed tendon, or of one that runs straight from site to site."""
    total, gradient, bend = 0.0, np.zeros(len(qvel)), 0.0
    before, divisor = -1, 1.0
    first, count = int(compiled.tendon_adr[tendon]), int(compiled.tendon_num[tendon])
    for at in range(first, first + count):
        kind, item, number = int(compiled.wrap_type[at]), int(compiled.wrap_objid[at]), float(compiled.wrap_prm[at])
        if kind == WRAP_JOINT:
            total += number * float(qpos[int(compiled.jnt_qposadr[item])])
            gradient[int(compiled.jnt_dofadr[item])] += number
        elif kind == WRAP_PULLEY:
            before, divisor = -1, number
        else:
            if before >= 0:
                ends = [(int(compiled.site_bodyid[site]), compiled.site_pos[site]) for site in (before, item)]
                piece = _piece(*(point(motion(body), place) for body, place in ends))
                # Between points of one body its length is constant, also where it is none.
                total += piece[0] / divisor
                if ends[0][0] != ends[1][0]:
                    gradient += piece[1] / divisor
                    bend += piece[2] / divisor
            before = item
    return total, gradient, bend


def _piece(one: tuple[np.ndarray, ...], other: tuple[np.ndarray, ...]) -> tuple[float, np.ndarray, float]:
    """Length of the line between two points, its gradient and its J̇v."""
    x, v, bend, jacobian = (far - near for near, far in zip(one, other, strict=True))
    length = float(np.linalg.norm(x))
    if length == 0.0:
        return 0.0, np.zeros(jacobian.shape[1]), 0.0
    way = x / length
    rate = float(way @ v)
    return length, way @ jacobian, (float(v @ v) - rate * rate) / length + float(way @ bend)
