"""Pictures by MuJoCo's own renderer, which needs a graphics library: with textures, skins and light."""

import copy
import math

import mujoco
import numpy as np

from oarlock.base.errors import InputError, one_line
from oarlock.base.shapes import rotated
from oarlock.viewer.show import Show

BACK = 10.0
"""Of the extent: how far the camera stands off, which a parallel projection does not show."""


class Rendering:
    """MuJoCo's renderer, looking at a show as its video does.

    Args:
        shown: what is looked at.
        width: of a picture; height: the same, pixels.
        high: of what a picture shows, m.

    Raises:
        InputError: there is no graphics library, or none that draws.
    """

    def __init__(self, shown: Show, width: int, height: int, high: float):
        model = self._model = copy.copy(shown.model)
        self._data = mujoco.MjData(model)
        mujoco.mj_fwdPosition(model, self._data)  # lights stay where they are in the model's own pose
        view = model.vis.global_
        view.offwidth, view.offheight = max(width, view.offwidth), max(height, view.offheight)
        view.orthographic, view.fovy = 1, high
        self._camera = mujoco.MjvCamera()
        mujoco.mjv_defaultFreeCamera(model, self._camera)
        x, y, z = (float(part) for part in -shown.towards)
        self._camera.lookat[:] = shown.centre
        self._camera.distance = BACK * shown.extent
        self._camera.azimuth, self._camera.elevation = math.degrees(math.atan2(y, x)), math.degrees(math.asin(z))
        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except Exception as error:  # what a graphics library raises is its own
            raise InputError(f"MuJoCo's renderer (MUJOCO_GL) does not draw: {one_line(error)[:120]}") from None

    def picture(self, poses: np.ndarray) -> np.ndarray:
        """Bodies at poses (nbody, 7), (height, width, 3), red, green and blue."""
        model, data = self._model, self._data
        own = poses[model.geom_bodyid]
        data.xpos[:], data.xquat[:] = poses[:, :3], poses[:, 3:]
        data.geom_xpos[:] = own[:, :3] + rotated(own[:, 3:], model.geom_pos)
        axes = [rotated(own[:, 3:], rotated(model.geom_quat, axis)) for axis in np.eye(3)]
        data.geom_xmat[:] = np.stack(axes, axis=2).reshape(-1, 9)
        self._renderer.update_scene(data, self._camera)
        return self._renderer.render()
