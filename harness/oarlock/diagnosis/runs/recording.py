"""A run of MuJoCo as its user configured it, with everything that the row law needs, step by step.

Only equality rows are kept. Of limits, friction loss and contacts it is noted what each did over the run.
"""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.cases.case_file import Baumgarte
from oarlock.cases.integrators import INTEGRATORS
from oarlock.diagnosis.runs.beside import Beside, find_beside
from oarlock.diagnosis.runs.pushes import Push, Pushes
from oarlock.diagnosis.runs.walking import (
    End,
    diverged,
    energy_error,
    other_power,
    own_copy,
    walk,
    warnings_of,
)
from oarlock.mechanics.controls import drive
from oarlock.mechanics.curvature import Curvature
from oarlock.mechanics.engine_version import diagonal_approx
from oarlock.mechanics.inertia import whiten
from oarlock.mechanics.load import collected_warnings
from oarlock.mechanics.prepare import integrator_of
from oarlock.mechanics.rows import closing_jacobian
from oarlock.mechanics.state_log import StateLog
from oarlock.poses.layout import Layout, RowColumns
from oarlock.stepping.logged import StatesWalker, walk_states
from oarlock.stepping.question import Question
from oarlock.stepping.solvers import SolverSpec
from oarlock.stepping.state import State

BLOCK_BYTES = 32_000_000
"""Rows in the metric of M are kept for so many bytes of steps at once, to solve them together."""

NOTHING = 1e-14
"""1/kg. A row with less on the diagonal of A is zero but for rounding, such as a planar loop's third one."""

ASTRAY = 1e-2
"""Part of the largest drift by which a step of the model may miss the next row of a log of states: beyond it the steps
that were logged are not this model's, and what made them drift is not known."""

NEGLIGIBLE = 1e-9
"""Of the largest R f of a step. Where a solver left less of the rows, its force counts as exact: of R (f − f*), which
is what a row sees, there is no more then, for A only takes from it."""


