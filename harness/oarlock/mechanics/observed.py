"""What an outside truth or a published value is about: one coordinate, or the place of one site."""

import mujoco
import numpy as np

from oarlock.base.errors import InputError, choose
from oarlock.mechanics.names import element_name

_SCALAR = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


class Observed:
    """Reads the coordinate of a hinge or slide (rad or m), or the place of a site (m, world frame).

    Args:
        model: the model.
        where: what names it, for the message of an error.
        joint: name of the joint, or None.
        site: name of the site, or None.

    Raises:
        InputError: the model has none of that name, or it is a ball or free joint.
    """

    def __init__(self, model: mujoco.MjModel, where: str, *, joint: str | None, site: str | None):
        self._site: int | None = None
        if site is not None:
            sites = [element_name(model, mujoco.mjtObj.mjOBJ_SITE, index) for index in range(model.nsite)]
            self._site = sites.index(choose(f"site in {where}", site, sites))
            return
        joints = [element_name(model, mujoco.mjtObj.mjOBJ_JOINT, index) for index in range(model.njnt)]
        index = joints.index(choose(f"joint in {where}", joint or "", joints))
        if mujoco.mjtJoint(model.jnt_type[index]) not in _SCALAR:
            raise InputError(f"joint in {where}: '{joint}' has several coordinates, expected a hinge or slide")
        self._qpos, self._qvel = int(model.jnt_qposadr[index]), int(model.jnt_dofadr[index])

    @property
    def address(self) -> tuple[str, int]:
        """``("qpos", entry of qpos)`` or ``("site", number of the site)``."""
        return ("qpos", self._qpos) if self._site is None else ("site", self._site)

    def position(self, data: mujoco.MjData) -> np.ndarray:
        """Returns the coordinate (1) or the place (3) at a state whose position stage is done."""
        if self._site is not None:
            return data.site_xpos[self._site]
        return data.qpos[self._qpos : self._qpos + 1]

    def velocity(self, data: mujoco.MjData) -> float:
        """Returns the velocity of the coordinate, rad/s or m/s."""
        return float(data.qvel[self._qvel])
