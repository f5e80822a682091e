"""Mocap bodies that move, as the exact solution takes them: rows r(q, t) = 0 that depend on the time.

To MuJoCo a mocap body stands still during a step, and jumps between steps; its rows have no part of the body's motion.
The exact solution is that of a body that goes along its law: ṙ = J v + ∂r/∂t = 0 and r̈ = J a + J̇v + 2 ∂J/∂t v +
∂²r/∂t² = 0. What is added to J v and J̇v comes from differences: r at q(s) = q ⊕ s v and the poses of t + s, for four
times s about 0 (Fornberg 1988, Generation of finite difference formulas on arbitrarily spaced grids).
"""

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.mechanics.drive import Drive
from oarlock.mechanics.mocap import moved_equalities
from oarlock.mechanics.names import element_name

SPAN_MIN_S, SPAN_MAX_S = 1e-4, 1e-3
"""Bounds of the time between poses whose rows are compared, else a timestep: of a shorter one rounding would be seen in
r̈ (1e-7 m/s²), of a longer one what the law does meanwhile."""

_AT = (-2.0, -1.0, 0.0, 1.0, 2.0)
_FIRST = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
_SECOND = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12.0


class Moving:
    """What the motion of mocap bodies adds to the rows of a state.

    Args:
        model: the model.
        drive: made for it, or for a copy.

    Attributes:
        refusal: why there is no exact solution; empty if there is one.
    """

    def __init__(self, model: mujoco.MjModel, drive: Drive):
        self._model, self._drive = model, drive
        bodies = {law.body: law.name for law in drive.mocaps}
        self.refusal = ""
        for joint, body in enumerate(model.body_rootid[model.jnt_bodyid].tolist()):
            if body in bodies:
                name = element_name(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
                self.refusal = (
                    f"joint '{name}' hangs on the mocap body '{bodies[body]}', and MuJoCo's inertial forces leave out "
                    "how that moves: no exact solution, expected an equality in place of the joint"
                )
        self._rows_of = np.array(moved_equalities(model, bodies), int)
        self._scratch = mujoco.MjData(model)
        self._span = min(max(float(model.opt.timestep), SPAN_MIN_S), SPAN_MAX_S)
        self._began = 0.0

    @classmethod
    def of(cls, model: mujoco.MjModel, drive: Drive) -> "Moving | None":
        """None where no mocap body is given a law."""
        return cls(model, drive) if drive.mocaps else None

    def begin(self, data: mujoco.MjData) -> None:
        """Begins a step at ``data.time``, unless that is within a whole one."""
        if self._drive.begins_step(data.time):
            self._began = data.time

    def place(self, data: mujoco.MjData) -> None:
        """Moves the bodies to where they are at ``data.time``, a time of the step that was begun."""
        self._write(data, data.time)

    def rate(self, data: mujoco.MjData) -> np.ndarray:
        """∂r/∂t (ne), m/s or rad/s, of a state whose position stage is done."""
        return _FIRST @ self._rows(data, moves=False) / self._span

    def read(self, data: mujoco.MjData, curvature: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """∂r/∂t, m/s or rad/s, and 2 ∂J/∂t v + ∂²r/∂t², per s² (ne), of a state whose velocity stage is done.

        Args:
            data: the state.
            curvature: J̇v (ne).
        """
        rows, moved = self._rows(data, moves=True), self._moved(data)
        first, second = _FIRST @ rows / self._span, _SECOND @ rows / self._span**2
        return np.where(moved, first - data.efc_vel[: data.ne], 0.0), np.where(moved, second - curvature, 0.0)

    def _moved(self, data: mujoco.MjData) -> np.ndarray:
        return np.isin(data.efc_id[: data.ne], self._rows_of)

    def _rows(self, data: mujoco.MjData, *, moves: bool) -> np.ndarray:
        """Rows (5, ne) at the times about ``data.time``, those of other equalities zero; as the state moves, or not."""
        model, scratch, moved = self._model, self._scratch, self._moved(data)
        found = np.zeros((len(_AT), data.ne))
        if not moved.any():
            return found
        scratch.eq_active[:], scratch.mocap_pos[:], scratch.mocap_quat[:] = (
            data.eq_active,
            data.mocap_pos,
            data.mocap_quat,
        )
        for place, part in enumerate(_AT):
            scratch.qpos[:] = data.qpos
            if moves:
                mujoco.mj_integratePos(model, scratch.qpos, data.qvel, part * self._span)
            self._write(scratch, data.time + part * self._span)
            mujoco.mj_kinematics(model, scratch)
            mujoco.mj_comPos(model, scratch)
            mujoco.mj_tendon(model, scratch)
            mujoco.mj_makeConstraint(model, scratch)
            if not np.array_equal(scratch.efc_id[: scratch.ne], data.efc_id[: data.ne]):
                raise InputError(
                    f"the equality rows change as a mocap body moves at t = {data.time:g} s, expected the same ones"
                )
            found[place, moved] = scratch.efc_pos[: data.ne][moved]
        return found

    def _write(self, data: mujoco.MjData, time: float) -> None:
        for law in self._drive.mocaps:
            data.mocap_pos[law.mocap], data.mocap_quat[law.mocap] = law.along(time, self._began)
