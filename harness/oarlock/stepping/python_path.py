"""The Python path: walks step by step in plain NumPy. The readable one, and the oracle of the native path.

A row is written when it is seen: begun at the start of a step, where state, question and answer belong together, and
completed once the step is taken.
"""

import copy
import math
import time
from collections.abc import Callable
from typing import Protocol

import mujoco
import numpy as np

from oarlock.base.arrays import largest, relative_difference
from oarlock.base.core import MultiplierSolver
from oarlock.base.errors import DiskError, InputError
from oarlock.cases.case_file import Baumgarte, Form
from oarlock.mechanics.bounds import bounded
from oarlock.mechanics.prepare import integrator_of, unsolved
from oarlock.stepping.ending import Ending
from oarlock.stepping.figures import (
    Row,
    answered,
    gradient,
    loads,
    parity,
    place,
    projecting,
    proving,
    pushing,
    solving,
)
from oarlock.stepping.logged import own_walker
from oarlock.stepping.moving import Moving
from oarlock.stepping.path import SOLVER_BESIDE, SPOOLS, TICK_STEPS, Make, Spools, Tables, Tick, silent
from oarlock.stepping.prepared import Prepared
from oarlock.stepping.projection import Projector
from oarlock.stepping.question import Question, SolvedForce
from oarlock.stepping.solvers import MUJOCO, SolverSpec
from oarlock.stepping.state import State
from oarlock.stepping.walkers import ForcedWalker, MujocoForce, Walker, is_sane, walk
from oarlock.tables.columns import table_of_rows
from oarlock.tables.figures import Walk
from oarlock.tables.spool import Spool

Asked = tuple[Form, list[MultiplierSolver]]
"""A form, and who answers in it."""

HELD_ROWS = 1000
"""Rows that are kept as dictionaries at most."""


class Experiment(Protocol):
    """One walk and whoever answers along it."""

    @property
    def walk(self) -> Walk:
        """Which walk it is."""
        ...

    @property
    def walker(self) -> Walker:
        """Who walks."""
        ...

    def begin(self, step: int) -> list[Row]:
        """The rows of a step, one of each who answers, as far as they are known before it is taken."""
        ...

    def complete(self, rows: list[Row]) -> None:
        """Adds what is known once the step is taken."""


class PythonPath:
    """The walks of what is prepared, as ``Path``."""

    name = "python"

    def __init__(
        self,
        prepared: Prepared,
        terms: Baumgarte,
        make: Make = SolverSpec.make,
        tick: Tick = silent,
        spools: Spools = SPOOLS,
    ):
        self._prepared, self._terms, self._make, self._tick, self._spools = prepared, terms, make, tick, spools

    def calibration(self) -> Tables:
        """As ``Path``."""
        return self._walk(Calibration(self._prepared))

    def lockstep(
        self,
        walker: SolverSpec,
        projector: SolverSpec | None,
        forms: tuple[Form, ...],
        solvers: tuple[SolverSpec, ...],
    ) -> Tables:
        """As ``Path``."""
        make = self._make
        leader = None if walker.name == MUJOCO else make(walker)
        asked: list[Asked] = [(form, [make(spec) for spec in solvers]) for form in forms]
        experiment = Lockstep(self._prepared, self._terms, leader, projector, asked)
        return self._walk(experiment, len(forms) * len(solvers))

    def one_step(self, forms: tuple[Form, ...], solvers: tuple[SolverSpec, ...]) -> Tables:
        """As ``Path``."""
        asked: list[tuple[Form, MultiplierSolver]] = [(form, self._make(spec)) for form in forms for spec in solvers]
        return self._walk(OneStep(self._prepared, self._terms, asked), len(asked))

    def free(
        self,
        solver: SolverSpec,
        form: Form | None,
        projector: SolverSpec | None,
        *,
        judged: bool = True,
    ) -> Tables:
        """As ``Path``."""
        if form is None:
            return self._walk(FreeMujoco(self._prepared, self._terms))
        beside = self._make(SOLVER_BESIDE) if form == "hard" else None
        halved = Halved(self._prepared, self._terms, beside, projector) if beside else None
        made, judge = self._make(solver), Companion(self._prepared) if judged else None
        return self._walk(FreeSolved(self._prepared, self._terms, form, made, projector, halved, judge))

    def _walk(self, experiment: Experiment, count: int = 1) -> Tables:
        """Walks all steps; ``count`` is the number of those who answer."""
        tables = [_Table(experiment.walk, spool) for spool in self._spools(count)]
        # A run that diverges overflows on its way; it ends with a status, not with warnings.
        with self._prepared.drive.installed(), np.errstate(over="ignore", invalid="ignore"):
            ending = self._take_steps(experiment, tables)
        return [table.whole() for table in tables], ending

    def _take_steps(self, experiment: Experiment, tables: list["_Table"]) -> Ending | None:
        recorder, steps = _Recorder(experiment, tables), self._prepared.steps
        try:
            for step in walk(recorder, steps):
                if step > 0 and step % TICK_STEPS == 0:
                    self._tick(TICK_STEPS)
        except DiskError:  # no question of the walk: its table cannot be kept
            raise
        except InputError as error:
            return Ending(recorder.taken, recorder.data.time, error)
        if not is_sane(recorder.data):
            return Ending(recorder.taken - 1, recorder.data.time)
        if recorder.taken < steps:
            return Ending(recorder.taken, recorder.data.time)
        self._tick((steps - 1) % TICK_STEPS + 1)
        return None


