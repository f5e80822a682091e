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
        self._biases = [[0.0] * 6] * model.nbody

    def read(self, data: mujoco.MjData) -> None:
        """Reads the motion of the bodies from a state; all other methods refer to it."""
        if not self._chain:
            return
        self._velocities, self._centres = data.cvel.tolist(), data.subtree_com.tolist()
        rates = (data.cdof_dot * data.qvel[:, np.newaxis]).tolist()
        for body, parent, dofs in self._chain:
            bias = self._biases[parent]
            for dof in dofs:
                bias = [whole + part for whole, part in zip(bias, rates[dof], strict=True)]
            self._biases[body] = bias

    def spin(self, body: int) -> Vector:
        """Returns the angular velocity of a body in world axes, rad/s."""
        return _halves(self._velocities[body])[0]

    def turn_bend(self, body: int) -> Vector:
        """Returns J̇v of a body's rotation in world axes, rad/s²."""
        return _halves(self._biases[body])[0]

    def velocity(self, body: int, place: Vector) -> Vector:
        """Computes the velocity of the body's point at a place, m/s, world axes."""
        turning, moving = _halves(self._velocities[body])
        return plus(moving, cross(turning, self._arm(body, place)))

    def bend(self, body: int, place: Vector) -> Vector:
        """Computes J̇v of the body's point at a place, m/s², world axes."""
        turning, moving = _halves(self._biases[body])
        turned = plus(moving, cross(turning, self._arm(body, place)))
        return plus(turned, cross(self.spin(body), self.velocity(body, place)))

    def _arm(self, body: int, place: Vector) -> Vector:
        """From the centre of mass of the body's tree to a place."""
        x, y, z = self._centres[self._roots[body]]
        return minus(place, (x, y, z))


def _halves(spatial: list[float]) -> tuple[Vector, Vector]:
    """The angular and the linear part of a spatial vector."""
    a, b, c, d, e, f = spatial
    return (a, b, c), (d, e, f)
