"""J̇v of tendons, the part of L̈ that does not depend on the acceleration of the coordinates.

A tendon's Jacobian is the gradient of its length, so J̇v is L̈ at q̈ = 0, and a spatial tendon's L̈ follows from the
motion of the sites it runs through. A piece that wraps a geom is the shortest path on a sphere or a cylinder, and its
length is known in closed form: with ρ₀, ρ₁ the distances of its ends from the centre (the axis) and γ the angle between
them,

    ℓ = f(ρ₀) + f(ρ₁) + r γ,   f(ρ) = √(ρ² − r²) − r arccos(r/ρ),   and on a cylinder L = √(ℓ² + Δz²).
"""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.vectors import Vector, cross, dot, minus, plus, scaled
from oarlock.mechanics.kinematics import Kinematics

_SITE, _PULLEY = int(mujoco.mjtWrap.mjWRAP_SITE), int(mujoco.mjtWrap.mjWRAP_PULLEY)
_JOINT, _CYLINDER = int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtWrap.mjWRAP_CYLINDER)

_ON_SITE = -1
"""MuJoCo's mark for a point of a path on a site. Geoms have their number, pulleys −2."""

_Motion = tuple[Vector, Vector, Vector]
"""Place (m), velocity (m/s) and acceleration at q̈ = 0 (m/s²) of an end; the frame is said where it is used."""


@dataclass(frozen=True)
class _Piece:
    """The piece of a path from one site to the next, with or without a geom to wrap around."""

    order: int
    """Number of sites on the path up to the first one of this piece, which is counted."""
    sites: tuple[int, int]
    divisor: float
    geom: int | None = None
    side: int | None = None
    cylinder: bool = False


class Tendon:
    """Computes J̇v of one tendon. Its pieces are read from the model once; whether they wrap, at every state."""

    def __init__(self, model: mujoco.MjModel, index: int):
        self._model, self._index = model, index
        self._name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TENDON, index) or f"#{index}"
        self._pieces = _pieces(model, index)
        sites = [int(model.site_bodyid[site]) for piece in self._pieces for site in piece.sites]
        self.bodies = sites + [int(model.geom_bodyid[piece.geom]) for piece in self._pieces if piece.geom is not None]
        """Numbers of the bodies whose motion it needs."""

    def bend(self, data: mujoco.MjData, kinematics: Kinematics) -> float:
        """Computes J̇v of the tendon, m/s²; 0 for a fixed tendon, whose Jacobian is constant.

        Raises:
            InputError: the length has no second derivative at this state, or the tendon wraps inside a geom.
        """
        total = 0.0
        touches = self._touches(data)
        for piece in self._pieces:
            bodies = [int(self._model.site_bodyid[site]) for site in piece.sites]
            if piece.order in touches:
                total += self._wrapped(data, kinematics, piece, bodies, touches[piece.order]) / piece.divisor
            elif bodies[0] != bodies[1]:
                total += self._straight(data, kinematics, piece, bodies) / piece.divisor
        return total

    def _touches(self, data: mujoco.MjData) -> dict[int, Vector]:
        """Finds the pieces that wrap at this state: order of a piece → the point where the path meets the geom."""
        found: dict[int, Vector] = {}
        if all(piece.geom is None for piece in self._pieces):
            return found
        first, count = int(data.ten_wrapadr[self._index]), int(data.ten_wrapnum[self._index])
        objects = np.asarray(data.wrap_obj).reshape(-1)[first : first + count]
        places = np.asarray(data.wrap_xpos).reshape(-1, 3)[first : first + count]
        sites = 0
        for item, place in zip(objects.tolist(), places, strict=True):
            if item == _ON_SITE:
                sites += 1
            elif item >= 0:
                found.setdefault(sites, tuple(place.tolist()))
        return found

    def _straight(self, data: mujoco.MjData, kinematics: Kinematics, piece: _Piece, bodies: list[int]) -> float:
        ends = [_motion(data, kinematics, site, body) for site, body in zip(piece.sites, bodies, strict=True)]
        x, v, a = (minus(end1, end0) for end0, end1 in zip(*ends, strict=True))
        length = math.sqrt(dot(x, x))
        if length < mujoco.mjMINVAL:
            raise InputError(f"tendon '{self._name}' has a piece of length 0, expected a length with a derivative")
        return _norm(x, v, a)[2]

    def _wrapped(
        self, data: mujoco.MjData, kinematics: Kinematics, piece: _Piece, bodies: list[int], touch: Vector
    ) -> float:
        model, geom = self._model, piece.geom
        assert geom is not None
        body, radius = int(model.geom_bodyid[geom]), float(model.geom_size[geom, 0])
        centre: Vector = tuple(data.geom_xpos[geom].tolist())
        axis: Vector | None = tuple(data.geom_xmat[geom, 2::3].tolist()) if piece.cylinder else None
        if piece.side is not None:
            side = _across(minus(data.site_xpos[piece.side].tolist(), centre), axis)
            if math.sqrt(dot(side, side)) < radius:
                geom_name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom) or f"#{geom}"
                raise InputError(
                    f"tendon '{self._name}' wraps inside geom '{geom_name}', expected its side site outside: "
                    "J̇v of a tendon inside a geom is not known"
                )
        spin = kinematics.spin(body)
        ends: list[_Motion] = []  # in the geom's frame, written in world axes
        for site, own in zip(piece.sites, bodies, strict=True):
            place, velocity, bend = _motion(data, kinematics, site, own)
            velocity = minus(velocity, kinematics.velocity(body, place))
            bend = minus(bend, kinematics.bend(body, place))
            ends.append((minus(place, centre), velocity, minus(bend, scaled(2.0, cross(spin, velocity)))))
        arrival = minus(touch, centre)
        if axis is None:
            return self._around(ends, radius, arrival, None)[2]
        flat: list[_Motion] = [(_across(x, axis), _across(v, axis), _across(a, axis)) for x, v, a in ends]
        length, rate, bend = self._around(flat, radius, arrival, axis)
        rise, climb, heave = (dot(minus(end1, end0), axis) for end0, end1 in zip(*ends, strict=True))
        total = math.sqrt(length * length + rise * rise)
        total_rate = (length * rate + rise * climb) / total
        return (rate * rate + length * bend + climb * climb + rise * heave - total_rate * total_rate) / total

    def _around(
        self, ends: list[_Motion], radius: float, touch: Vector, axis: Vector | None
    ) -> tuple[float, float, float]:
        """Computes ℓ, ℓ̇ and ℓ̈ of a path around a sphere, or around a circle across ``axis``.

        With an axis all vectors but ``touch`` are at right angles to it.
        """
        (x0, v0, a0), (x1, v1, a1) = ends
        normal = cross(x0, x1)
        normal_rate = plus(cross(v0, x1), cross(x0, v1))
        normal_bend = plus(plus(cross(a0, x1), scaled(2.0, cross(v0, v1))), cross(x0, a1))
        if axis is None:
            if math.sqrt(dot(normal, normal)) < mujoco.mjMINVAL:
                raise InputError(
                    f"tendon '{self._name}' runs straight over the centre of its sphere, where its path is undetermined"
                )
            sine, sine_rate, sine_bend = _norm(normal, normal_rate, normal_bend)
            pole = normal
        else:
            sine, sine_rate, sine_bend = dot(normal, axis), dot(normal_rate, axis), dot(normal_bend, axis)
            pole = axis
        cosine, cosine_rate = dot(x0, x1), dot(v0, x1) + dot(x0, v1)
        cosine_bend = dot(a0, x1) + 2.0 * dot(v0, v1) + dot(x0, a1)
        square = sine * sine + cosine * cosine
        turn = (sine_rate * cosine - sine * cosine_rate) / square
        square_rate = 2.0 * (sine * sine_rate + cosine * cosine_rate)
        turn_bend = (sine_bend * cosine - sine * cosine_bend - turn * square_rate) / square
        # The path starts towards where it arrives on the geom: that is the way round it goes.
        way = 1.0 if dot(cross(x0, touch), pole) >= 0.0 else -1.0
        angle = way * math.atan2(sine, cosine)
        if angle < 0.0:
            angle += 2.0 * math.pi

        length, rate, bend = radius * angle, radius * way * turn, radius * way * turn_bend
        for x, v, a in ends:
            rho, rho_rate, rho_bend = _norm(x, v, a)
            free = math.sqrt(max(rho * rho - radius * radius, mujoco.mjMINVAL))
            length += free - radius * math.acos(min(radius / rho, 1.0))
            rate += free / rho * rho_rate
            bend += free / rho * rho_bend + radius * radius / (rho * rho * free) * rho_rate * rho_rate
        return length, rate, bend