class _Recorder:
    """The walker of an experiment, which writes the rows of its steps."""

    def __init__(self, experiment: Experiment, tables: list["_Table"]):
        self._experiment, self._tables = experiment, tables
        self._walker = experiment.walker
        self.data = self._walker.data
        self.taken = 0

    def look(self) -> None:
        """As ``Walker``; begins the rows."""
        began = time.perf_counter()
        self._walker.look()
        self._look_s = time.perf_counter() - began
        self._rows = self._experiment.begin(self.taken) if bounded(self.data.qacc) else []

    def step(self) -> None:
        """As ``Walker``; completes the rows."""
        began = time.perf_counter()
        self._walker.step()
        step_us = 1e6 * (time.perf_counter() - began + self._look_s)
        self._experiment.complete(self._rows)
        for table, row in zip(self._tables, self._rows, strict=True):
            table.append({**row, "step_us": step_us})
        self.taken += 1

    def mujoco_answer(self) -> tuple[np.ndarray, np.ndarray]:
        """As ``Walker``."""
        return self._walker.mujoco_answer()


class _Table:
    """The rows of one who answers."""

    def __init__(self, walk: Walk, spool: Spool):
        self._walk: Walk = walk
        self._spool = spool
        self._rows: list[Row] = []

    def append(self, row: Row) -> None:
        self._rows.append(row)
        if len(self._rows) >= HELD_ROWS:
            self.whole()

    def whole(self) -> Spool:
        self._spool.append(table_of_rows(self._walk, self._rows))
        self._rows = []
        return self._spool


class Companion:
    """MuJoCo's own trajectory, beside another one. Run it inside ``drive.installed()``, as ``MujocoWalker``.

    A log of states takes its place, unless it is to be the ``model``'s.
    """

    def __init__(self, prepared: Prepared, *, model: bool = False):
        self._prepared = prepared
        states = None if model else prepared.states
        self._walker = own_walker(prepared.model, prepared.data(), prepared.drive, states)

    def compare(self, qpos: np.ndarray) -> float | None:
        """How far positions are from it (rad or m), None where it did not get to; then takes its next step."""
        data = self._walker.data
        if not is_sane(data):
            return None
        apart = self._prepared.apart(data.qpos, qpos)
        self._walker.look()
        self._walker.step()
        return apart


class Halved:
    """A walk in the hard form with half the timestep and its own solver, beside the one that it tells the error of.

    The error of the other's steps and that of its solver, which this one does not share.
    """

    def __init__(self, prepared: Prepared, terms: Baumgarte, solver: MultiplierSolver, projector: SolverSpec | None):
        self._prepared = prepared
        model = unsolved(prepared.model, 0.5 * prepared.timestep_s)
        data = prepared.data(model)
        moving = Moving.of(model, prepared.drive)
        force = SolvedForce(State(model, data, terms, moving), "hard", solver)
        last = Projector(model, solver=projector, left=prepared.left, moving=moving) if projector else None
        self._walker = ForcedWalker(model, data, prepared.drive, force, last, moving, follows=True)
        # The whole error over the part of it that halving takes away (Richardson).
        finer = 2.0 ** integrator_of(model).order
        self._scale = finer / (finer - 1.0)
        self._alive = True

    def compare(self, ours: mujoco.MjData) -> Row:
        """How far a state of the other walk is off (rad or m), infinite where this one was lost; takes two steps."""
        self._go_on(self._look)
        prepared, theirs = self._prepared, self._walker.data
        whole = prepared.apart(theirs.qpos, ours.qpos) if self._alive else None
        row: Row = {"error_estimate": math.inf if whole is None else self._scale * whole}
        if prepared.observed is not None:
            place = prepared.observed.position
            seen = float(largest(place(ours) - place(theirs))) if self._alive else math.inf
            row["truth_error_estimate"] = self._scale * seen
        for call in (self._step, self._look, self._step):
            self._go_on(call)
        return row

    def _look(self) -> bool:
        self._walker.look()
        return bounded(self._walker.data.qacc)

    def _step(self) -> bool:
        self._walker.step()
        return is_sane(self._walker.data)

    def _go_on(self, call: Callable[[], bool]) -> None:
        """What ends it does not end the walk that it is beside."""
        if self._alive:
            try:
                self._alive = call()
            except InputError:
                self._alive = False


