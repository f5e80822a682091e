"""Forces of a free run, by the laws that joints and simple actuators of a compiled model have."""

from collections.abc import Iterator

import numpy as np
from shared.compiled import HINGE, SLIDE, Compiled

_SPRING, _DAMPER, _CLAMP, _ACTUATION = 32, 64, 256, 2048
"""Members of mjtDisableBit."""

_ON_JOINT = 0
"""Member of mjtTrn."""

_FIXED, _AFFINE = 0, 1
"""Members of mjtGain, and of mjtBias, where 0 is no bias."""


class Controls:
    """Controls of a run: those of the first state, held, or straight from row to row as long as the time goes on."""

    def __init__(self, states: dict[str, np.ndarray]):
        times = states["time"]
        back = np.flatnonzero(np.diff(times) <= 0.0)
        count = int(back[0]) + 1 if len(back) else len(times)
        self._times, self._values = times[:count], states["ctrl"][:count]

    def __call__(self, time: float) -> np.ndarray:
        """Those of a time (s)."""
        return np.array([np.interp(time, self._times, column) for column in self._values.T])


class Laws:
    """Springs and dampers of hinges and slides, and actuators without dynamics that act on them.

    Args:
        compiled: the model.
        controls: of a run.
    """

    def __init__(self, compiled: Compiled, controls: Controls):
        self._compiled, self._controls = compiled, controls
        flags = int(compiled.opt_disableflags)
        single = np.isin(compiled.jnt_type, (SLIDE, HINGE))
        self._joints = np.flatnonzero(single)
        self._at, self._dofs = compiled.jnt_qposadr[single], compiled.jnt_dofadr[single]
        self._stiffness = compiled.jnt_stiffness.reshape(len(single), -1)[single, 0] * (not flags & _SPRING)
        self._damping = compiled.dof_damping.reshape(int(compiled.nv), -1)[:, 0] * (not flags & _DAMPER)
        self._rest = compiled.qpos_spring[self._at]
        self._clamps = not flags & _CLAMP
        self._actuators = range(0 if flags & _ACTUATION else compiled.size("nu"))

    def foreign(self) -> Iterator[tuple[str, str]]:
        """Yields what else exerts forces, each with why it is left out."""
        compiled = self._compiled
        for joint, kind in enumerate(compiled.jnt_type.tolist()):
            if kind not in (SLIDE, HINGE) and compiled.jnt_stiffness.reshape(len(compiled.jnt_type), -1)[joint].any():
                yield compiled.called("joint", joint), "a spring of a ball or free joint, in a free run"
        for name, sort in (
            ("jnt_stiffnesspoly", "joint"),
            ("tendon_stiffness", "tendon"),
            ("tendon_damping", "tendon"),
        ):
            found = compiled.get(name)
            found = found.reshape(len(found), -1).any(axis=1) if found.size else found
            for index in np.flatnonzero(found).tolist():
                yield compiled.called(sort, index), "its spring or damper, in a free run"
        for dof in np.flatnonzero(compiled.get("dof_dampingpoly").reshape(int(compiled.nv), -1).any(axis=1)).tolist():
            yield compiled.called("joint", int(compiled.dof_jntid[dof])), "a damper that is not linear, in a free run"
        for body in np.flatnonzero(compiled.get("body_gravcomp")).tolist():
            yield compiled.called("body", body), "gravity compensation, in a free run"
        if float(compiled.opt_density) or float(compiled.opt_viscosity):
            yield "option", "a fluid, in a free run"
        for actuator in self._actuators:
            if not self._simple(actuator):
                yield (
                    compiled.called("actuator", actuator),
                    "no fixed or affine force on a hinge or slide, in a free run",
                )

    def _simple(self, actuator: int) -> bool:
        compiled = self._compiled
        if compiled.actuator_trntype[actuator] != _ON_JOINT or compiled.size("nactuator") not in (
            0,
            compiled.size("nu"),
        ):
            return False
        joint = int(compiled.actuator_trnid[actuator, 0])
        return bool(
            compiled.jnt_type[joint] in (SLIDE, HINGE)
            and compiled.actuator_dyntype[actuator] == 0
            and compiled.actuator_gaintype[actuator] in (_FIXED, _AFFINE)
            and compiled.actuator_biastype[actuator] in (_FIXED, _AFFINE)
            and not compiled.jnt_actfrclimited[joint]
            and not compiled.get("actuator_damping")[actuator : actuator + 1].any()
        )

    def acts(self) -> list[int]:
        """The hinges and slides on which a law acts."""
        driven = {int(self._compiled.actuator_trnid[actuator, 0]) for actuator in self._actuators}
        moved = (self._stiffness != 0) | (self._damping[self._dofs] != 0)
        return sorted(driven | set(self._joints[moved].tolist()))

    def of_joint(self, joint: int, position: float, velocity: float, time: float) -> float:
        """Force or torque along a hinge or slide at its position, velocity and a time (s), N or N m."""
        at = int(np.searchsorted(self._joints, joint))
        force = -float(self._stiffness[at]) * (position - float(self._rest[at]))
        force -= float(self._damping[self._dofs[at]]) * velocity
        for actuator in self._actuators:
            if self._compiled.actuator_trnid[actuator, 0] == joint:
                force += self._push(actuator, position, velocity, time)
        return force

    def _push(self, actuator: int, position: float, velocity: float, time: float) -> float:
        compiled = self._compiled
        gear = float(compiled.actuator_gear[actuator, 0])
        seen = np.array([1.0, gear * position, gear * velocity])
        control = float(self._controls(time)[actuator])
        if self._clamps and compiled.actuator_ctrllimited[actuator]:
            control = float(np.clip(control, *compiled.actuator_ctrlrange[actuator]))
        affine = compiled.actuator_gaintype[actuator] == _AFFINE
        gain = (
            float(compiled.actuator_gainprm[actuator, :3] @ seen) if affine else compiled.actuator_gainprm[actuator, 0]
        )
        bias = compiled.actuator_biastype[actuator] == _AFFINE
        force = gain * control + (float(compiled.actuator_biasprm[actuator, :3] @ seen) if bias else 0.0)
        if compiled.actuator_forcelimited[actuator]:
            force = float(np.clip(force, *compiled.actuator_forcerange[actuator]))
        return gear * force

    def __call__(self, qpos: np.ndarray, qvel: np.ndarray, time: float) -> np.ndarray:
        """The generalised forces (nv) at a state and a time (s)."""
        force = -self._damping * qvel
        force[self._dofs] = 0.0
        for joint in self.acts():
            at, dof = int(self._compiled.jnt_qposadr[joint]), int(self._compiled.jnt_dofadr[joint])
            force[dof] = self.of_joint(joint, float(qpos[at]), float(qvel[dof]), time)
        return force