@dataclass(frozen=True)
class Recording:
    """MuJoCo's own run. Arrays over time are (steps, …), at the start of each step; of rows (steps, rows).

    Attributes:
        model: a copy of the user's, with nothing changed but that MuJoCo does not reset a state that diverged.
        position: r, m or rad (``efc_pos``).
        velocity: ṙ = J v (``efc_vel``).
        force: f, N or N m (``efc_force``).
        exact_force: f*: what a solver without error would give, (A + R)⁻¹ (aref − J a₀), with a₀ the acceleration
            without the loops' forces; beside limits, friction loss or contacts the solution of the whole problem.
        softness: R (``efc_R``); stiffness: K; damping: B; impedance: d (``efc_KBIP``).
        diagonal_approx: MuJoCo's estimate of the diagonal of A (``diagonal_approx``); diagonal: the true one.
        aref: MuJoCo's reference acceleration; reached: J·qacc; curvature: J̇v.
        present: whether MuJoCo made the row.
        qacc_free: the acceleration of a₀, (steps, nv).
        energy: potential and kinetic, J, (steps, 2).
        other_power: power of everything but loops, gravity and springs, W, (steps): drives, dampers, contacts, limits.
        iterations: of the constraint solver, over all islands.
        others: active rows that are not equalities'.
        driven: largest force of each actuator, N or N m, before its gear, (nu).
        act: activations at the start, (na); laws: actuator → law of time.
        pushes: what each limit, friction loss and contact did.
        beside: equalities whose reactions those leave open, at the last state in which any pushed.
        warnings: MuJoCo's own, with how often they came.
        strayed: of a log of states, how far a step of this model from a row was from the next row at most, rad or m.
        uncontrolled: actuators of the model, where such a log has no controls.
    """

    model: mujoco.MjModel
    layout: Layout
    integrator: str
    timestep_s: float
    time: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    qacc: np.ndarray
    qacc_free: np.ndarray
    ctrl: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    exact_force: np.ndarray
    softness: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    impedance: np.ndarray
    diagonal_approx: np.ndarray
    diagonal: np.ndarray
    aref: np.ndarray
    reached: np.ndarray
    curvature: np.ndarray
    present: np.ndarray
    energy: np.ndarray
    other_power: np.ndarray
    iterations: np.ndarray
    others: np.ndarray
    driven: np.ndarray
    act: np.ndarray
    laws: dict[str, str]
    pushes: tuple[Push, ...]
    beside: tuple[Beside, ...]
    warnings: dict[str, int]
    strayed: float
    end: End
    uncontrolled: int = 0

    @property
    def holds_force(self) -> bool:
        """Whether a step takes the constraint force as it was at its start."""
        return INTEGRATORS[self.integrator].holds_force

    @property
    def astray(self) -> str:
        """Why a log of states is not taken for steps of this model; empty where it is, or where there is none."""
        largest = float(self.drift.max(initial=0.0))
        if self.strayed <= ASTRAY * largest:
            return ""
        missing = (
            f"it has no 'ctrl', and the model has {self.uncontrolled} actuator(s); or other forces that it lacks"
            if self.uncontrolled
            else "forces that the log does not have"
        )
        return (
            f"a step of this model from a row of the log misses the next one by up to {self.strayed:.2g}, for a drift "
            f"of {largest:.2g}: {missing}, another model, or too few digits"
        )

    @property
    def steps(self) -> int:
        """Steps that were recorded."""
        return len(self.time)

    def restart(self, model: mujoco.MjModel) -> mujoco.MjData:
        """A data of another copy of the model where this run started."""
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.act[:] = self.qpos[0], self.qvel[0], self.act
        return data

    @cached_property
    def drift(self) -> np.ndarray:
        """Largest deviation of any row at each step, (steps), m or rad."""
        return np.abs(self.position).max(axis=1, initial=0.0)

    @cached_property
    def energy_error(self) -> np.ndarray:
        """Energy (J, (steps)) that came from nowhere: change of the total less the work of all but loops and springs.

        Nothing enters or leaves through closed loops and an exact integrator. Works by the trapezoidal rule. NaN where
        a mocap body is moved, and does work.
        """
        return energy_error(self.energy, self.other_power, self.timestep_s)

    @cached_property
    def scale(self) -> np.ndarray:
        """MuJoCo's estimate of the diagonal of A over the true one, (rows), the median over the run.

        A row is so many times softer than its solimp says. NaN for a row that moves nothing.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = self.diagonal_approx / np.where(self.diagonal > NOTHING, self.diagonal, np.nan)
        seen = np.isfinite(ratio).any(axis=0)
        found = np.full(self.layout.rows, np.nan)
        found[seen] = np.nanmedian(ratio[:, seen], axis=0)
        return found

    @property
    def changes(self) -> np.ndarray:
        """Times (s) at which the rows that MuJoCo makes changed."""
        return self.time[1:][(self.present[1:] != self.present[:-1]).any(axis=1)]

    @property
    def others_active(self) -> tuple[float, float] | None:
        """First and last time (s) at which rows other than equalities' were active; None if they never were."""
        times = self.time[self.others > 0]
        return (float(times[0]), float(times[-1])) if len(times) else None


_ROWS = (
    "position",
    "velocity",
    "force",
    "exact_force",
    "softness",
    "stiffness",
    "damping",
    "impedance",
    "diagonal_approx",
    "diagonal",
    "aref",
    "reached",
    "curvature",
)


def record(
    model: mujoco.MjModel,
    qpos: np.ndarray,
    qvel: np.ndarray,
    laws: dict[str, str],
    steps: int,
    *,
    act: np.ndarray | None = None,
    states: StateLog | None = None,
) -> Recording:
    """Runs MuJoCo as the user configured it: integrator, solver, cone and options are the model's.

    Args:
        model: the user's; it is left alone.
        qpos: start, (nq).
        qvel: start, (nv).
        laws: actuator → law of time, as of ``controls.laws``.
        steps: how many.
        act: activations at the start, (na); zero if left out.
        states: a log of the start and the steps, which then are gone through in place of MuJoCo's own.

    Raises:
        InputError: an active equality of a kind whose J̇v is not known, no equality row at all, or a wrong drive.
    """
    own = own_copy(model)
    data = mujoco.MjData(own)
    data.qpos[:], data.qvel[:] = qpos, qvel
    if act is not None:
        data.act[:] = act
    return _Recorder(own, data, steps).run(laws, states)


