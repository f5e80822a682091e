"""Steps of one engine: MuJoCo's own, or MuJoCo's integrators fed with a constraint force from elsewhere.

``Walker.step`` leaves the data at the next state;
``Walker.look`` makes everything that belongs to the present state valid, the acceleration included.
"""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Protocol

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.vectors import Vector, cross, dot, plus, scaled
from oarlock.mechanics.bounds import bounded
from oarlock.mechanics.drive import Drive
from oarlock.mechanics.newton import confirm, forward
from oarlock.mechanics.prepare import integrator_of
from oarlock.stepping.moving import Moving
from oarlock.stepping.projection import Projector, gap

LOST = 1e-6
"""m or rad. Rows that closing leaves open by more than six digits of a file leave admit no motion on which their rank
stays what it was: what would follow is no exact solution."""

_SMALL_ANGLE = 1e-4
"""rad. Below it (1 − (θ/2) cot(θ/2))/θ² is its limit 1/12: the next term, θ²/720 times θ²ω, is below rounding."""


def is_sane(data: mujoco.MjData) -> bool:
    """Whether positions and velocities are finite and below MuJoCo's bound."""
    return bounded(data.qpos, data.qvel)


def smooth_stages(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Leaves M, J, R, aref, qfrc_smooth and qacc_smooth ready, controls as they are, without MuJoCo's solver."""
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_fwdActuation(model, data)
    mujoco.mj_fwdAcceleration(model, data)


class ForceLaw(Protocol):
    """Gives the constraint force of a state whose smooth stages are done."""

    def apply(self, data: mujoco.MjData) -> None:
        """Writes qacc, qfrc_constraint and efc_force. Both are needed: Euler reads one or the other by damping."""


class Walker(Protocol):
    """One engine on its way."""

    data: mujoco.MjData

    def look(self) -> None:
        """Computes what belongs to the present state."""

    def step(self) -> None:
        """Goes on by one timestep, from a state that was looked at."""

    def mujoco_answer(self) -> tuple[np.ndarray, np.ndarray]:
        """MuJoCo's own qacc and qfrc_constraint (nv) at the present state."""
        ...


def walk(walker: Walker, steps: int) -> Iterator[int]:
    """Takes steps; at every number that it gives, the state at the start of that step is looked at.

    It ends early, after the step that leaves positions or velocities beyond MuJoCo's bound or not finite, and before
    one that begins with such accelerations.
    """
    for step in range(steps):
        walker.look()
        if not bounded(walker.data.qacc):
            return
        yield step
        walker.step()
        if not is_sane(walker.data):
            return


def _function(model: mujoco.MjModel) -> Callable[[mujoco.MjModel, mujoco.MjData], None]:
    """MuJoCo's own function that takes the model's step from a state with all its forces."""
    integrator = integrator_of(model)
    function = getattr(mujoco, integrator.function)
    return function if integrator.stages == 1 else partial(function, N=integrator.stages)


class MujocoWalker:
    """MuJoCo's own step. Run it inside ``drive.installed()``: RK4 asks at its stages for controls that are not held."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, drive: Drive | None = None):
        self.model, self.data = model, data
        self._drive = drive if drive is not None and drive.between else None
        self._function = _function(model)

    def look(self) -> None:
        """mj_forward: everything that mj_step would compute first."""
        if self._drive is not None:
            self._drive.apply(self.data)
        forward(self.model, self.data)

    def step(self) -> None:
        """The second half of mj_step, the integrator on its own; all of it where there is no such half."""
        self._function(self.model, self.data)

    def mujoco_answer(self) -> tuple[np.ndarray, np.ndarray]:
        """What mj_forward left, in its own arrays."""
        return self.data.qacc, self.data.qfrc_constraint

    @property
    def iterations(self) -> int:
        """Solver iterations at the present state, over all islands."""
        return int(self.data.solver_niter[: max(1, self.data.nisland)].sum())


class ForcedWalker:
    """MuJoCo's smooth dynamics and integrators with the force of a ``ForceLaw``; a projector ends every step.

    Mocap bodies stand still during a step, as MuJoCo has them; if it ``follows``, they go along their laws, stage by
    stage.

    Raises:
        InputError: the model has actuator activations, and its integrator takes none.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        drive: Drive,
        force: ForceLaw,
        projector: Projector | None = None,
        moving: Moving | None = None,
        follows: bool = False,
    ):
        integrator = integrator_of(model)
        if model.na and not integrator.takes_activations:
            raise InputError(
                f"the model has {model.na} actuator activation(s), expected none with {integrator}: "
                "use euler or implicitfast"
            )
        self.model, self.data = model, data
        self._drive, self._force, self._projector, self._moving = drive, force, projector, moving
        self._follows = follows and moving is not None
        self._staged, self._function = integrator.stages > 1, _function(model)
        self._turns = _turns(model)
        self._qpos, self._qvel = np.zeros(model.nq), np.zeros(model.nv)
        self._velocities, self._accelerations = np.zeros((4, model.nv)), np.zeros((4, model.nv))

    def look(self) -> None:
        """The smooth stages, then the force law."""
        self._drive.apply(self.data)
        self._begin()
        self._forces()

    def _begin(self) -> None:
        if self._moving is not None:
            self._moving.begin(self.data)
            if self._follows:
                self._moving.place(self.data)

    def _forces(self) -> None:
        smooth_stages(self.model, self.data)
        self._force.apply(self.data)

    def step(self) -> None:
        """MuJoCo's Euler or implicit step, or the Runge–Kutta step of order four; then the projection.

        A projection may move the state about as far as the steps did since rows were last closed; more is refused, and
        noted in its status. How far is h max|v| + h² max|a|: at a turning point the velocities say nothing, and what a
        step leaves open there is of the order of h² a.

        Raises:
            InputError: the nearest pose leaves a row open by more than ``LOST``.
        """
        integrate = self._runge_kutta if self._staged else partial(self._function, self.model, self.data)
        if self._projector is None:
            integrate()
            return
        step = self.model.opt.timestep
        fastest, hardest = np.abs(self.data.qvel).max(), np.abs(self.data.qacc).max()
        integrate()
        if is_sane(self.data):
            self._begin()
            fastest = max(fastest, np.abs(self.data.qvel).max())
            done = self._projector.project(self.data, gone=step * float(fastest) + step * step * float(hardest))
            if done.status == "open" and gap(self.data) > LOST:
                raise InputError(
                    "the rows can no longer be closed together: the nearest pose leaves one open by more than "
                    "1e-6 m or rad, expected none"
                )

    def mujoco_answer(self) -> tuple[np.ndarray, np.ndarray]:
        """What MuJoCo's solver says here; our own force is put back afterwards."""
        data = self.data
        own = data.qacc.copy(), data.qfrc_constraint.copy(), data.efc_force.copy()
        mujoco.mj_fwdConstraint(self.model, data)
        confirm(self.model, data)
        theirs = data.qacc.copy(), data.qfrc_constraint.copy()
        data.qacc[:], data.qfrc_constraint[:], data.efc_force[:] = own
        return theirs

    def _runge_kutta(self) -> None:
        """The classical tableau; orientations as Runge–Kutta–Munthe–Kaas, as MuJoCo since 4.0.

        A stage's orientation is q₀ exp(u): what is summed is not the body's ω there but u̇ (Munthe-Kaas 1998).
        """
        model, data = self.model, self.data
        velocities, accelerations, turns = self._velocities, self._accelerations, self._turns
        step, time = model.opt.timestep, data.time
        self._qpos[:], self._qvel[:] = data.qpos, data.qvel
        velocities[0], accelerations[0] = data.qvel, data.qacc
        for stage, fraction in ((1, 0.5), (2, 0.5), (3, 1.0)):
            moved = fraction * step * velocities[stage - 1]
            data.qpos[:] = self._qpos
            mujoco.mj_integratePos(model, data.qpos, moved, 1.0)
            data.qvel[:] = self._qvel + fraction * step * accelerations[stage - 1]
            data.time = time + fraction * step
            self._drive.apply_at_stage(data)
            if self._moving is not None and self._follows:
                self._moving.place(data)
            self._forces()
            velocities[stage], accelerations[stage] = data.qvel, data.qacc
            for turn in turns:
                velocities[stage, turn] = _rotation_vector_rate(moved[turn].tolist(), data.qvel[turn].tolist())
        data.qpos[:] = self._qpos
        mujoco.mj_integratePos(model, data.qpos, _mean(velocities), step)
        data.qvel[:] = self._qvel + step * _mean(accelerations)
        data.time = time + step


