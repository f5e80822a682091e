"""Projection onto the constraint manifold: positions with r(q) = 0, velocities with J v = 0.

Of all changes that close the rows the nearest in the metric of M is taken, δ = −M⁻¹ Jᵀ A⁺ r with A = J M⁻¹ Jᵀ. It has
no part along the motions that the rows admit; redundant rows and rows that contradict one another are met in the sense
of least squares. Positions take Newton rounds, for r is not linear in q; J v is linear in v, and repeating only removes
what a solver's tolerance left. A velocity projected like this never gains kinetic energy. (Eich 1993, Convergence
results for a coordinate projection method applied to mechanical systems with algebraic constraints.)
"""

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from oarlock.base.vectors import times
from oarlock.mechanics.inertia import Inertia
from oarlock.mechanics.rows import closing_jacobian
from oarlock.stepping.solvers import SolverSpec

TRACKED = SolverSpec("sr1-tracked", (("predict", 0.0),))
"""The projector's own solver: A⁺ carried from step to step, every solve started from A⁺ b, for residuals are noise and
an earlier one says nothing about the next."""

MAX_ROUNDS = 5
"""Newton's rounds square the gap: from a gap that is worth projecting, three reach rounding."""

LANDED = 1000.0
"""A row counts as closed up to so many roundings: what long chains and large angles accumulate. Projection does not
stop there, but where rows no longer fall."""

TRUST_MIN, TRUST_MAX = 1e-6, 0.1
"""rad or m. A mechanism at rest may still be moved: more than rounding makes of a nearly singular pose, less than one
sees. One that races must not be moved by more than keeps it near its pose."""

_EPSILON = float(np.finfo(float).eps)

Status = Literal["landed", "open", "too-far"]


@dataclass(frozen=True)
class Projection:
    """What one projection did.

    Attributes:
        status: ``landed``: every row is closed to rounding; ``open``: the rows no longer fell before that;
            ``too-far``: closing them takes more than the trust length, and the state was left as it was.
        rounds: corrections of the positions.
        solves: solves, those for the velocities among them.
        iterations: their iterations, in the solver's own count.
        moved: largest change of a coordinate, rad or m.
    """

    status: Status
    rounds: int
    solves: int
    iterations: int
    moved: float


def gap(data: mujoco.MjData) -> float:
    """Largest deviation of an equality row, in m or rad."""
    return float(np.abs(data.efc_pos[: data.ne]).max(initial=0.0))


class Projector:
    """Projects states of one model, with a solver of its own that carries what it learns.

    Raises:
        InputError: the solver has an unknown option or a value out of range.
    """

    def __init__(self, model: mujoco.MjModel, rank_cut: float | None = None, solver: SolverSpec = TRACKED):
        self.model = model
        self.rank = 0
        """Rank of A at the last correction."""
        self.last: Projection | None = None
        """What the last projection did."""
        self._inertia = Inertia(model)
        self._solver = solver.with_defaults(rank_cut=rank_cut).make()
        self._zero = np.zeros(model.nv)
        # A row is the difference of two positions, and each is rounded.
        self._rounding = 2.0 * _EPSILON * float(model.stat.extent + np.abs(model.stat.center).max())
        self._solves = self._iterations = 0

    def correction(self, data: mujoco.MjData, wanted: np.ndarray, damping: float = 0.0) -> np.ndarray:
        """δ = M⁻¹ Jᵀ A⁺ c (nv): of those nearest to J δ = c the one with the least ½ δᵀ M δ.

        The position stage must be valid. ``wanted`` is c (ne); ``damping`` is added to the diagonal of A.
        """
        jacobian = closing_jacobian(self.model, data)
        softness = np.full(len(wanted), damping) if damping else None
        self._inertia.assemble(data, jacobian, self._zero, wanted, softness)
        multipliers, info = self._solver.solve_system(self._inertia.system)
        self.rank = info.rank or 0
        self._solves += 1
        self._iterations += info.iterations
        return self._inertia.acceleration(data, multipliers)[0]

    def project(self, data: mujoco.MjData, trust: float) -> Projection:
        """Projects ``qpos``, then ``qvel``; leaves the position stage valid. What is at rounding is left untouched.

        Args:
            data: a state with finite positions and velocities.
            trust: longest change of a coordinate, rad or m, that still is a correction and not another pose; taken
                between ``TRUST_MIN`` and ``TRUST_MAX``.
        """
        self._solves = self._iterations = 0
        status, rounds, moved = self._positions(data, min(max(trust, TRUST_MIN), TRUST_MAX))
        if status != "too-far":
            self._velocities(data)
        self.last = Projection(status, rounds, self._solves, self._iterations, moved)
        return self.last

    def _positions(self, data: mujoco.MjData, trust: float) -> tuple[Status, int, float]:
        model, given, total = self.model, data.qpos.copy(), np.zeros(self.model.nv)
        rounds = 0
        mujoco.mj_fwdPosition(model, data)
        error = gap(data)
        while error > self._rounding and rounds < MAX_ROUNDS:
            step = self.correction(data, -data.efc_pos[: data.ne])
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
        status: Status = "landed" if error <= LANDED * self._rounding else "open"
        return status, rounds, float(np.abs(total).max(initial=0.0))

    def _place(self, data: mujoco.MjData, qpos: np.ndarray) -> None:
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(self.model, data)

    def _velocities(self, data: mujoco.MjData) -> None:
        jacobian = closing_jacobian(self.model, data)
        rate = times(jacobian, data.qvel)
        error = np.abs(rate).max(initial=0.0)
        for _ in range(MAX_ROUNDS):
            if error <= _EPSILON * times(np.abs(jacobian), np.abs(data.qvel)).max(initial=0.0):
                return
            changed = data.qvel + self.correction(data, -rate)
            rate = times(jacobian, changed)
            after = np.abs(rate).max()
            if not after < error:
                return
            data.qvel[:], error = changed, after
