"""Projection onto the constraint manifold: positions with r(q) = 0, velocities with J v = 0.

Of all changes that close the rows it takes the smallest in the metric of M, δ = −M⁻¹ Jᵀ A⁺ r with A = J M⁻¹ Jᵀ. This
has no part along the motions that the rows admit; redundant and contradicting rows are met in the sense of least
squares. One that would push a violated limit or a penetrating contact deeper is replaced by the smallest that does not,
as far as the loops leave a choice. Positions take Newton rounds, because r is not linear in q; J v is linear in v, and
repeating only removes what a solver's tolerance left. A velocity projected like this never gains kinetic energy. (Eich
1993, Convergence results for a coordinate projection method applied to mechanical systems with algebraic constraints.)
Where mocap bodies move, r(q, t) = 0 and J v = −∂r/∂t.
"""

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from oarlock.base import core
from oarlock.base.vectors import times, total
from oarlock.mechanics.inertia import Inertia, whiten
from oarlock.mechanics.rows import closing_jacobian
from oarlock.stepping.inequalities import COEFFICIENTS, Rows
from oarlock.stepping.moving import Moving
from oarlock.stepping.solvers import SolverSpec

TRACKED = SolverSpec("sr1-tracked", (("predict", 0.0),))
"""Solver of a projector. It carries A⁺ from step to step and starts every solve from A⁺ b, because residuals are noise
and an earlier one says nothing about the next."""

MAX_ROUNDS = 5
"""Maximum number of Newton rounds. They square the gap, so that three reach rounding from any gap worth projecting."""

LANDED = 1000.0
"""Number of roundings up to which a row counts as closed, as long chains and large angles accumulate them. Projection
does not stop there, but where rows no longer fall."""

TRUST_MIN, TRUST_MAX = 1e-6, 0.1
"""Bounds of the trust length, rad or m, however far a state has gone. The lower one lets a mechanism at rest be moved
by more than rounding makes of a nearly singular pose, and less than one sees; the upper one keeps a fast one near its
pose."""

FIRM = 1e12
"""Stiffness of what a correction must not push deeper, in units of its inertia: a part of 1e-12 of what it would be
pushed by is left."""

LEAST = 1e-100
"""Inertia of a row, at least: what nothing moves is not pushed either."""

_EPSILON = float(np.finfo(float).eps)

Status = Literal["landed", "open", "too-far"]


@dataclass(frozen=True)
class Projection:
    """What one projection did.

    Attributes:
        status: ``landed`` if every row is closed to rounding; ``open`` if the rows stopped falling before that;
            ``too-far`` if closing them takes more than the trust length, and the state was left as it was.
        rounds: number of corrections of the positions.
        solves: number of solves, including those for the velocities.
        iterations: number of their iterations, in the solver's own count.
        moved: largest change of a coordinate, rad or m.
    """

    status: Status
    rounds: int
    solves: int
    iterations: int
    moved: float


def gap(data: mujoco.MjData) -> float:
    """Computes the largest deviation of any equality row, m or rad, at a state whose position stage is done."""
    return float(np.abs(data.efc_pos[: data.ne]).max(initial=0.0))


