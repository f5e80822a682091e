"""Velocities and J̇v of points of bodies, at a state whose position and velocity stages are done.

J̇v of a body's rotation and of its points is their acceleration at q̈ = 0, the bias acceleration. One pass over
the bodies gives it as a spatial vector a = (α, a₀), taken at the centre of mass c of the kinematic tree (Featherstone
2008, *Rigid Body Dynamics Algorithms*, §5.3; the first half of MuJoCo's ``mj_rne``, without gravity):

    a = a_parent + Σ ṡ q̇   over the body's own joint axes s, MuJoCo's ``cdof``, with the rates ṡ, ``cdof_dot``.

A spatial acceleration is that of the matter passing c. What accelerates with the body is the point at p = c + r, as in
``mj_objectAcceleration``:

    p̈ = a₀ + α×r + ω×ṗ,   ṗ = v₀ + ω×r.
"""

from collections.abc import Iterable

import mujoco
import numpy as np

from oarlock.base.vectors import Vector, cross, minus, plus


class Kinematics:
    """Computes the motion of some bodies and of their points.

    A point is given by the place (m, world frame) where it is at the state that was read last.

    Args:
        model: the model.
        bodies: numbers of the bodies whose motion will be asked for.
    """

    def __init__(self, model: mujoco.MjModel, bodies: Iterable[int]):
        parents, first, count = model.body_parentid, model.body_dofadr, model.body_dofnum
        moving: set[int] = set()
        for body in bodies:
            while body and body not in moving:
                moving.add(body)
                body = int(parents[body])
        # Parents have the smaller ids.
        self._chain = [
            (body, int(parents[body]), tuple(range(int(first[body]), int(first[body] + count[body]))))
            for body in sorted(moving)
        ]
        self._roots = model.body_rootid.tolist()
        self._velocities: list[list[float]] = []
        self._centres: list[list[float]] = []
        self._biases = [(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)] * model.nbody

    def read(self, data: mujoco.MjData) -> None:
        """Reads the motion of the bodies from a state; all other methods refer to it."""
        if not self._chain:
            return
        self._velocities, self._centres = data.cvel.tolist(), data.subtree_com.tolist()
        rates = (data.cdof_dot * data.qvel[:, np.newaxis]).tolist()
        biases = self._biases
        for body, parent, dofs in self._chain:
            x, y, z, u, v, w = biases[parent]
            for dof in dofs:
                a, b, c, d, e, f = rates[dof]
                x, y, z, u, v, w = x + a, y + b, z + c, u + d, v + e, w + f
            biases[body] = x, y, z, u, v, w

    def spin(self, body: int) -> Vector:
        """Returns the angular velocity of a body in world axes, rad/s."""
        x, y, z, *_ = self._velocities[body]
        return x, y, z

    def velocity(self, body: int, place: Vector) -> Vector:
        """Computes the velocity of the body's point at a place, m/s, world axes."""
        spin_x, spin_y, spin_z, x, y, z = self._velocities[body]
        return plus((x, y, z), cross((spin_x, spin_y, spin_z), minus(place, self._centre(body))))

    def bend(self, body: int, place: Vector) -> Vector:
        """Computes J̇v of the body's point at a place, m/s², world axes."""
        # A call of every operation would double the time.
        x, y, z = place
        centre_x, centre_y, centre_z = self._centres[self._roots[body]]
        x, y, z = x - centre_x, y - centre_y, z - centre_z
        p, q, r, u, v, w = self._velocities[body]
        u, v, w = u + (q * z - r * y), v + (r * x - p * z), w + (p * y - q * x)
        a, b, c, d, e, f = self._biases[body]
        return (
            d + (b * z - c * y) + (q * w - r * v),
            e + (c * x - a * z) + (r * u - p * w),
            f + (a * y - b * x) + (p * v - q * u),
        )

    def _centre(self, body: int) -> Vector:
        x, y, z = self._centres[self._roots[body]]
        return x, y, z
