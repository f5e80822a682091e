"""A model reduced to its loops: what the kinematics of ``oarlock check`` are computed on.

MuJoCo leaves out an equality whose rows are zero throughout, so that the number of rows may change along a motion. Here
every active equality keeps its rows, in the order of the model; rows that MuJoCo leaves out are zero.
"""

import copy

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.text import quoted
from oarlock.cases.equality_kinds import unknown
from oarlock.mechanics.engine_version import SLEEP
from oarlock.mechanics.inequalities import IGNORED
from oarlock.mechanics.inertia import whiten
from oarlock.mechanics.load import collected_warnings
from oarlock.mechanics.names import Equality, equalities
from oarlock.mechanics.rows import closing_jacobian
from oarlock.poses.layout import Layout, RowColumns
from oarlock.stepping.closing import CONSISTENT, close, lacks_memory, require_memory


def anchors(model: mujoco.MjModel, data: mujoco.MjData, equality: Equality) -> tuple[np.ndarray, np.ndarray]:
    """The two points (3), world, of a connect or weld."""
    if equality.sites:
        first, second = (data.site_xpos[site].copy() for site in equality.sites)
        return first, second
    first, second = (
        data.xpos[body] + data.xmat[body].reshape(3, 3) @ equality.anchor(model, end)
        for end, body in enumerate(equality.bodies)
    )
    return first, second


class Assembly:
    """A copy of a model with a dense Jacobian, without contacts, limits and friction, and a data of its own.

    The Jacobian stays sparse where the model's memory does not hold a dense one.

    Attributes:
        equalities: the active ones.
        rows: theirs, n in all.
        starts: first row of each of ``equalities``.
        blocks: slices of rows that turn with the axes of the world: the three of a point, the three of a rotation, or
            one alone.

    Raises:
        InputError: an active equality of a kind whose rows are not known (flex), or the model's memory does not hold
            the rows.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData | None = None):
        self.model: mujoco.MjModel = copy.copy(model)
        self.model.opt.disableflags |= IGNORED
        self.model.opt.enableflags &= ~SLEEP  # a tree that sleeps has no rows
        self.data = self._with_room()
        if data is not None:
            self.data.qpos[:], self.data.qvel[:], self.data.eq_active[:] = data.qpos, data.qvel, data.eq_active
            self.data.mocap_pos[:], self.data.mocap_quat[:] = data.mocap_pos, data.mocap_quat
        off = model.opt.disableflags & (mujoco.mjtDisableBit.mjDSBL_EQUALITY | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        active = [] if off else [one for one in equalities(model) if self.data.eq_active[one.index]]
        for equality in active:
            if not equality.kind.known:
                raise unknown(equality.name, equality.kind)
        self.layout = Layout.of(self.model, np.zeros_like(self.data.eq_active) if off else self.data.eq_active)
        self._columns = RowColumns(self.layout)
        self.equalities = list(self.layout.equalities)
        self.rows = list(self.layout.named)
        self.starts = list(self.layout.starts)
        self.blocks: list[slice] = []
        for equality, start in zip(self.equalities, self.starts, strict=True):
            size = min(3, equality.rows)
            self.blocks += [slice(at, at + size) for at in range(start, start + equality.rows, size)]

    def _with_room(self) -> mujoco.MjData:
        """A data for a dense Jacobian; for a sparse one, if the model is so and has no memory for the other."""
        own = self.model.opt.jacobian
        sparse = bool(mujoco.mj_isSparse(self.model))
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        if not sparse:
            return mujoco.MjData(self.model)
        data = mujoco.MjData(self.model)
        with collected_warnings():
            mujoco.mj_fwdPosition(self.model, data)
            if lacks_memory(data):
                self.model.opt.jacobian, data = own, mujoco.MjData(self.model)
                mujoco.mj_fwdPosition(self.model, data)
                require_memory(self.model, data)
        return mujoco.MjData(self.model)

    def rows_of_all(self, numbers: list[int]) -> np.ndarray:
        """The rows of several of ``equalities``, one after the other."""
        every = np.arange(len(self.rows))
        return np.concatenate([every[:0], *(every[self.rows_of(number)] for number in numbers)])

    def rows_of(self, number: int) -> slice:
        """The rows of one of ``equalities``."""
        return self.layout.of_equality(number)

    def place(self, qpos: np.ndarray) -> None:
        """Goes to a pose (nq); its position stage is valid afterwards."""
        self.data.qpos[:] = qpos
        mujoco.mj_fwdPosition(self.model, self.data)

    def close(self) -> bool:
        """Closes the present pose, see ``closing.close``.

        Returns:
            Whether every row is closed, those that nothing moves too: to rounding, or to ``CONSISTENT`` where the
            lengths of an over-constrained mechanism admit no more.
        """
        close(self.model, self.data, None)
        return float(np.abs(self.residual()).max(initial=0.0)) <= CONSISTENT

    def difference(self, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """What leads from one pose (nq) to another, (nv), rad or m."""
        found = np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, found, 1.0, before, after)
        return found

    def at_rows(self) -> "slice | np.ndarray":
        """Where MuJoCo's present rows (ne) stand among ``rows``."""
        return self._columns.of(self.data)

    def residual(self) -> np.ndarray:
        """Deviations of all rows (n), m or rad."""
        found = self._fixed()
        found[self.at_rows()] = self.data.efc_pos[: self.data.ne]
        return found

    def require_finite(self) -> None:
        """Checks that all rows can be computed at the present pose.

        Raises:
            InputError: one cannot.
        """
        finite = np.isfinite(self.jacobian()).all(axis=1) & np.isfinite(self.residual())
        if not finite.all():
            bad = int(finite.argmin())
            name = self.equalities[int(np.searchsorted(self.starts, bad, side="right")) - 1].name
            raise InputError(
                f"equality {quoted(name)} has rows that are not finite at the start, expected finite numbers"
            )

    def _fixed(self) -> np.ndarray:
        """Deviations (n) of connects and of the points of welds that MuJoCo leaves out: no joint moves their ends."""
        found = np.zeros(len(self.rows))
        present = set(self.data.efc_id[: self.data.ne].tolist())
        for equality, start in zip(self.equalities, self.starts, strict=True):
            left_out = self.data.eq_active[equality.index] and equality.index not in present
            if left_out and equality.kind.joins_points:
                first, second = anchors(self.model, self.data, equality)
                found[start : start + 3] = first - second
        return found

    def jacobian(self) -> np.ndarray:
        """J of all rows (n, nv) at the present pose."""
        found = np.zeros((len(self.rows), self.model.nv))
        found[self.at_rows()] = closing_jacobian(self.model, self.data)
        return found

    def whitened(self, jacobian: np.ndarray) -> np.ndarray:
        """J Hᵀ (n, nv) with M⁻¹ = Hᵀ H: products of its rows are entries of J M⁻¹ Jᵀ."""
        return whiten(self.model, self.data, jacobian)

    def whitened_along(self, qpos: np.ndarray) -> np.ndarray:
        """The same of many poses (T, nq): (T, n, nv)."""
        found = np.zeros((len(qpos), len(self.rows), self.model.nv))
        for at, pose in enumerate(qpos):
            self.place(pose)
            found[at] = self.whitened(self.jacobian())
        return found
