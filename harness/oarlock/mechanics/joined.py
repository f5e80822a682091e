"""J̇v of connects and welds, for versions of MuJoCo whose reference acceleration lacks it.

The rows of a point are p₀ − p₁, of which J̇v is the difference of the points' accelerations at q̈ = 0. Those of an
orientation are r = s · vec(q̄₁ Q) of the quaternions Q = q₀ · relpose and q₁ of the bodies, with q̇ = ½ ω q, so that

    J̇v = ½ s · vec(q̄₁ (α + ½ (Δ ω₀ − ω₁ Δ)) Q),   Δ = ω₀ − ω₁,   α the difference of the angular accelerations at q̈ = 0,

where vectors stand for quaternions without a real part.
"""

import mujoco
import numpy as np

from oarlock.base.vectors import Vector, minus
from oarlock.mechanics.kinematics import Kinematics
from oarlock.mechanics.names import Equality

_Quaternion = tuple[float, float, float, float]


class Joined:
    """Computes J̇v of the rows of one connect or weld.

    Attributes:
        bodies: numbers of those whose motion it needs.
    """

    def __init__(self, model: mujoco.MjModel, equality: Equality):
        self.bodies = equality.bodies
        self._sites, self._scale = equality.sites, equality.torque_scale(model)
        self._anchors = [equality.anchor(model, end) for end in (0, 1)]
        self._poses: tuple[_Quaternion, _Quaternion] = (1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
        if equality.kind.turns and self._sites:
            first, second = (tuple(model.site_quat[site].tolist()) for site in self._sites)
            self._poses = first, second
        elif equality.kind.turns:
            self._poses = tuple(model.eq_data[equality.index, 6:10].tolist()), self._poses[1]

    def bends(self, data: mujoco.MjData, kinematics: Kinematics) -> list[float]:
        """Computes J̇v of its rows, 3 or 6, m/s² or rad/s²."""
        ends = [kinematics.bend(body, self._place(data, end)) for end, body in enumerate(self.bodies)]
        found = [*minus(*ends)]
        return found + self._turning(data, kinematics) if self._scale else found

    def _place(self, data: mujoco.MjData, end: int) -> Vector:
        if self._sites:
            place = data.site_xpos[self._sites[end]]
        else:
            body = self.bodies[end]
            place = data.xpos[body] + data.xmat[body].reshape(3, 3) @ self._anchors[end]
        x, y, z = place.tolist()
        return x, y, z

    def _turning(self, data: mujoco.MjData, kinematics: Kinematics) -> list[float]:
        first, second = (
            _product(tuple(data.xquat[body].tolist()), pose)
            for body, pose in zip(self.bodies, self._poses, strict=True)
        )
        spins = [kinematics.spin(body) for body in self.bodies]
        across = _pure(minus(*spins))
        turned = _pure(minus(*(kinematics.turn_bend(body) for body in self.bodies)))
        before, after = _product(across, _pure(spins[0])), _product(_pure(spins[1]), across)
        whole = tuple(a + 0.5 * (b - c) for a, b, c in zip(turned, before, after, strict=True))
        w, x, y, z = second
        _, *vector = _product(_product((w, -x, -y, -z), whole), first)
        return [0.5 * self._scale * entry for entry in vector]


def _pure(vector: Vector) -> _Quaternion:
    return 0.0, *vector


def _product(left: tuple[float, ...], right: tuple[float, ...]) -> _Quaternion:
    found = np.zeros(4)
    mujoco.mju_mulQuat(found, np.array(left), np.array(right))
    w, x, y, z = found.tolist()
    return w, x, y, z
