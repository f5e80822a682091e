"""The exact constrained solution beside a recorded run: the same start, controls, timestep and integrator.

Minimum-norm multipliers, positions and velocities projected after every step; on the native path where it can be taken.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
import polars as pl

from oarlock.base.errors import InputError, RefusedError
from oarlock.cases.case_file import Baumgarte
from oarlock.cases.integrators import INTEGRATORS, SUBSTITUTE
from oarlock.diagnosis.runs.trials import Start
from oarlock.diagnosis.runs.walking import End, own_copy
from oarlock.mechanics.controls import drive
from oarlock.mechanics.curvature import Curvature
from oarlock.mechanics.drive import Drive
from oarlock.mechanics.prepare import integrator_of, set_integrator
from oarlock.poses.layout import Layout, RowColumns
from oarlock.stepping.closing import CONSISTENT
from oarlock.stepping.ending import Ending
from oarlock.stepping.paths import fitting_path
from oarlock.stepping.prepared import Prepared
from oarlock.stepping.projection import TRACKED
from oarlock.stepping.solvers import SolverSpec
from oarlock.tables.promise import ERROR_BOUND

SOLVER = SolverSpec("auto")

FINER = 10
"""Parts of a timestep, by Runge–Kutta, that a run is done anew with where whole ones lose it or cannot be trusted: a
mechanism that a motor drives through a dead point turns back there within one step of the model's own."""

CLOSE = 1e-5
"""rad or m, by a run's own estimate, up to which whole steps of Runge–Kutta are taken without a look at finer ones: a
drift that is seen is a hundred times as large."""

FINER_WORK, MANY = 4_000_000, 30
"""Steps times velocities up to which a run is done anew, some ten seconds; beyond so many velocities a step of each
takes more, in proportion to their number."""

_FIGURES = (
    "time_s",
    "rank",
    "drift_pos",
    "drift_vel",
    "drift_acc",
    "error_estimate",
    "qpos",
    "residual",
    "multipliers",
    "blocked",
    "limit_force",
    "friction_force",
    "contact_force",
)


@dataclass(frozen=True)
class ExactRun:
    """The exact solution; arrays over time are (steps, …), at the start of each step, rows in the layout.

    Attributes:
        integrator: the one that was used; ``note`` says why, where it or its timestep is not the model's own.
        qpos: (steps, nq).
        position: r, m or rad.
        force: minimum-norm multipliers λ, N or N m, in MuJoCo's sign.
        drift: largest r, J v and J a + J̇v of any row, (steps, 3), m or rad, per s, per s².
        rank: of A.
        blocked: limits and contacts that push against loops alone, (steps).
        loads: largest force of a limit, of a friction loss, and of all contacts together, (steps, 3), N or N m.
        error: how far positions are off by the run's own estimate, (steps), m or rad; infinite where it is not known.
        end: ``refused`` where the start could not be solved for; ``diverged`` where a later state could not, or was
            beyond bounds.
    """

    layout: Layout
    integrator: str
    note: str
    timestep_s: float
    time: np.ndarray
    qpos: np.ndarray
    position: np.ndarray
    force: np.ndarray
    present: np.ndarray
    drift: np.ndarray
    rank: np.ndarray
    blocked: np.ndarray
    loads: np.ndarray
    error: np.ndarray
    end: End

    @property
    def doubt(self) -> str:
        """Why nothing of it is to be shown, in words: it left the constraints, or its own estimate; empty otherwise."""
        if self.end.how == "diverged":  # what it showed before proves nothing
            return f"it diverged at t = {self.end.time_s:.6g} s: {self.end.message}"
        opened = ~(self.drift[:, 0] <= CONSISTENT)
        if opened.any():
            at = int(opened.argmax())
            return f"at t = {self.time[at]:.6g} s it stands open by {self.drift[at, 0]:.2g} m or rad: it was lost"
        lost = ~np.isfinite(self.error)
        if lost.any():
            at = f"{self.time[int(lost.argmax())]:.6g}"
            return f"from t = {at} s a walk at half the timestep goes elsewhere, so that nobody knows how far it is off"
        return ""