class _Recorder:
    """Takes down one run."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, steps: int):
        self._model, self._data, self._steps = model, data, steps
        self._layout = Layout.of(model, data.eq_active)
        self._curvature = Curvature(model, data, lenient=True)
        if self._layout.rows == 0:
            raise InputError("no active equality, expected at least one that closes a loop")
        rows, nv = self._layout.rows, model.nv
        self._rows = {name: np.zeros((steps, rows)) for name in _ROWS}
        self._present = np.zeros((steps, rows), dtype=bool)
        self._time, self._others, self._iterations = np.zeros(steps), np.zeros(steps, int), np.zeros(steps, int)
        self._power, self._energy = np.zeros(steps), np.zeros((steps, 2))
        self._coordinates = np.zeros((steps, model.nq))
        self._qvel, self._qacc, self._free = np.zeros((3, steps, nv))
        self._ctrl = np.zeros((steps, model.nu))
        self._act = data.act.copy()
        self._driven = np.zeros(model.nu)
        self._columns = RowColumns(self._layout)
        self._block = max(1, min(steps, BLOCK_BYTES // (8 * rows * max(rows, nv))))
        self._whitened = np.zeros((self._block, rows, nv))
        self._missed = np.zeros((self._block, rows))
        self._whole = np.full((self._block, rows), np.nan)
        # Beside a flex the whole problem is not ours: what its rows and MuJoCo's solver make of it is taken as given.
        self._state = None if self._layout.skipped else State(model, data, Baumgarte())
        self._question = Question(self._state, "matched") if self._state is not None else None
        self._solver = SolverSpec("auto").make()
        self._solved = 0
        self._worked = False
        self._pushes = Pushes(model)

    def run(self, laws: dict[str, str], states: StateLog | None) -> Recording:
        model, data = self._model, self._data
        driven = drive(model, laws)
        self._worked = bool(driven.mocaps)
        taken, logged = 0, StatesWalker(model, data, states) if states else None
        steps = walk_states(logged, self._steps) if logged else walk(model, data, driven, self._steps)
        with np.errstate(all="ignore"), collected_warnings():  # of a run that diverges
            for step in steps:
                self._take(step)
                taken = step + 1
                if taken - self._solved == self._block:
                    self._solve(taken)
            self._solve(taken)
        if taken and not self._present[:taken].any():
            raise InputError("no equality has a row in this run, expected a closed loop: equalities are switched off")
        if taken == self._steps:
            end = End("finished", float(self._time[-1]) if taken else 0.0)
        else:
            end = diverged(model, data)
        rows = {name: values[:taken] for name, values in self._rows.items()}
        return Recording(
            model=model,
            layout=self._layout,
            integrator=integrator_of(model).name,
            timestep_s=float(model.opt.timestep),
            time=self._time[:taken],
            qpos=self._coordinates[:taken],
            qvel=self._qvel[:taken],
            qacc=self._qacc[:taken],
            qacc_free=self._free[:taken],
            ctrl=self._ctrl[:taken],
            **rows,
            present=self._present[:taken],
            energy=self._energy[:taken],
            other_power=self._power[:taken],
            iterations=self._iterations[:taken],
            others=self._others[:taken],
            driven=self._driven,
            act=self._act,
            laws=laws,
            pushes=self._pushes.found,
            beside=find_beside(model, data) if end.how == "finished" else (),
            warnings=warnings_of(data),
            strayed=max(logged.strayed, default=0.0) if logged else 0.0,
            end=end,
            uncontrolled=states.uncontrolled if states else 0,
        )

    def _take(self, step: int) -> None:
        model, data = self._model, self._data
        ne, nefc = data.ne, data.nefc
        self._time[step], self._others[step] = data.time, nefc - ne
        self._iterations[step] = data.solver_niter[: max(1, data.nisland)].sum()
        self._coordinates[step], self._qvel[step], self._qacc[step] = data.qpos, data.qvel, data.qacc
        self._ctrl[step] = data.ctrl
        np.maximum(self._driven, np.abs(data.actuator_force), out=self._driven)
        self._pushes.take(data)
        self._energy[step] = data.energy
        slot = step - self._solved
        self._whitened[slot] = 0.0
        self._missed[slot] = 0.0
        self._power[step] = np.nan if self._worked else other_power(data, self._layout.skipped)
        if ne == 0:
            self._free[step] = data.qacc
            return
        columns, own = self._columns.of(data), self._columns.rows(data)
        rows = self._rows
        for name, values in (
            ("position", data.efc_pos),
            ("velocity", data.efc_vel),
            ("force", data.efc_force),
            ("softness", data.efc_R),
            ("aref", data.efc_aref),
            ("diagonal_approx", diagonal_approx(data)),
        ):
            rows[name][step, columns] = values[own]
        stiffness, damping, impedance, _ = data.efc_KBIP[own].T
        rows["stiffness"][step, columns] = stiffness
        rows["damping"][step, columns] = damping
        rows["impedance"][step, columns] = impedance
        self._present[step, columns] = True
        bend = np.empty(ne)
        self._curvature.write(data, bend)
        rows["curvature"][step, columns] = bend[own]

        jacobian = closing_jacobian(model, data)[own]
        force = data.efc_force[own]
        loops = jacobian.T @ force
        change = np.zeros((2, model.nv))
        mujoco.mj_solveM(model, data, change, np.stack([data.qfrc_constraint, data.qfrc_constraint - loops]))
        rows["reached"][step, columns] = jacobian @ data.qacc
        self._free[step] = data.qacc_smooth + change[1]
        self._whitened[slot, columns] = whiten(model, data, jacobian)
        achieved = jacobian @ (data.qacc_smooth + change[0])
        missed = data.efc_aref[own] - achieved - data.efc_R[own] * force
        self._missed[slot, columns] = missed
        self._whole[slot] = np.nan
        if self._state is None or self._question is None or nefc == ne:
            return
        if not np.abs(missed).max() <= NEGLIGIBLE * np.abs(data.efc_R[own] * force).max():
            self._whole[slot, columns] = self._matched(self._state, self._question)

    def _matched(self, state: State, question: Question) -> np.ndarray:
        """Multipliers (ne) of the whole problem at the present state, by a solver of ours."""
        state.read()
        question.ask()
        return question.solve(self._solver)[0]

    def _solve(self, taken: int) -> None:
        """f* = f + (A + R)⁻¹ (aref − J a − R f) of the steps of a block: exact also where A + R is ill-conditioned."""
        span, count = slice(self._solved, taken), taken - self._solved
        whitened, missed = self._whitened[:count], self._missed[:count]
        force, softness = self._rows["force"][span], self._rows["softness"][span]
        diagonal = np.einsum("nij,nij->ni", whitened, whitened)
        self._rows["diagonal"][span] = diagonal
        exact = force.copy()
        bound = NEGLIGIBLE * np.abs(softness * force).max(axis=1, initial=0.0)
        left = ~(np.abs(missed).max(axis=1, initial=0.0) <= bound)
        if left.any():
            matrices = whitened[left] @ whitened[left].transpose(0, 2, 1)
            scale = 1.0 / np.sqrt(diagonal[left] + np.where(self._present[span][left], softness[left], 1.0))
            matrices *= scale[:, :, None] * scale[:, None, :]
            np.einsum("nii->ni", matrices)[:] = 1.0
            exact[left] += scale * solve_stack(matrices, (scale * missed[left])[..., None])[..., 0]
        known = ~np.isnan(self._whole[:count])
        exact[known] = self._whole[:count][known]
        self._rows["exact_force"][span] = exact
        self._solved = taken


def solve_stack(matrices: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Solves symmetric systems (n, k, k) for (n, k, m); one that is singular is answered in the least-squares sense."""
    try:
        return np.linalg.solve(matrices, wanted)
    except np.linalg.LinAlgError:
        finite = np.asarray(np.isfinite(matrices)).all(axis=(1, 2), keepdims=True)
        safe = np.where(finite, matrices, 0.0)
        return np.linalg.pinv(safe, hermitian=True) @ wanted