def _motion(data: mujoco.MjData, kinematics: Kinematics, site: int, body: int) -> _Motion:
    place = tuple(data.site_xpos[site].tolist())
    return place, kinematics.velocity(body, place), kinematics.bend(body, place)


def _norm(x: Vector, v: Vector, a: Vector) -> tuple[float, float, float]:
    """Computes |x| and its first and second derivative; x is not 0."""
    length = math.sqrt(dot(x, x))
    rate = dot(x, v) / length
    return length, rate, (dot(v, v) + dot(x, a) - rate * rate) / length


def _across(vector: Vector, axis: Vector | None) -> Vector:
    """Returns the part of a vector at right angles to an axis; all of it if there is no axis."""
    return vector if axis is None else minus(vector, scaled(dot(vector, axis), axis))


def _pieces(model: mujoco.MjModel, index: int) -> list[_Piece]:
    first, count = int(model.tendon_adr[index]), int(model.tendon_num[index])
    pieces: list[_Piece] = []
    divisor = 1.0
    sites, site, geom, side, cylinder = 0, None, None, None, False
    for at in range(first, first + count):
        kind, item = int(model.wrap_type[at]), int(model.wrap_objid[at])
        if kind == _JOINT:
            return []
        if kind == _PULLEY:
            divisor, site = float(model.wrap_prm[at]), None
        elif kind == _SITE:
            if site is not None:
                pieces.append(_Piece(sites, (site, item), divisor, geom, side, cylinder))
            sites += 1
            site, geom, side, cylinder = item, None, None, False
        else:
            prm = round(float(model.wrap_prm[at]))
            geom, side, cylinder = item, prm if prm >= 0 else None, kind == _CYLINDER
    return pieces
