"""Limits, friction loss and contacts of a state, and the forces that they answer with beside the equality rows.

Their forces are found first, with the loops as the form of the question has them; the equality rows are then asked
with those forces as smooth ones. Whoever solves for the multipliers answers the question that it would answer without.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base import core
from oarlock.base.vectors import times
from oarlock.mechanics.inequalities import ELLIPTIC, KINDS, PYRAMIDAL
from oarlock.mechanics.inertia import whiten
from oarlock.mechanics.rows import jacobian

COEFFICIENTS = 5
"""Friction coefficients of a contact: two tangential, one torsional, two rolling."""


Push = tuple[core.InequalityReport, core.Certificate | None]
"""What the answer to such rows took, and what proves it."""


@dataclass(frozen=True)
class Loads:
    """Largest forces of the rows of one state.

    Attributes:
        limit: of a limit, N or N m.
        friction: of friction loss, N or N m.
        contact: of all contacts along their normals, together, N.
    """

    limit: float
    friction: float
    contact: float


class Rows:
    """The rows of limits, friction loss and contacts of one state, whose velocity stage is done.

    Attributes:
        jacobian: J (m, nv).
        aref: accelerations that MuJoCo asks of them, (m).
        stiffness: D = 1/R (m).
        friction_loss: largest forces of rows of friction loss, (m).
        dims: what the rows are, in their order: 0 of friction loss, 1 of a limit, a frictionless contact or an edge of
            a pyramid, 3, 4 or 6 the rows of an elliptic contact.
        mu: μ of the regularised cone of each of ``dims``; friction: its coefficients, five each.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData):
        ne, nefc = data.ne, data.nefc
        self.jacobian = jacobian(model, data)[ne:]
        self.aref = data.efc_aref[ne:nefc]
        self.stiffness = data.efc_D[ne:nefc]
        self.friction_loss = data.efc_frictionloss[ne:nefc]
        self.dims: list[int] = []
        self._kinds = data.efc_type[ne:nefc].tolist()
        self._pos = data.efc_pos[ne:nefc].copy()
        self._owners = data.efc_id[ne:nefc].tolist()
        mu, friction, row = [], [], 0
        while row < len(self._kinds):
            kind = self._kinds[row]
            if kind == ELLIPTIC:
                contact = data.contact[self._owners[row]]
                self.dims.append(contact.dim)
                mu.append(contact.mu)
                friction.append(contact.friction.copy())
            else:
                self.dims.append(0 if KINDS[kind] == "friction" else 1)
                mu.append(0.0)
                friction.append(np.zeros(COEFFICIENTS))
            row += max(self.dims[-1], 1)
        self.mu = np.array(mu)
        self.friction = np.array(friction).reshape(-1, COEFFICIENTS)

    def __len__(self) -> int:
        return len(self._kinds)

    def held(self) -> np.ndarray:
        """Rows (k, nv) of the limits that are violated and the normals of the contacts that penetrate."""
        found, row = [], 0
        for dim in self.dims:
            kind, owner = self._kinds[row], self._owners[row]
            again = row > 0 and (self._kinds[row - 1], self._owners[row - 1]) == (kind, owner)
            if KINDS[kind] != "friction" and self._pos[row] < 0.0 and not again:
                first = self.jacobian[row]
                # Edges of a pyramid come in pairs, n ± μt.
                found.append(0.5 * (first + self.jacobian[row + 1]) if kind == PYRAMIDAL else first)
            row += max(dim, 1)
        return np.array(found).reshape(-1, self.jacobian.shape[1])

    def loads(self, forces: np.ndarray) -> Loads:
        """How large some forces (m) of the rows are."""
        limit = friction = contact = 0.0
        row = 0
        for dim in self.dims:
            force, kind = abs(float(forces[row])), self._kinds[row]
            if KINDS[kind] == "friction":
                friction = max(friction, force)
            elif KINDS[kind] == "limit":
                limit = max(limit, force)
            else:  # the first row of a cone is its normal; edges of a pyramid add up to the normal force
                contact += force
            row += max(dim, 1)
        return Loads(limit, friction, contact)


class Inequalities:
    """Answers the rows of one state after another, in one form and beside one system of equality rows.

    Attributes:
        report: figures of the last answer; None of a state without such rows.
        certificate: what proves it, once there is an acceleration.
        forces: of its rows, (m).
    """

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        self._solver = core.Inequalities()
        self._change = np.zeros((1, model.nv))
        self._rows: Rows | None = None
        self._last: np.ndarray | None = None
        self.report: core.InequalityReport | None = None
        self.certificate: core.Certificate | None = None
        self.forces = np.zeros(0)

    def answer(
        self, data: mujoco.MjData, rows: Rows | None, system: core.ConstrainedSystem, aref: np.ndarray
    ) -> np.ndarray:
        """Finds the forces of the rows beside an assembled ``system``, and asks the system anew with them.

        Args:
            data: the state.
            rows: its limits, friction loss and contacts; None if there are none.
            system: its equality rows.
            aref: accelerations that are asked of those, (ne).

        Returns:
            The smooth acceleration (nv) with the forces among the smooth ones.
        """
        self.report = self.certificate = None
        self._rows, self.forces = rows, np.zeros(0)
        if rows is None:
            return data.qacc_smooth
        self.report = self._solver.solve(
            system,
            whiten(self._model, data, rows.jacobian),
            rows.jacobian,
            rows.aref,
            rows.stiffness,
            rows.friction_loss,
            rows.dims,
            rows.mu,
            rows.friction,
            self._last,
        )
        mujoco.mj_solveM(self._model, data, self._change, self._solver.generalised_force[None])
        unconstrained = data.qacc_smooth + self._change[0]
        system.renew(unconstrained, aref)
        self.forces = self._solver.forces
        return unconstrained

    def conclude(self, qacc: np.ndarray, qfrc: np.ndarray) -> tuple[np.ndarray, bool]:
        """Adds the forces of the rows to a constraint force (nv), and proves them by the acceleration (nv) of both.

        Returns:
            The whole constraint force (nv), and whether the forces are proved.
        """
        if self.report is None or self._rows is None:
            return qfrc, True
        qfrc = qfrc + self._solver.generalised_force
        if not np.isfinite(times(self._rows.jacobian, qacc)).all():
            return qfrc, False
        self.certificate = self._solver.certify(qacc, self.forces)
        return qfrc, self.report.status == "converged" and self.certificate.holds

    @property
    def pushes(self) -> list[Push]:
        """What the last answer took, of a state with such rows."""
        return [] if self.report is None else [(self.report, self.certificate)]

    def remember(self, qacc: np.ndarray) -> None:
        """Begins the next answer at an acceleration (nv) near it, that of this step."""
        self._last = qacc.copy() if np.isfinite(qacc).all() else None