class Calibration:
    """MuJoCo's own force through our stepping, beside MuJoCo."""

    walk: Walk = "calibration"

    def __init__(self, prepared: Prepared):
        self._prepared = prepared
        model = prepared.model
        self.walker = ForcedWalker(model, prepared.data(), prepared.drive, MujocoForce(model))
        self._theirs = Companion(prepared, model=True)
        self._moving = Moving.of(model, prepared.drive)

    def begin(self, step: int) -> list[Row]:
        """As ``Experiment``."""
        data = self.walker.data
        apart, rate = self._theirs.compare(data.qpos), None
        if self._moving is not None:
            self._moving.begin(data)
            rate = data.efc_vel[: data.ne] + self._moving.rate(data)
        return [{**place(self._prepared, step, data, rate), "status": "converged", "trajectory_diff": apart}]

    def complete(self, rows: list[Row]) -> None:
        """Nothing is left to say."""


class Lockstep:
    """Everyone answers the same questions along one walk: MuJoCo's, or a solver's in the hard form."""

    walk: Walk = "lockstep"

    def __init__(
        self,
        prepared: Prepared,
        terms: Baumgarte,
        leader: MultiplierSolver | None,
        projector: SolverSpec | None,
        asked: list[Asked],
    ):
        self._prepared = prepared
        model, data = prepared.model, prepared.data()
        self._moving = moving = Moving.of(model, prepared.drive)
        self._state = State(model, data, terms, moving)
        self._force = None if leader is None else SolvedForce(self._state, "hard", leader)
        self._projector: Projector | None = None
        if projector and leader:
            self._projector = Projector(model, solver=projector, left=prepared.left, moving=moving)
        self.walker: Walker = own_walker(model, data, prepared.drive, prepared.states)
        if self._force is not None:
            self.walker = ForcedWalker(model, data, prepared.drive, self._force, self._projector, moving, follows=True)
        self._asked = [(Question(self._state, form), solvers) for form, solvers in asked]

    def begin(self, step: int) -> list[Row]:
        """As ``Experiment``, form by form."""
        state = self._state
        if self._moving is not None:
            self._moving.begin(state.data)
        qacc, qfrc = self.walker.mujoco_answer()  # first: it may make the rows anew
        state.read()
        theirs = gradient(state, qacc, qfrc)
        rows = []
        for question, solvers in self._asked:
            question.ask()
            inequalities, remembered = question.inequalities, False
            for solver in solvers:
                answer = question.answer(solver)
                if not remembered and answer.info.status == "converged":
                    inequalities.remember(answer.qacc)
                    remembered = True
                minimum, known = question.reference(solver)
                row = answered(self._prepared, step, state, answer.qacc, answer.multipliers)
                pushed = {**pushing(state.others, inequalities), **proving(inequalities.pushes), **theirs}
                rows.append({**row, **parity(answer, minimum, qacc, qfrc), **solving([answer.info], known), **pushed})
        return rows

    def complete(self, rows: list[Row]) -> None:
        """As ``Experiment``: the projection of the walk."""
        for row in rows:
            row.update(projecting(self._projector))
        if self._force is not None:
            self._force.take_infos()
            self._force.take_pushes()


