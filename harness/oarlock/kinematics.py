"""Motion of points of bodies at a state whose position and velocity stages are done: place, velocity, J̇v."""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.vectors import Vector, cross, minus, plus, times


@dataclass(frozen=True)
class Point:
    """A point fixed on a body: a site, or an offset in the body's own frame, m."""

    body: int
    site: int | None
    offset: np.ndarray

    def place(self, data: mujoco.MjData) -> np.ndarray:
        """In world coordinates, (3), m."""
        if self.site is not None:
            return data.site_xpos[self.site]
        return data.xpos[self.body] + times(data.xmat[self.body].reshape(3, 3), self.offset)


class Kinematics:
    """Velocities and accelerations of points that are, at this moment, at given places on bodies.

    Accelerations are those that need no acceleration of the coordinates, J̇v with the Jacobian J of the point or of
    the body's rotation: ``mj_jacDot`` gives J̇ exactly.
    """

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        self._roots = model.body_rootid.tolist()
        self._linear, self._angular = np.zeros((2, 3, model.nv)), np.zeros((2, 3, model.nv))

    def spin(self, data: mujoco.MjData, body: int) -> Vector:
        """Angular velocity of a body, world axes, rad/s."""
        x, y, z, *_ = data.cvel[body].tolist()
        return x, y, z

    def velocity(self, data: mujoco.MjData, body: int, place: Vector) -> Vector:
        """Velocity of the body's point at a place, m/s."""
        # cvel is the velocity at the centre of mass of the kinematic tree.
        spin_x, spin_y, spin_z, x, y, z = data.cvel[body].tolist()
        arm = minus(place, data.subtree_com[self._roots[body]].tolist())
        return plus((x, y, z), cross((spin_x, spin_y, spin_z), arm))

    def bend(self, data: mujoco.MjData, body: int, place: np.ndarray) -> Vector:
        """J̇v of the body's point at a place (3), m/s²."""
        linear = self._linear[0]
        mujoco.mj_jacDot(self._model, data, linear, None, place, body)
        x, y, z = times(linear, data.qvel).tolist()
        return x, y, z

    def points_apart(self, data: mujoco.MjData, ends: tuple[Point, Point], out: np.ndarray) -> None:
        """Writes J̇ of p₁ − p₂, (3, nv)."""
        linear1, linear2 = self._linear
        mujoco.mj_jacDot(self._model, data, linear1, None, ends[0].place(data), ends[0].body)
        mujoco.mj_jacDot(self._model, data, linear2, None, ends[1].place(data), ends[1].body)
        # The difference before the product with v: a point and one that moves with it leave exactly nothing.
        np.subtract(linear1, linear2, out)

    def bodies_apart(self, data: mujoco.MjData, ends: tuple[Point, Point], out: np.ndarray) -> None:
        """Writes J̇ of p₁ − p₂ and of ω₁ − ω₂, (6, nv)."""
        for end, linear, angular in zip(ends, self._linear, self._angular, strict=True):
            mujoco.mj_jacDot(self._model, data, linear, angular, end.place(data), end.body)
        np.subtract(self._linear[0], self._linear[1], out[:3])
        np.subtract(self._angular[0], self._angular[1], out[3:])