def _mean(stages: np.ndarray) -> np.ndarray:
    """The tableau's mean (nv) of what the stages (4, nv) gave."""
    first, second, third, fourth = stages
    return (first + 2.0 * second + 2.0 * third + fourth) / 6.0


def _turns(model: mujoco.MjModel) -> list[slice]:
    """Where the angular velocities of ball and free joints are in qvel."""
    angular = {int(mujoco.mjtJoint.mjJNT_BALL): 0, int(mujoco.mjtJoint.mjJNT_FREE): 3}
    joints = zip(model.jnt_type.tolist(), model.jnt_dofadr.tolist(), strict=True)
    first = [address + angular[kind] for kind, address in joints if kind in angular]
    return [slice(address, address + 3) for address in first]


def _rotation_vector_rate(vector: Vector, omega: Vector) -> Vector:
    """u̇ of a rotation vector u (rad) when q₀ exp(u) turns with ω (rad/s, body frame).

    u̇ = ω + ½ u×ω + (1 − (θ/2) cot(θ/2))/θ² u×(u×ω), θ = |u|: the inverse of the exponential's right differential
    (Iserles, Munthe-Kaas, Nørsett and Zanna, Lie-group methods, 2000).
    """
    square = dot(vector, vector)
    bend = 1.0 / 12.0
    if square > _SMALL_ANGLE * _SMALL_ANGLE:
        half = 0.5 * math.sqrt(square)
        cotangent = half / math.tan(half) if half < math.inf else math.nan
        bend = (1.0 - cotangent) / (4.0 * half * half)
    first = cross(vector, omega)
    return plus(plus(omega, scaled(0.5, first)), scaled(bend, cross(vector, first)))


class MujocoForce:
    """MuJoCo's own efc_force, taken through our acceleration: the calibration."""

    def __init__(self, model: mujoco.MjModel):
        self.model = model
        self._delta = np.zeros((1, model.nv))

    def apply(self, data: mujoco.MjData) -> None:
        """Runs MuJoCo's solver, then computes Jᵀf and qacc_smooth + M⁻¹Jᵀf from its force alone."""
        model = self.model
        mujoco.mj_fwdConstraint(model, data)
        confirm(model, data)
        mujoco.mj_mulJacTVec(model, data, data.qfrc_constraint, data.efc_force)
        mujoco.mj_solveM(model, data, self._delta, data.qfrc_constraint[None, :])
        data.qacc[:] = data.qacc_smooth + self._delta[0]