class OneStep:
    """From each of MuJoCo's states, one step of everyone."""

    walk: Walk = "one-step"

    def __init__(self, prepared: Prepared, terms: Baumgarte, asked: list[tuple[Form, MultiplierSolver]]):
        self._prepared = prepared
        self.walker = own_walker(prepared.model, prepared.data(), prepared.drive, prepared.states)
        model = copy.copy(prepared.model)  # MuJoCo's own steps may change theirs: see newton.confirm
        self._data = prepared.data(model)
        drive, moving = prepared.drive, Moving.of(model, prepared.drive)
        self._state = State(model, self._data, terms, moving)
        forces = [SolvedForce(self._state, form, solver) for form, solver in asked]
        self._ours = [
            (force, ForcedWalker(model, self._data, drive, force, None, moving, follows=force.question.form == "hard"))
            for force in forces
        ]
        self._reached: list[np.ndarray] = []

    def begin(self, step: int) -> list[Row]:
        """As ``Experiment``; takes the steps of all but MuJoCo."""
        prepared, theirs, ours = self._prepared, self.walker.data, self._data
        self._reached, rows = [], []
        for force, walker in self._ours:
            ours.qpos[:], ours.qvel[:], ours.act[:] = theirs.qpos, theirs.qvel, theirs.act
            ours.time = theirs.time
            walker.look()
            row = answered(prepared, step, self._state, ours.qacc, ours.efc_force[: ours.ne])
            row.update(pushing(self._state.others, force.question.inequalities))
            walker.step()
            infos = force.take_infos()
            rows.append({**row, **solving(infos, infos[0]), **proving(force.take_pushes())})
            self._reached.append(ours.qpos.copy())
        return rows

    def complete(self, rows: list[Row]) -> None:
        """As ``Experiment``: how far MuJoCo's step went elsewhere."""
        for row, qpos in zip(rows, self._reached, strict=True):
            row["trajectory_diff"] = self._prepared.apart(self.walker.data.qpos, qpos)


class FreeMujoco:
    """MuJoCo walks alone."""

    walk: Walk = "mujoco"

    def __init__(self, prepared: Prepared, terms: Baumgarte):
        self._prepared = prepared
        data = prepared.data()
        self.walker = own_walker(prepared.model, data, prepared.drive, prepared.states)
        self._moving = Moving.of(prepared.model, prepared.drive)
        self._state = State(prepared.model, data, terms, self._moving)
        self._energy = prepared.energy()

    def begin(self, step: int) -> list[Row]:
        """As ``Experiment``."""
        prepared, data = self._prepared, self.walker.data
        if self._moving is not None:
            self._moving.begin(data)
        self._state.read()
        iterations = self.walker.iterations
        return [
            {
                **answered(prepared, step, self._state, data.qacc, data.efc_force[: data.ne]),
                **loads(self._state.others, data.efc_force[data.ne :]),
                "status": "converged",
                "solves": 1,
                "unconverged": 0,
                "iterations": iterations,
                "iterations_worst": iterations,
                **self._energy.of(data),
                **prepared.published.errors(step, data),
            }
        ]

    def complete(self, rows: list[Row]) -> None:
        """Nothing is left to say."""


class FreeSolved:
    """A solver walks, where it is judged beside MuJoCo as configured; a projector may end its steps."""

    def __init__(
        self,
        prepared: Prepared,
        terms: Baumgarte,
        form: Form,
        solver: MultiplierSolver,
        projector: SolverSpec | None,
        halved: Halved | None,
        theirs: Companion | None,
    ):
        self.walk: Walk = "free" if theirs else "alone"
        self._prepared = prepared
        model = unsolved(prepared.model, prepared.timestep_s)
        data = prepared.data(model)
        moving, last = Moving.of(model, prepared.drive), None
        self._state = State(model, data, terms, moving)
        self._force = SolvedForce(self._state, form, solver)
        if projector:
            last = Projector(model, solver=projector, left=prepared.left, moving=moving)
        self._projector = last
        self.walker = ForcedWalker(model, data, prepared.drive, self._force, last, moving, follows=form == "hard")
        self._theirs, self._halved = theirs, halved
        self._energy = prepared.energy()

    def begin(self, step: int) -> list[Row]:
        """As ``Experiment``; its solves are counted when the step is taken."""
        prepared, data = self._prepared, self.walker.data
        multipliers = data.efc_force[: data.ne]
        judgement: Row = {}
        if self._theirs:
            minimum, self._known = self._force.question.reference(self._force.solver)
            judgement["min_norm_error"] = float(relative_difference(multipliers, minimum))
            judgement["trajectory_diff"] = self._theirs.compare(data.qpos)
        else:
            self._known = self._force.info
        return [
            {
                **answered(prepared, step, self._state, data.qacc, multipliers),
                **pushing(self._state.others, self._force.question.inequalities),
                **judgement,
                **(self._halved.compare(data) if self._halved else {}),
                **self._energy.of(data),
                **prepared.published.errors(step, data),
            }
        ]

    def complete(self, rows: list[Row]) -> None:
        """As ``Experiment``: solves and projection."""
        rows[0].update(solving(self._force.take_infos(), self._known), **projecting(self._projector))
        rows[0].update(proving(self._force.take_pushes()))
