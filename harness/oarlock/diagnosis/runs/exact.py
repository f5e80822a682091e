"""The exact constrained solution beside a recorded run: the same start, controls, timestep and integrator.

Minimum-norm multipliers, positions and velocities projected after every step; on the native path where it can be taken.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base import core
from oarlock.base.errors import InputError, RefusedError, one_line
from oarlock.cases.case_file import Baumgarte
from oarlock.diagnosis.loops.layout import Layout, RowColumns
from oarlock.diagnosis.runs.controls import drive
from oarlock.diagnosis.runs.walking import End, integrator_name, own_copy
from oarlock.mechanics.curvature import Curvature
from oarlock.mechanics.inequalities import refuse_inequalities
from oarlock.mechanics.prepare import INTEGRATORS
from oarlock.stepping import native_path
from oarlock.stepping.figures import drift
from oarlock.stepping.projection import TRACKED, Projector
from oarlock.stepping.question import SolvedForce
from oarlock.stepping.solvers import REFERENCE, SolverSpec
from oarlock.stepping.state import State
from oarlock.stepping.walkers import ForcedWalker, is_finite

SOLVER = SolverSpec("auto")

_TICK = 200


@dataclass(frozen=True)
class ExactRun:
    """The exact solution; arrays over time are (steps, …), at the start of each step, rows in the layout.

    Attributes:
        integrator: the one that was used; ``note`` says why, where it is not the model's own.
        qpos: (steps, nq).
        position: r, m or rad.
        force: minimum-norm multipliers λ, N or N m, in MuJoCo's sign.
        drift: largest r, J v and J a + J̇v of any row, (steps, 3), m or rad, per s, per s².
        rank: of A.
        end: ``refused`` where a contact, limit or friction became active, which the exact solution does not know.
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
    end: End


def record_exact(
    model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray, laws: dict[str, str], steps: int
) -> ExactRun:
    """Runs the exact solution from a closed start.

    Args:
        model: the user's; it is left alone. Its contacts, limits and friction are as its flags say.
        qpos: closed start, (nq).
        qvel: start along the constraints, (nv).
        laws: as of ``recording.record``.
        steps: how many.

    Raises:
        InputError: no equality row, or one whose J̇v is not known.
    """
    own = own_copy(model)
    own.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    asked, note = integrator_name(model), ""
    if asked == "discrete":
        own.opt.integrator, note = INTEGRATORS["implicitfast"], "implicitfast in place of discrete"
    elif asked == "rk4" and model.na:
        own.opt.integrator = INTEGRATORS["implicitfast"]
        note = f"implicitfast in place of rk4, for the model has {model.na} actuator activation(s)"
    data = mujoco.MjData(own)
    data.qpos[:], data.qvel[:] = qpos, qvel
    layout = Layout.of(own, data.eq_active)
    Curvature(own, data)
    if layout.rows == 0:
        raise InputError("no active equality, expected at least one that closes a loop")
    rows = _Rows(own, layout, steps)
    walk = _python if native_path.refusal() else _native
    end = walk(own, data, laws, steps, rows)
    return rows.run(integrator_name(own), note, end)


class _Rows:
    """Takes the rows of the steps, and puts them where the layout has them."""

    def __init__(self, model: mujoco.MjModel, layout: Layout, steps: int):
        self._model, self._layout = model, layout
        self._scratch = mujoco.MjData(model)
        self._columns = RowColumns(layout)
        self.taken = 0
        self.qpos = np.zeros((steps, model.nq))
        self.position, self.force = np.zeros((2, steps, layout.rows))
        self.present = np.zeros((steps, layout.rows), dtype=bool)
        self.drift, self.rank = np.zeros((steps, 3)), np.zeros(steps, int)

    def append(
        self, qpos: np.ndarray, position: np.ndarray, force: np.ndarray, drift: np.ndarray, rank: int | None
    ) -> None:
        step = self.taken
        if len(position) == self._layout.rows:
            columns: slice | np.ndarray = slice(None)
        else:  # which rows these are only the pose knows
            self._scratch.qpos[:] = qpos
            mujoco.mj_fwdPosition(self._model, self._scratch)
            columns = self._columns.of(self._scratch)
        self.qpos[step], self.drift[step], self.rank[step] = qpos, drift, -1 if rank is None else rank
        self.position[step, columns], self.force[step, columns] = position, force
        self.present[step, columns] = True
        self.taken += 1

    def run(self, integrator: str, note: str, end: End) -> ExactRun:
        n, timestep = self.taken, float(self._model.opt.timestep)
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
            end=end,
        )


def _finished(steps: int, model: mujoco.MjModel) -> End:
    return End("finished", max(0, steps - 1) * float(model.opt.timestep))


def _native(model: mujoco.MjModel, data: mujoco.MjData, laws: dict[str, str], steps: int, rows: _Rows) -> End:
    setup = core.Setup(
        model,
        qpos=data.qpos.copy(),
        qvel=data.qvel.copy(),
        laws=drive(model, laws).laws,
        beta=0.0,
        k=0.0,
        observed=None,
        conserved=False,
        snapshots=[],
    )
    run = setup.free_solved(steps, "hard", SOLVER.make(), SolverSpec(REFERENCE).make(), TRACKED.make())
    left = steps
    while left > 0:
        asked = min(_TICK, left)
        taken = run.advance(asked)
        _take_over(run.tables()[0], rows)
        left -= taken
        if taken < asked:
            break
    if run.end is None:
        return _finished(steps, model)
    _, time, kind, message = run.end
    if kind == "inequalities":
        data.qpos[:], data.qvel[:], _ = run.state
        data.time = time
        message = _refusal(model, data)
    how = "refused" if kind in ("inequalities", "refused") else "diverged"
    return End(how, time, one_line(message) or f"the state is no longer finite at t = {time:.6g} s")


def _refusal(model: mujoco.MjModel, data: mujoco.MjData) -> str:
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    try:
        refuse_inequalities(model, data)
    except RefusedError as error:
        return str(error).partition(", expected")[0]
    return ""


def _take_over(columns: dict, rows: _Rows) -> None:
    if "step" not in columns:
        return
    qpos, position, force = (_lists(columns[name]) for name in ("qpos", "residual", "multipliers"))
    drift = np.stack([columns[f"drift_{level}"].values for level in ("pos", "vel", "acc")], axis=1)
    for step, rank in enumerate(columns["rank"].values.tolist()):
        rows.append(qpos[step], position[step], force[step], drift[step], rank)


def _lists(column: core.Column) -> list[np.ndarray]:
    return np.split(column.values, np.cumsum(np.asarray(column.lengths, dtype=int))[:-1])


def _python(model: mujoco.MjModel, data: mujoco.MjData, laws: dict[str, str], steps: int, rows: _Rows) -> End:
    state = State(model, data, Baumgarte())
    force = SolvedForce(state, "hard", SOLVER.make())
    walker = ForcedWalker(model, data, drive(model, laws), force, Projector(model, solver=TRACKED))
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(steps):
            time = float(data.time)
            try:
                walker.look()
                rank = force.take_infos()[0].rank
                figures = np.array(drift(state, data.qacc))
                rows.append(data.qpos, state.residual[: data.ne], data.efc_force[: data.ne], figures, rank)
                walker.step()
            except RefusedError as error:
                return End("refused", time, str(error).partition(", expected")[0])
            except InputError as error:
                return End("diverged", time, one_line(error))
            if not is_finite(data):
                return End("diverged", time, f"the state is no longer finite at t = {time:.6g} s")
            force.take_infos()
    return _finished(steps, model)
