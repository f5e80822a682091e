"""J̇v of tendons: the part of a tendon's L̈ that needs no acceleration of the coordinates.

A tendon's Jacobian is the gradient of its length, so J̇v is L̈ at q̈ = 0, and a spatial tendon's L̈ follows from the
motion of the sites it runs through. A piece that wraps a geom is the shortest path on a sphere or a cylinder, and its
length is known in closed form: with ρ₀, ρ₁ the distances of its ends from the centre (the axis) and γ the angle between
them,

    ℓ = f(ρ₀) + f(ρ₁) + r γ,   f(ρ) = √(ρ² − r²) − r arccos(r/ρ),   and on a cylinder L = √(ℓ² + Δz²).
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.errors import InputError
from oarlock.kinematics import Kinematics, cross

_SITE, _PULLEY = int(mujoco.mjtWrap.mjWRAP_SITE), int(mujoco.mjtWrap.mjWRAP_PULLEY)
_JOINT, _CYLINDER = int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtWrap.mjWRAP_CYLINDER)

_ON_SITE = -1
"""What MuJoCo's path says of a point on a site; geoms have their id, pulleys −2."""

_Motion = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Place, velocity and acceleration at q̈ = 0 of an end, each (3), in a frame said where it is used."""


@dataclass(frozen=True)
class _Piece:
    """From one site to the next, over a geom or not."""

    order: int
    """Number of sites that the path runs through before it, its own first one counted."""
    sites: tuple[int, int]
    divisor: float
    geom: int | None = None
    side: int | None = None
    cylinder: bool = False


class Tendon:
    """One tendon of a model. Its pieces are read from the model once; whether they wrap is read at every state."""

    def __init__(self, model: mujoco.MjModel, index: int, kinematics: Kinematics):
        self._model, self._kinematics, self._index = model, kinematics, index
        self._name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TENDON, index) or f"#{index}"
        self._pieces = _pieces(model, index)

    def bend(self, data: mujoco.MjData) -> float:
        """J̇v of the tendon, m/s²; 0 for a fixed tendon, whose Jacobian is constant.

        Raises:
            InputError: the length has no second derivative here, or wraps inside a geom.
        """
        total = 0.0
        touches = self._touches(data)
        for piece in self._pieces:
            bodies = [int(self._model.site_bodyid[site]) for site in piece.sites]
            if piece.order in touches:
                total += self._wrapped(data, piece, bodies, touches[piece.order]) / piece.divisor
            elif bodies[0] != bodies[1]:
                total += self._straight(data, piece, bodies) / piece.divisor
        return total

    def _touches(self, data: mujoco.MjData) -> dict[int, np.ndarray]:
        """Order of a piece that wraps its geom here → the point where it arrives on it."""
        found: dict[int, np.ndarray] = {}
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
                found.setdefault(sites, place)
        return found

    def _motion(self, data: mujoco.MjData, site: int, body: int) -> _Motion:
        place = data.site_xpos[site]
        kinematics = self._kinematics
        return place, kinematics.velocity(data, body, place), kinematics.bend(data, body, place)

    def _straight(self, data: mujoco.MjData, piece: _Piece, bodies: list[int]) -> float:
        ends = [self._motion(data, site, body) for site, body in zip(piece.sites, bodies, strict=True)]
        place, velocity, bend = (b - a for a, b in zip(*ends, strict=True))
        return self._norm_bend(place, velocity, bend)

    def _norm_bend(self, x: np.ndarray, v: np.ndarray, a: np.ndarray) -> float:
        """Second derivative of |x|."""
        length = float(np.sqrt(x @ x))
        if length < mujoco.mjMINVAL:
            raise InputError(f"tendon '{self._name}' has a piece of length 0, expected a length with a derivative")
        rate = float(x @ v) / length
        return (float(v @ v + x @ a) - rate * rate) / length

    def _wrapped(self, data: mujoco.MjData, piece: _Piece, bodies: list[int], touch: np.ndarray) -> float:
        model, kinematics, geom = self._model, self._kinematics, piece.geom
        assert geom is not None
        body, centre, radius = int(model.geom_bodyid[geom]), data.geom_xpos[geom], float(model.geom_size[geom, 0])
        axis = data.geom_xmat[geom].reshape(3, 3)[:, 2] if piece.cylinder else None
        if piece.side is not None and np.linalg.norm(_across(data.site_xpos[piece.side] - centre, axis)) < radius:
            geom_name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom) or f"#{geom}"
            raise InputError(
                f"tendon '{self._name}' wraps inside geom '{geom_name}', expected its side site outside: "
                "J̇v of a tendon inside a geom is not known"
            )
        spin = kinematics.spin(data, body)
        ends: list[_Motion] = []  # in the geom's frame, written in world axes
        for site, own in zip(piece.sites, bodies, strict=True):
            place, velocity, bend = self._motion(data, site, own)
            velocity = velocity - kinematics.velocity(data, body, place)
            bend = bend - kinematics.bend(data, body, place) - 2.0 * cross(spin, velocity)
            ends.append((place - centre, velocity, bend))
        if axis is None:
            return self._around(ends, radius, touch - centre, None)[2]
        flat: list[_Motion] = [(_across(x, axis), _across(v, axis), _across(a, axis)) for x, v, a in ends]
        length, rate, bend = self._around(flat, radius, touch - centre, axis)
        rise, climb, heave = (float((b - a) @ axis) for a, b in zip(*ends, strict=True))
        total = float(np.hypot(length, rise))
        total_rate = (length * rate + rise * climb) / total
        return (rate * rate + length * bend + climb * climb + rise * heave - total_rate * total_rate) / total

    def _around(
        self, ends: list[_Motion], radius: float, touch: np.ndarray, axis: np.ndarray | None
    ) -> tuple[float, float, float]:
        """ℓ, ℓ̇ and ℓ̈ of a path around a circle (axis given: all vectors but ``touch`` across it) or a sphere."""
        (x0, v0, a0), (x1, v1, a1) = ends
        normal = cross(x0, x1)
        normal_rate = cross(v0, x1) + cross(x0, v1)
        normal_bend = cross(a0, x1) + 2.0 * cross(v0, v1) + cross(x0, a1)
        if axis is None:
            sine = float(np.sqrt(normal @ normal))
            if sine < mujoco.mjMINVAL:
                raise InputError(
                    f"tendon '{self._name}' runs straight over the centre of its sphere, where its path is undetermined"
                )
            sine_rate = float(normal @ normal_rate) / sine
            sine_bend = (float(normal_rate @ normal_rate + normal @ normal_bend) - sine_rate * sine_rate) / sine
            pole = normal
        else:
            sine, sine_rate, sine_bend = (float(n @ axis) for n in (normal, normal_rate, normal_bend))
            pole = axis
        cosine, cosine_rate = float(x0 @ x1), float(v0 @ x1 + x0 @ v1)
        cosine_bend = float(a0 @ x1 + 2.0 * (v0 @ v1) + x0 @ a1)
        square = sine * sine + cosine * cosine
        turn = (sine_rate * cosine - sine * cosine_rate) / square
        square_rate = 2.0 * (sine * sine_rate + cosine * cosine_rate)
        turn_bend = (sine_bend * cosine - sine * cosine_bend - turn * square_rate) / square
        # The path starts towards where it arrives on the geom: that is the way round it goes.
        way = 1.0 if cross(x0, touch) @ pole >= 0.0 else -1.0
        angle = (way * float(np.arctan2(sine, cosine))) % (2.0 * np.pi)

        length, rate, bend = radius * angle, radius * way * turn, radius * way * turn_bend
        for x, v, a in ends:
            rho = float(np.sqrt(x @ x))
            rho_rate = float(x @ v) / rho
            rho_bend = (float(v @ v + x @ a) - rho_rate * rho_rate) / rho
            free = float(np.sqrt(max(rho * rho - radius * radius, mujoco.mjMINVAL)))
            length += free - radius * float(np.arccos(min(radius / rho, 1.0)))
            rate += free / rho * rho_rate
            bend += free / rho * rho_bend + radius * radius / (rho * rho * free) * rho_rate * rho_rate
        return length, rate, bend


def _across(vector: np.ndarray, axis: np.ndarray | None) -> np.ndarray:
    """The part of a vector at right angles to an axis; all of it where there is none."""
    return vector if axis is None else vector - (vector @ axis) * axis


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