def record_exact(
    model: mujoco.MjModel,
    qpos: np.ndarray,
    qvel: np.ndarray,
    laws: dict[str, str],
    steps: int,
    *,
    act: np.ndarray | None = None,
    start_s: float = 0.0,
) -> ExactRun:
    """Runs the exact solution from a closed start.

    Where the model's own integrator loses it, or leaves it too far off by its own estimate, that of the highest order
    is tried, then finer steps.

    Args:
        model: the user's; it is left alone. Its contacts, limits and friction are as its flags say.
        qpos: closed start, (nq).
        qvel: start along the constraints, (nv).
        laws: as of ``recording.record``.
        steps: how many.
        act: activations at the start, (na); zero if left out.
        start_s: what the time at the start is called, s: laws begin there at 0.

    Raises:
        InputError: no equality row, or one whose J̇v is not known.
    """
    own, start = own_copy(model), Start(qpos, qvel, act)
    own.opt.jacobian = mujoco.mjtJacobian.mjJAC_AUTO  # MuJoCo's solver is not asked
    asked, note = integrator_of(model), ""
    stuck = model.na and not asked.takes_activations
    if stuck or not asked.runs:
        set_integrator(own, SUBSTITUTE.name)
        note = f"{SUBSTITUTE} in place of {asked}"
        note += f", for the model has {model.na} actuator activation(s)" if stuck else ""
    first = _record(own, start, laws, steps, note, start_s=start_s)
    if _trusted(first) or (first.end.how == "refused" and first.end.time_s <= start_s):  # a start, that no step changes
        return first
    finest = INTEGRATORS["rk4"] if not model.na else SUBSTITUTE
    set_integrator(own, finest.name)
    why = "is too far off" if first.end.how == "finished" else f"was lost at t = {first.end.time_s:.6g} s"
    work, whole = steps * model.nv * max(1.0, model.nv / MANY), first
    for parts, again in (
        (1, f"in place of {first.integrator}, which {why}"),
        (FINER, f"at a tenth of the timestep: with {first.integrator} at the whole one it {why}"),
    ):
        if (parts == 1 and first.integrator == finest.name) or parts * work > FINER_WORK:
            continue
        own.opt.timestep = model.opt.timestep / parts
        run = _record(own, start, laws, steps, f"{note}; {again}" if note else again, parts, start_s=start_s)
        if _trusted(run) and (parts == FINER or float(run.error.max(initial=0.0)) <= CLOSE):
            return run
        whole = run if _trusted(run) else whole
    return whole


def _trusted(run: ExactRun) -> bool:
    """Whether a run got to its end and is, by its own estimate, where the mechanism is."""
    return run.end.how == "finished" and not run.doubt and float(run.error.max(initial=0.0)) <= ERROR_BOUND


def _record(
    own: mujoco.MjModel,
    start: Start,
    laws: dict[str, str],
    steps: int,
    note: str,
    parts: int = 1,
    *,
    start_s: float = 0.0,
) -> ExactRun:
    """A run of a model's own integrator and timestep, of which every ``parts``-th step is kept, ``steps`` in all."""
    data = mujoco.MjData(own)
    data.qpos[:], data.qvel[:] = start.qpos, start.qvel
    layout = Layout.of(own, data.eq_active)
    Curvature(own, data)
    if layout.rows == 0:
        raise InputError("no active equality, expected at least one that closes a loop")
    driven = drive(own, laws, parts)
    prepared = Prepared(own, driven, data.qpos.copy(), data.qvel.copy(), parts * steps, act=start.act)
    path = fitting_path(prepared, Baumgarte())
    # What a quasi-Newton method tracks is dense.
    projector = SOLVER if mujoco.mj_isSparse(own) else TRACKED
    (table,), ending = path.free(SOLVER, "hard", projector, judged=False)
    rows = _Rows(own, layout, steps, driven)
    for chunk in table.chunks(("step", *_FIGURES)):
        rows.take(chunk.filter(pl.col("step") % parts == 0))
    run = rows.run(integrator_of(own).name, note, parts * own.opt.timestep, _end(ending, prepared, parts))
    return replace(run, time=run.time + start_s, end=replace(run.end, time_s=run.end.time_s + start_s))


