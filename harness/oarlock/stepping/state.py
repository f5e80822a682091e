"""The inputs of the constraint problem at one state, read from MuJoCo's arrays: J, M⁻¹ f and the constraint rows."""

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.cases.case_file import Baumgarte, Form
from oarlock.mechanics.curvature import Curvature
from oarlock.mechanics.rows import closing_jacobian
from oarlock.stepping.inequalities import Rows
from oarlock.stepping.moving import Moving

STILL = 1e-9
"""rad or m. Coordinates that change by less over a run do not move: the digits of a file, and rounding."""


class State:
    """J and the constraint rows of a state whose smooth stages are done.

    ``read`` refreshes the fields. All but ``curvature``, and ``rate`` where something moves, are views of MuJoCo's
    arrays, which hold until the next stage.

    Attributes:
        model: the model.
        data: the state.
        jacobian: J (ne, nv).
        unconstrained: accelerations without constraints, M⁻¹ f (nv), with f = passive + applied + actuator − bias.
        residual: deviations of the rows, r (ne), m or rad.
        rate: ṙ = J v + ∂r/∂t (ne), m/s or rad/s; the second part is that of mocap bodies that move.
        curvature: r̈ − J a = J̇v + 2 ∂J/∂t v + ∂²r/∂t² (ne), m/s² or rad/s².
        others: rows of limits, friction loss and contacts; None if there are none.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, baumgarte: Baumgarte, moving: Moving | None = None):
        self.model, self.data, self.moving = model, data, moving
        self._curvature = Curvature(model, data)
        self._beta2, self._k = 2.0 * baumgarte.beta, baumgarte.k

    def read(self) -> None:
        """Reads the fields from the data."""
        data = self.data
        self.jacobian = closing_jacobian(self.model, data)
        self.unconstrained = data.qacc_smooth
        self.residual = data.efc_pos[: data.ne]
        self.rate = data.efc_vel[: data.ne]
        self.curvature = np.empty(data.ne)
        self._curvature.write(data, self.curvature)
        if self.moving is not None:
            rate, curvature = self.moving.read(data, self.curvature)
            self.rate, self.curvature = self.rate + rate, self.curvature + curvature
        self.others = Rows(self.model, data) if data.nefc > data.ne else None

    def question(self, form: Form) -> tuple[np.ndarray, np.ndarray | None]:
        """Returns the accelerations asked of the rows, aref (ne), and their softness R (ne), None for R = 0.

        ``matched`` takes MuJoCo's own aref and R, to which mocap bodies stand still; ``hard`` aref = −(r̈ − J a) − 2β ṙ
        − k r and R = 0 (Baumgarte 1972).
        """
        if form == "matched":
            ne = self.data.ne
            return self.data.efc_aref[:ne], self.data.efc_R[:ne]
        if self.moving is not None and self.moving.refusal:
            raise InputError(self.moving.refusal)
        return -self.curvature - self._beta2 * self.rate - self._k * self.residual, None
