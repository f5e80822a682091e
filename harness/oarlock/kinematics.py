"""Motion of points of bodies at a state whose position and velocity stages are done: place, velocity, J̇v."""

from dataclasses import dataclass

import mujoco
import numpy as np


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
        return data.xpos[self.body] + data.xmat[self.body].reshape(3, 3) @ self.offset


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The product a × b of two vectors (3); many times faster than NumPy's."""
    product = np.zeros(3)
    mujoco.mju_cross(product, a, b)
    return product


class Kinematics:
    """Velocities and accelerations of points that are, at this moment, at given places on bodies.

    Accelerations are those that need no acceleration of the coordinates, J̇v with the Jacobian J of the point or of
    the body's rotation: ``mj_jacDot`` gives J̇ exactly.
    """

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        self._linear, self._angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        self._linear2 = np.zeros((3, model.nv))

    def spin(self, data: mujoco.MjData, body: int) -> np.ndarray:
        """Angular velocity of a body, world axes, (3), rad/s."""
        return data.cvel[body, :3]

    def velocity(self, data: mujoco.MjData, body: int, place: np.ndarray) -> np.ndarray:
        """Velocity of the body's point at a place, (3), m/s."""
        # cvel is the velocity at the centre of mass of the kinematic tree.
        arm = place - data.subtree_com[self._model.body_rootid[body]]
        return data.cvel[body, 3:] + cross(data.cvel[body, :3], arm)

    def bend(self, data: mujoco.MjData, body: int, place: np.ndarray) -> np.ndarray:
        """J̇v of the body's point at a place, (3), m/s²."""
        mujoco.mj_jacDot(self._model, data, self._linear, None, place, body)
        return self._linear @ data.qvel

    def bend_apart(self, data: mujoco.MjData, end1: Point, end2: Point, out: np.ndarray) -> None:
        """Writes J̇v of p₁ − p₂, (3), m/s²."""
        mujoco.mj_jacDot(self._model, data, self._linear, None, end1.place(data), end1.body)
        mujoco.mj_jacDot(self._model, data, self._linear2, None, end2.place(data), end2.body)
        # The difference first: a point and one that moves with it leave exactly nothing.
        np.matmul(self._linear - self._linear2, data.qvel, out=out)

    def bends(self, data: mujoco.MjData, body: int, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """J̇v of the body's point at a place, (3), m/s², and of the body's rotation, (3), rad/s²."""
        mujoco.mj_jacDot(self._model, data, self._linear, self._angular, place, body)
        return self._linear @ data.qvel, self._angular @ data.qvel