class _Rows:
    """Takes the rows of the steps, and puts them where the layout has them."""

    def __init__(self, model: mujoco.MjModel, layout: Layout, steps: int, drive: Drive):
        self._model, self._layout, self._drive = model, layout, drive
        self._scratch = mujoco.MjData(model)
        self._columns = RowColumns(layout)
        self.taken = 0
        self.qpos = np.zeros((steps, model.nq))
        self.position, self.force = np.zeros((2, steps, layout.rows))
        self.present = np.zeros((steps, layout.rows), dtype=bool)
        self.drift, self.rank = np.zeros((steps, 3)), np.zeros(steps, int)
        self.error = np.zeros(steps)
        self.blocked, self.loads = np.zeros(steps, int), np.zeros((steps, 3))

    def take(self, chunk: pl.DataFrame) -> None:
        """Takes rows of a table of steps."""
        names = ("time_s", "qpos", "residual", "multipliers")
        vectors = zip(*(chunk[name].to_list() for name in names), strict=True)
        drift = chunk.select("drift_pos", "drift_vel", "drift_acc").to_numpy()
        span = slice(self.taken, self.taken + len(chunk))
        self.error[span] = chunk["error_estimate"].to_numpy()
        self.blocked[span] = chunk["blocked"].fill_null(0).to_numpy()
        self.loads[span] = chunk.select(
            pl.col("limit_force", "friction_force", "contact_force").fill_null(0.0)
        ).to_numpy()
        for (time, qpos, position, force), figures, rank in zip(vectors, drift, chunk["rank"].to_list(), strict=True):
            self._append(time, np.array(qpos), np.array(position), np.array(force), figures, rank)

    def _append(
        self,
        time: float,
        qpos: np.ndarray,
        position: np.ndarray,
        force: np.ndarray,
        drift: np.ndarray,
        rank: int | None,
    ) -> None:
        step = self.taken
        if len(position) == self._layout.rows and not self._drive.switches:
            columns: slice | np.ndarray = slice(None)
        else:  # which rows these are only the pose knows, and what is switched
            self._scratch.qpos[:], self._scratch.time = qpos, time
            self._drive.apply(self._scratch)
            mujoco.mj_fwdPosition(self._model, self._scratch)
            columns = self._columns.of(self._scratch)
        self.qpos[step], self.drift[step], self.rank[step] = qpos, drift, -1 if rank is None else rank
        self.position[step, columns], self.force[step, columns] = position, force
        self.present[step, columns] = True
        self.taken += 1

    def run(self, integrator: str, note: str, timestep: float, end: End) -> ExactRun:
        """What was taken, of which rows are ``timestep`` (s) apart."""
        n = self.taken
        return ExactRun(
            layout=self._layout,
            integrator=integrator,
            note=note,
            timestep_s=timestep,
            time=np.arange(n) * timestep,
            qpos=self.qpos[:n],
            position=self.position[:n],
            force=self.force[:n],
            present=self.present[:n],
            drift=self.drift[:n],
            rank=self.rank[:n],
            blocked=self.blocked[:n],
            loads=self.loads[:n],
            error=self.error[:n],
            end=end,
        )


def _end(ending: Ending | None, prepared: Prepared, parts: int) -> End:
    if ending is None:
        return End("finished", max(0, prepared.steps - parts) * prepared.timestep_s)
    if isinstance(ending.error, RefusedError):
        return End("refused", ending.time_s, ending.reason.partition(", expected")[0])
    if ending.error is not None and ending.step == 0:
        return End("refused", ending.time_s, ending.reason)
    return End("diverged", ending.time_s, ending.reason)