class Projector:
    """Projects states of one model, with a solver of its own that carries what it learned.

    Attributes:
        model: the model.

    Args:
        model: the model.
        rank_cut: eigenvalues below this part of the largest count as zero; None for the solver's default.
        solver: specification of the solver.
        left: what the rows of a closed pose leave open where they contradict one another, m or rad; twice that still
            counts as closed.
        moving: the mocap bodies that move.

    Raises:
        InputError: the solver has an unknown option or a value out of range.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        rank_cut: float | None = None,
        solver: SolverSpec = TRACKED,
        left: float = 0.0,
        moving: Moving | None = None,
    ):
        self.model = model
        self.rank = 0
        """Rank of A at the last correction."""
        self.last: Projection | None = None
        """What the last projection did; None before the first."""
        self._inertia = Inertia(model)
        self._solver = solver.with_defaults(rank_cut=rank_cut).make()
        self._zero = np.zeros(model.nv)
        self._holding = core.Inequalities()
        self._change = np.zeros((1, model.nv))
        # A row is the difference of two positions, and each is rounded.
        self._rounding = 2.0 * _EPSILON * float(model.stat.extent + np.abs(model.stat.center).max())
        self._solves = self._iterations = 0
        self._gone, self._left, self._moving = 0.0, left, moving
        single = np.isin(model.jnt_type, (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE))
        self._dofs, self._coordinates = model.jnt_dofadr[single], model.jnt_qposadr[single]

    def _guarded(self, data: mujoco.MjData, wanted: np.ndarray, rates: np.ndarray | None = None) -> np.ndarray:
        """A correction that pushes no violated limit and no penetrating contact deeper, unless the loops ask for it.

        One of velocities ``rates`` (nv) may slow down what leaves a limit, but not turn it back.
        """
        plain = self.correction(data, wanted)
        if data.nefc == data.ne:
            return plain
        held = Rows(self.model, data).held()
        model, count, zeros = self.model, len(held), np.zeros(len(held))
        least = zeros if rates is None else -np.maximum(times(held, rates), 0.0)
        if not (times(held, plain) < least).any():
            return plain
        whitened = whiten(model, data, held)
        stiffness = FIRM / np.maximum(total(whitened * whitened), LEAST)
        self._holding.solve(
            self._inertia.system,
            whitened,
            held,
            least,
            stiffness,
            zeros,
            dims=[1] * count,
            mu=zeros,
            friction=np.zeros((count, COEFFICIENTS)),
        )
        mujoco.mj_solveM(model, data, self._change, self._holding.generalised_force[None])
        self._inertia.start_from(self._change[0])
        self._inertia.system.renew(self._change[0], wanted)
        return self._solve(data)

    def correction(self, data: mujoco.MjData, wanted: np.ndarray, damping: float = 0.0) -> np.ndarray:
        """Computes δ = M⁻¹ Jᵀ A⁺ c (nv), the least-squares solution of J δ = c with the smallest ½ δᵀ M δ.

        Args:
            data: a state whose position stage is done.
            wanted: c (ne).
            damping: added to the diagonal of A.
        """
        jacobian = closing_jacobian(self.model, data)
        softness = np.full(len(wanted), damping) if damping else None
        self._inertia.hold_rank(data, jacobian)
        self._inertia.assemble(data, jacobian, self._zero, wanted, softness)
        return self._solve(data)

    def _solve(self, data: mujoco.MjData) -> np.ndarray:
        multipliers, info = self._solver.solve_system(self._inertia.system)
        self.rank = info.rank or 0
        self._solves += 1
        self._iterations += info.iterations
        return self._inertia.acceleration(data, multipliers)[0]

    def project(self, data: mujoco.MjData, gone: float) -> Projection:
        """Projects ``qpos``, then ``qvel``. Rows that are closed to rounding are left alone.

        A correction may be as long as the way that was gone since rows were last closed; a longer one would lead to
        another pose. Where it is refused the gap goes on growing, and what is trusted grows with it: the next step
        tries again. The position stage is valid afterwards.

        Args:
            data: a state with finite positions and velocities.
            gone: how far a coordinate may have gone in this step, rad or m; what is trusted is clipped to
                ``TRUST_MIN`` and ``TRUST_MAX``.
        """
        self._solves = self._iterations = 0
        self._gone += gone
        status, rounds, moved = self._positions(data, min(max(self._gone, TRUST_MIN), TRUST_MAX))
        if status != "too-far":
            self._velocities(data)
            self._gone = 0.0
        self.last = Projection(status, rounds, self._solves, self._iterations, moved)
        return self.last

    def _positions(self, data: mujoco.MjData, trust: float) -> tuple[Status, int, float]:
        model, given, total = self.model, data.qpos.copy(), np.zeros(self.model.nv)
        rounds = 0
        mujoco.mj_fwdPosition(model, data)
        error, rounding = gap(data), self._rounding_at(data)
        while error > rounding and rounds < MAX_ROUNDS:
            step = self._guarded(data, -data.efc_pos[: data.ne])
            if not np.abs(total + step).max() <= trust:
                self._place(data, given)
                return "too-far", 0, 0.0
            before = data.qpos.copy()
            mujoco.mj_integratePos(model, data.qpos, step, 1.0)
            mujoco.mj_fwdPosition(model, data)
            after = gap(data)
            if not after < error:
                self._place(data, before)
                break
            error, rounds = after, rounds + 1
            total += step
        status: Status = "landed" if error <= max(LANDED * rounding, 2.0 * self._left) else "open"
        return status, rounds, float(np.abs(total).max(initial=0.0))

    def _rounding_at(self, data: mujoco.MjData) -> float:
        """What rounding leaves open: of a point, of the mechanism's place; of a coupling, of what it adds up."""
        kinds = self.model.eq_type[data.efc_id[: data.ne]]
        coupled = np.isin(kinds, (mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtEq.mjEQ_TENDON))
        if not coupled.any():
            return self._rounding
        size = np.zeros(self.model.nv)
        size[self._dofs] = np.abs(data.qpos[self._coordinates])
        parts = times(np.abs(closing_jacobian(self.model, data)[coupled]), size)
        return max(self._rounding, 2.0 * _EPSILON * float(parts.max()))

    def _place(self, data: mujoco.MjData, qpos: np.ndarray) -> None:
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(self.model, data)

    def _velocities(self, data: mujoco.MjData) -> None:
        jacobian = closing_jacobian(self.model, data)
        own = self._moving.rate(data) if self._moving is not None else 0.0
        rate = times(jacobian, data.qvel) + own
        error = np.abs(rate).max(initial=0.0)
        for _ in range(MAX_ROUNDS):
            if error <= _EPSILON * times(np.abs(jacobian), np.abs(data.qvel)).max(initial=0.0):
                return
            changed = data.qvel + self._guarded(data, -rate, data.qvel)
            rate = times(jacobian, changed) + own
            after = np.abs(rate).max()
            if not after < error:
                return
            data.qvel[:], error = changed, after
