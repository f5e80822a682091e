"""J̇v: the part of the constraints' acceleration that needs no acceleration of the coordinates.

For a connect the rows are p₁ − p₂, so J̇v = (J̇₁ − J̇₂) v with the time derivative of each anchor's Jacobian, which
``mj_jacDot`` gives exactly.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.errors import InputError
from oarlock.mechanism import Equality, equalities

_CONNECT_ROWS = 3


@dataclass(frozen=True)
class _Anchor:
    """One end of a connect: a site, or a point of a body in its own frame."""

    body: int
    site: int | None
    offset: np.ndarray

    def point(self, data: mujoco.MjData) -> np.ndarray:
        """In world coordinates, m."""
        if self.site is not None:
            return data.site_xpos[self.site]
        return data.xpos[self.body] + data.xmat[self.body].reshape(3, 3) @ self.offset


def _anchors(model: mujoco.MjModel, equality: Equality) -> tuple[_Anchor, _Anchor]:
    index = equality.index
    by_site = model.eq_objtype[index] == mujoco.mjtObj.mjOBJ_SITE
    sites = (int(model.eq_obj1id[index]), int(model.eq_obj2id[index])) if by_site else (None, None)
    first, second = (
        _Anchor(body, site, model.eq_data[index, 3 * end : 3 * end + 3].copy())
        for end, (body, site) in enumerate(zip(equality.bodies, sites, strict=True))
    )
    return first, second


class Curvature:
    """J̇v of the active rows. Only connects are known so far.

    Raises:
        InputError: an active equality of another kind.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData):
        self._model = model
        self._rates = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        active = [equality for equality in equalities(model) if data.eq_active[equality.index]]
        for equality in active:
            if equality.kind != "connect":
                raise InputError(
                    f"equality '{equality.name}' is a {equality.kind}, expected connects only: "
                    "J̇v of other kinds is not known yet"
                )
        self._anchors = {equality.index: _anchors(model, equality) for equality in active}

    def write(self, data: mujoco.MjData, out: np.ndarray) -> None:
        """Writes J̇v (ne, m/s²) of a state whose position and velocity stages are done."""
        rate1, rate2 = self._rates
        for start in range(0, data.ne, _CONNECT_ROWS):
            anchor1, anchor2 = self._anchors[int(data.efc_id[start])]
            mujoco.mj_jacDot(self._model, data, rate1, None, anchor1.point(data), anchor1.body)
            mujoco.mj_jacDot(self._model, data, rate2, None, anchor2.point(data), anchor2.body)
            np.matmul(rate1 - rate2, data.qvel, out=out[start : start + _CONNECT_ROWS])


def curvature_from_reference(data: mujoco.MjData) -> np.ndarray:
    """J̇v (ne) recovered from MuJoCo's own reference acceleration, aref = −B Jv − K d r − J̇v.

    Right for connects and welds since MuJoCo 3.7; MuJoCo leaves the term out for joint and tendon equalities. Used to
    check ``Curvature``, not in its place.
    """
    ne = data.ne
    stiffness, damping, impedance, _ = data.efc_KBIP[:ne].T
    return -damping * data.efc_vel[:ne] - stiffness * impedance * data.efc_pos[:ne] - data.efc_aref[:ne]
