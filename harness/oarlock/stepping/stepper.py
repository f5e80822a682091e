"""Exact loops in place of ``mj_step``: steps on data of one's own, natively."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base import core
from oarlock.base.arguments import require_number
from oarlock.base.errors import InputError, choose
from oarlock.base.options import Number
from oarlock.mechanics.inequalities import refuse_unsupported
from oarlock.mechanics.made_of import MadeOf
from oarlock.mechanics.prepare import integrator_of
from oarlock.stepping import native_path
from oarlock.stepping.closing import close
from oarlock.stepping.projection import TRACKED, Projector
from oarlock.stepping.solvers import SolverSpec

STABILISATIONS = ("projection", "baumgarte", "both", "none")
"""What keeps exact constraints from drifting."""

DAMPING, STIFFNESS = 50.0, 2500.0
"""β (1/s) and k (1/s²) of Baumgarte's terms where none are given: critically damped, within hundredths of a second."""


@dataclass(frozen=True)
class StepFigures:
    """What a step did.

    Attributes:
        status: ``converged``, or how the first of its solves ended that did not.
        solves: number of solves: one, or four of Runge–Kutta.
        iterations: of all of them, in the solver's own count.
        multipliers: of the equality rows at the last solve, (ne), N or N m.
        drift: largest deviation of a row after the step, m or rad; before it where nothing projects.
        active: limits, friction losses and contacts that push; None where the state has none.
        blocked: those of them that push against loops alone.
        projection: ``landed``, ``open`` or ``too-far``, as of ``stepping.projection``; None where nothing projects.
        rounds: corrections of the positions by it.
        moved: largest change of a coordinate by it, rad or m.
        info: all that the solver says of the last solve.
    """

    status: str
    solves: int
    iterations: int
    multipliers: np.ndarray
    drift: float
    active: int | None
    blocked: int | None
    projection: str | None
    rounds: int | None
    moved: float | None
    info: core.Info


