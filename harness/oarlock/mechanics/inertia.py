"""Systems assembled through MuJoCo's own factor of M, which is sparse: M⁻¹ = Hᵀ H with H = D^(−1/2) L^(−T)."""

import mujoco
import numpy as np

from oarlock.base.core import ConstrainedSystem
from oarlock.mechanics.engine_version import mass_tree
from oarlock.mechanics.rows import compressed


def whiten(model: mujoco.MjModel, data: mujoco.MjData, rows: np.ndarray) -> np.ndarray:
    """Multiplies rows (n, nv) by Hᵀ, so that products of the results (n, nv) are entries of rows · M⁻¹ · rowsᵀ.

    The position stage of ``data`` must be valid. Rows of the identity give Hᵀ itself.
    """
    found = np.empty(rows.shape)
    if len(rows):
        mujoco.mj_solveM2(model, data, found, rows, np.sqrt(data.qLDiagInv))
    return found


SMALL = 8
"""Up to as many velocities rows are handed over dense, which costs less than their pattern does."""

_ANGULAR = {
    int(mujoco.mjtJoint.mjJNT_FREE): (3, 6),
    int(mujoco.mjtJoint.mjJNT_BALL): (0, 3),
    int(mujoco.mjtJoint.mjJNT_HINGE): (0, 1),
}
"""Kind of joint → which of its velocities are angular."""


class Inertia:
    """Assembles systems of one model's states, and goes the way back from their multipliers.

    Attributes:
        system: as it was last assembled.
    """

    def __init__(self, model: mujoco.MjModel):
        self.system = ConstrainedSystem()
        self._model = model
        self._unconstrained = np.zeros(model.nv)
        self._change = np.zeros((1, model.nv))
        self._turns = np.zeros(model.nv, dtype=bool)
        for kind, first in zip(model.jnt_type.tolist(), model.jnt_dofadr.tolist(), strict=True):
            start, end = _ANGULAR.get(kind, (0, 0))
            self._turns[first + start : first + end] = True

    def assemble(
        self,
        data: mujoco.MjData,
        jacobian: np.ndarray,
        unconstrained: np.ndarray,
        aref: np.ndarray,
        softness: np.ndarray | None,
    ) -> None:
        """Forms A and b from J (n, nv), a₀ = M⁻¹ f (nv), aref (n) and R (n); the position stage must be valid.

        Raises:
            InputError: no rows, or numbers that are not finite.
        """
        model = self._model
        if model.nv <= SMALL and not mujoco.mj_isSparse(model):
            self.system.assemble_factored(whiten(model, data, jacobian), jacobian, unconstrained, aref, softness)
        else:
            tree = mass_tree(model, data)
            rows = compressed(data, len(aref)) if mujoco.mj_isSparse(model) else jacobian
            self.system.assemble_sparse(rows, tree, unconstrained, aref, softness)
        self._unconstrained[:] = unconstrained

    def start_from(self, unconstrained: np.ndarray) -> None:
        """Takes another a₀ (nv) for the way back from multipliers, that with which the system was asked anew."""
        self._unconstrained[:] = unconstrained

    def hold_rank(self, data: mujoco.MjData, jacobian: np.ndarray) -> None:
        """Asks to hold the rank of the equality rows J (ne, nv) in the next ``assemble``, along the path of a state.

        A row of a connect tilts by its gap over the longest lever of a joint that moves it, a rotation by its gap. Rows
        of joint equalities do not turn.
        """
        owners = data.efc_id[: data.ne]
        gaps = np.abs(data.efc_pos[: data.ne])
        levers = np.abs(jacobian[:, self._turns]).max(axis=1, initial=0.0)
        kinds = self._model.eq_type[owners]
        _, begins, of = np.unique(owners, return_index=True, return_inverse=True)
        # Of a weld the rotation comes after the three rows of its point.
        moved = (kinds != mujoco.mjtEq.mjEQ_WELD) | (np.arange(len(owners)) - begins[of] < 3)
        lengths = np.zeros(len(begins))
        np.maximum.at(lengths, of[moved], levers[moved])
        length = np.where(kinds == mujoco.mjtEq.mjEQ_JOINT, 0.0, lengths[of])
        gaps[moved & (length == 0.0)] = 0.0
        turned = moved & (length > 0.0)
        gaps[turned] /= length[turned]
        self.system.hold_rank(gaps, owners.tolist())

    def acceleration(self, data: mujoco.MjData, multipliers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Acceleration a₀ + M⁻¹ Jᵀ λ and constraint force Jᵀ λ, both (nv), of multipliers λ (n)."""
        qfrc = self.system.force(multipliers)
        mujoco.mj_solveM(self._model, data, self._change, qfrc[None])
        return self._unconstrained + self._change[0], qfrc
