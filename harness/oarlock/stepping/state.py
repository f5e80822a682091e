"""What one state says: J, the smooth acceleration, and the constraint rows, straight from MuJoCo's arrays."""

import mujoco
import numpy as np

from oarlock.cases.case_file import Baumgarte, Form
from oarlock.mechanics.curvature import Curvature
from oarlock.mechanics.inequalities import refuse_inequalities
from oarlock.mechanics.rows import jacobian


class State:
    """J and the rows of a state whose smooth stages are done.

    ``read`` refreshes the fields. All but ``curvature`` alias MuJoCo's arrays: they hold until the next stage call.

    Attributes:
        jacobian: J, (ne, nv).
        unconstrained: M⁻¹ f, (nv), f = passive + applied + actuator − bias.
        residual: r, (ne), m or rad.
        rate: J v, (ne).
        curvature: J̇ v, (ne).
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, baumgarte: Baumgarte):
        self.model, self.data = model, data
        self._curvature = Curvature(model, data)
        self._beta2, self._k = 2.0 * baumgarte.beta, baumgarte.k

    def read(self) -> None:
        """Takes the fields from the data.

        Raises:
            InputError: rows other than equality rows are active.
        """
        data = self.data
        refuse_inequalities(self.model, data)
        self.jacobian = jacobian(self.model, data)
        self.unconstrained = data.qacc_smooth
        self.residual = data.efc_pos
        self.rate = data.efc_vel
        self.curvature = np.empty(data.ne)
        self._curvature.write(data, self.curvature)

    def question(self, form: Form) -> tuple[np.ndarray, np.ndarray | None]:
        """The accelerations asked of the rows, aref (ne), and their softness, R (ne) or None.

        matched: MuJoCo's own aref and R. hard: aref = −J̇v − 2β Jv − k r and R = 0 (Baumgarte 1972).
        """
        if form == "matched":
            return self.data.efc_aref, self.data.efc_R
        return -self.curvature - self._beta2 * self.rate - self._k * self.residual, None