class Stepper:
    """Takes the steps of ``mj_step`` with loops that are exact; contacts, limits and friction are MuJoCo's own.

    The integrator is the model's. After a step ``data`` holds the next state, and accelerations, constraint forces and
    sensors of the step: ``qacc``, ``qfrc_constraint``, ``efc_force``, ``sensordata``. Controls and applied forces are
    taken as the data has them; callbacks of the process are not asked. A step is that of ``oarlock.run``, bit for bit.
    Between steps the state may be written to, and MuJoCo called. What it computes (``xpos``, ``efc_J``, …) is not to be
    written to: the position stage at the end of a step is taken for the next where it still stands.

        stepper = oarlock.Stepper(model)
        while data.time < 10.0:
            data.ctrl[:] = controller(data)
            stepper.step(data)

    Args:
        model: copied as it is. Steps are refused once its options (timestep, gravity, integrator, …) are others; later
            changes of its arrays, of masses say, are not seen: make a new stepper.
        stabilisation: ``projection`` onto the constraints after every step; ``baumgarte``: terms in the accelerations;
            ``both``; ``none``.
        solver: name of a solver, with options as of ``oarlock run``.
        beta: β of Baumgarte's terms, 1/s; k: their k, 1/s². ``DAMPING`` and ``STIFFNESS`` if left out.

    Raises:
        InputError: an integrator that exact steps do not have, an equality whose J̇v is not known, plugins, an unknown
            solver, or a process that cannot step natively.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        stabilisation: str = "projection",
        solver: str = "auto",
        beta: Number | None = None,
        k: Number | None = None,
    ):
        if refused := native_path.refusal():
            raise InputError(f"no native stepping: {refused}")
        if not isinstance(model, mujoco.MjModel):
            raise InputError(f"model is a {type(model).__name__}, expected an MjModel")
        choose("stabilisation", stabilisation, STABILISATIONS)
        require_number("beta", beta, unit="1/s")
        require_number("k", k, unit="1/s²")
        integrator = integrator_of(model)
        if not integrator.runs:
            raise InputError(f"integrator {integrator}, expected one that exact steps have: euler, implicitfast or rk4")
        own = copy.copy(model)
        refuse_unsupported(own)
        own.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)  # a tree that sleeps has no rows
        damped = stabilisation in ("baumgarte", "both")
        self._model, self._scratch = own, mujoco.MjData(own)
        # No method: the core would keep what keeps the core.
        self._require = MadeOf(model, own).require
        self._core = core.Stepper(
            own,
            given=model,
            solver=SolverSpec.parse(solver).make(),
            projector=TRACKED.make() if stabilisation in ("projection", "both") else None,
            beta=(DAMPING if beta is None else float(beta)) if damped else 0.0,
            k=(STIFFNESS if k is None else float(k)) if damped else 0.0,
            sensors=model.nsensor > 0 and not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_SENSOR),
            energy=bool(model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_ENERGY)),
            mocaps=model.nmocap > 0,
            require=self._require,
        )

    def step(self, data: mujoco.MjData) -> None:
        """Takes one step, in place of ``mujoco.mj_step(model, data)``.

        Raises:
            InputError: the data is of another model, the model's options changed, the state is not finite, no equality
                is active, or the loops stand open, or are taken apart by the velocities, further than a step explains:
                a start is to be closed first; or the motion is too fast for the timestep. The state of the data is
                then what it was.
        """
        self._core.step(data)

    def rollout(
        self, data: Sequence[mujoco.MjData], *, steps: int | None = None, control: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Takes steps with many data, side by side on all cores, without the interpreter lock.

        Args:
            data: different ones, each at its start; they are left at the end.
            steps: how many; as ``control`` has them if left out.
            control: controls before every step, (data, steps, nu); those of the data, all along, if left out.

        Returns:
            Positions (data, steps, nq) and velocities (data, steps, nv) at the end of every step.

        Raises:
            InputError: as ``step``, with the number of the data, while the others are at their ends; a data that is
                there twice, or ``control`` of another shape.
        """
        data = list(data)
        for index, one in enumerate(data):
            self._require(one)
            if any(one is other for other in data[:index]):
                raise InputError(f"data[{index}] is there twice, expected different ones")
        given = None if control is None else np.ascontiguousarray(control, dtype=float)
        if given is not None and (given.ndim != 3 or given.shape[0] != len(data) or given.shape[2] != self._model.nu):
            raise InputError(
                f"control of the shape {given.shape}, expected ({len(data)}, steps, {self._model.nu}): data, steps, nu"
            )
        if steps is not None and not isinstance(steps, int):
            raise InputError(f"steps = {steps!r}, expected a whole number ≥ 1")
        count = steps if steps is not None else given.shape[1] if given is not None else 0
        if count < 1 or (given is not None and given.shape[1] != count):
            raise InputError(f"steps = {steps}, expected a whole number ≥ 1, as control has them")
        return self._core.rollout([one._address for one in data], count, given)

    def close(self, data: mujoco.MjData) -> None:
        """Takes the positions to the nearest pose that closes all loops, and the velocities along them: a start.

        Raises:
            InputError: no pose near this one closes them.
        """
        self._require(data)
        if not close(self._model, data, None):
            left = float(np.abs(data.efc_pos[: data.ne]).max(initial=0.0))
            raise InputError(f"no pose near this one closes the loops: a row stays open by {left:.3g}")
        mujoco.mj_fwdVelocity(self._model, data)
        data.qvel += Projector(self._model).correction(data, -data.efc_vel[: data.ne])

    def figures(self, index: int = 0) -> StepFigures | None:
        """What the last step did, of the data with that number in a rollout; None before the first."""
        if index < 0:
            raise InputError(f"index = {index}, expected the number of a data in a rollout, from 0 on")
        found = self._core.figures(index)
        return None if found is None else StepFigures(**found)

    def energy(self, data: mujoco.MjData) -> tuple[float, float]:
        """Computes potential and kinetic energy (J) of the present state of a data."""
        self._require(data)
        own = self._scratch
        own.qpos[:], own.qvel[:] = data.qpos, data.qvel
        mujoco.mj_fwdPosition(self._model, own)
        mujoco.mj_fwdVelocity(self._model, own)
        mujoco.mj_energyPos(self._model, own)
        mujoco.mj_energyVel(self._model, own)
        return float(own.energy[0]), float(own.energy[1])

    def reset(self) -> None:
        """Forgets what was learned in earlier steps; do so before another start that is far from the last state."""
        self._core.reset()
