"""J̇v: the part of the constraints' acceleration that needs no acceleration of the coordinates.

For a connect the rows are p₁ − p₂, so J̇v = (J̇₁ − J̇₂) v with the time derivative of each anchor's Jacobian, which
``mj_jacDot`` gives exactly.
"""

import mujoco
import numpy as np

from oarlock.errors import InputError
from oarlock.mechanism import equalities

_CONNECT_ROWS = 3


class Curvature:
    """J̇v of the active rows. Only connects are known so far.

    Raises:
        InputError: an active equality of another kind.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData):
        self._model = model
        self._rate1 = np.zeros((3, model.nv))
        self._rate2 = np.zeros((3, model.nv))
        other = [e for e in equalities(model) if e.kind != "connect" and data.eq_active[e.index]]
        if other:
            raise InputError(
                f"equality '{other[0].name}' is a {other[0].kind}, expected connects only: "
                "J̇v of other kinds is not known yet"
            )
        self._anchors = [self._anchor_pair(e.index, e.bodies) for e in equalities(model)]
        self._order: bytes | None = None
        self._blocks: list[int] = []

    def _anchor_pair(self, index: int, bodies: tuple[int, int]):
        model = self._model
        if model.eq_objtype[index] == mujoco.mjtObj.mjOBJ_SITE:
            sites = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
            return bodies, sites, None
        return bodies, None, (model.eq_data[index, 0:3].copy(), model.eq_data[index, 3:6].copy())

    def write(self, data: mujoco.MjData, out: np.ndarray) -> None:
        """Writes J̇v (ne, m/s²) of a state whose position and velocity stages are done."""
        ids = data.efc_id[: data.ne]
        if ids.tobytes() != self._order:
            self._order = ids.tobytes()
            self._blocks = [int(i) for i in ids[::_CONNECT_ROWS]]
        for block, index in enumerate(self._blocks):
            (body1, body2), sites, offsets = self._anchors[index]
            if sites is not None:
                point1, point2 = data.site_xpos[sites[0]], data.site_xpos[sites[1]]
            else:
                point1 = data.xpos[body1] + data.xmat[body1].reshape(3, 3) @ offsets[0]
                point2 = data.xpos[body2] + data.xmat[body2].reshape(3, 3) @ offsets[1]
            mujoco.mj_jacDot(self._model, data, self._rate1, None, point1, body1)
            mujoco.mj_jacDot(self._model, data, self._rate2, None, point2, body2)
            start = _CONNECT_ROWS * block
            np.matmul(self._rate1 - self._rate2, data.qvel, out=out[start : start + _CONNECT_ROWS])


def curvature_from_reference(data: mujoco.MjData) -> np.ndarray:
    """J̇v (ne) recovered from MuJoCo's own reference acceleration, aref = −B Jv − K d r − J̇v.

    Right for connects and welds since MuJoCo 3.7; MuJoCo leaves the term out for joint and tendon equalities. Used to
    check ``Curvature``, not in its place.
    """
    ne = data.ne
    stiffness, damping, impedance, _ = data.efc_KBIP[:ne].T
    return -damping * data.efc_vel[:ne] - stiffness * impedance * data.efc_pos[:ne] - data.efc_aref[:ne]
