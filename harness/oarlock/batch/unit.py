"""A unit of a suite: one walk of one case. Any process can do it, on any machine that has oarlock and the model.

``run_unit`` gives everything back and writes nothing, so that whoever asks keeps it, and a unit that is killed leaves
nothing behind.
"""

import io
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import polars as pl

from oarlock.base.errors import InputError, one_line
from oarlock.base.hashing import of_document, of_file
from oarlock.base.pulse import beat
from oarlock.batch import digest
from oarlock.cases.case import Case
from oarlock.cases.conditions import Conditions
from oarlock.cases.integrators import INTEGRATORS
from oarlock.cases.point import OWN, TIMESTEP, Point
from oarlock.experiments.description import describe
from oarlock.experiments.laboratory import Laboratory
from oarlock.experiments.opening import open_case
from oarlock.experiments.plan import plan
from oarlock.experiments.sketch import sketch, traced
from oarlock.experiments.task import Task, Walk
from oarlock.mechanics.fatal import mujoco_ends_in_a_line
from oarlock.stepping.prepared import PreparedCase
from oarlock.stepping.solvers import MUJOCO, SolverSpec
from oarlock.tables.aggregate import summarise
from oarlock.tables.folder import GROUP
from oarlock.tables.ledger import Failure, Outcome
from oarlock.tables.schema import RunResult


@dataclass(frozen=True)
class Unit:
    """One walk.

    Attributes:
        case: what ``load_case`` takes.
        task: names a single walk; in lockstep and one-step every form × solver is answered along it.
        runs: names of the runs that it gives, in order; the first one is the unit's own name.
        digest: of all that it hangs on.
        cost: guess of its duration, for the order of the units only.
        first: whether it also describes the model.
        point: of a sweep; the case's own runs have an empty one.
    """

    case: str
    task: Task
    runs: tuple[str, ...]
    digest: str
    cost: float
    first: bool = False
    point: Point = OWN

    @property
    def name(self) -> str:
        """Unique within its case."""
        return f"{self.runs[0]}-at-{self.point}" if self.point else self.runs[0]

    @property
    def label(self) -> str:
        """For the reader of a log."""
        more = f" and {len(self.runs) - 1} more" if len(self.runs) > 1 else ""
        return f"{Path(self.case).name if '/' in self.case else self.case} {self.name}{more}"


def plan_units(asked: str, case: Case) -> list[Unit]:
    """The units of a case, in the order of its experiments, those of its sweep last.

    A run that two experiments name belongs to the first.

    Raises:
        InputError: as ``plan``.
    """
    inputs = digest.of_case(case)
    units: list[Unit] = []
    taken: set[str] = set()
    for task in plan(case):
        for walk in task.walks():
            new = tuple(name for name in walk.names if name not in taken)
            taken.update(new)
            if new:
                mark = _mark(inputs, walk.task, new, not units)
                units.append(Unit(asked, walk.task, new, mark, _cost(case, walk, None), not units))
    sweep = case.file.sweep
    if sweep and case.parameters == case.file.parameters:
        points = [Point(((TIMESTEP, timestep_s),)) for timestep_s in sweep.timesteps_s]
        tasks = []
        for integrator in sweep.integrators:
            base = Task("free", SolverSpec(MUJOCO), ("hard",), (), integrator, "default")
            tasks += [replace(base, solvers=(SolverSpec.parse(text),)) for text in sweep.solvers]
            for settings in sweep.settings:
                case.file.setting(settings)
                tasks.append(replace(base, solvers=(SolverSpec(MUJOCO),), settings=settings))
        units += units_at(asked, case, points, tasks)
    return units


def units_at(asked: str, case: Case, points: Sequence[Point], tasks: Sequence[Task]) -> list[Unit]:
    """A unit a point and walk of the tasks, in this order.

    Raises:
        InputError: a parameter that the case does not have, or a fraction where an integer is expected.
    """
    inputs = digest.of_case(case)
    units = []
    for point in points:
        here = point.of(case)
        there = _inputs_at(inputs, case, point)
        for walk in (walk for task in tasks for walk in task.walks()):
            cost = _cost(here, walk, point.get(TIMESTEP))
            mark = _mark(there, walk.task, walk.names, False)
            units.append(Unit(asked, walk.task, walk.names, mark, cost, point=point))
    return units


def _inputs_at(inputs: str, case: Case, point: Point) -> str:
    """The digest of a case at a point, from that of the case: other parameters may have a truth of their own."""
    here = point.of(case)
    other = here.truth_path if here.parameters != case.parameters else None
    return of_document([inputs, point.values, other and of_file(other)]) if point else inputs


def _mark(inputs: str, task: Task, runs: tuple[str, ...], first: bool) -> str:
    return of_document([inputs, repr(task), runs, first])


def _cost(case: Case, walk: Walk, timestep_s: float | None) -> float:
    """Steps × questions a step, dearer for larger mechanisms. Seconds, very roughly."""
    steps = case.file.run.duration_s / (timestep_s or case.file.run.timestep_s or 1e-3)
    stages = INTEGRATORS[walk.task.integrator].stages
    solved = any(solver.name != MUJOCO for solver, _ in walk.answers)
    questions = stages + (1 + len(walk.answers) if solved else 0)
    try:
        size = int(case.expected().get("nv", 10))
    except InputError:
        size = 10
    return steps * questions * (20e-6 + 5e-8 * size**2)


def run_unit(unit: Unit) -> Outcome:
    """Does a unit. A mistake or an error ends in its outcome, never in an exception."""
    began = time.perf_counter()
    try:
        with mujoco_ends_in_a_line(unit.case):
            outcome = _run(unit)
    except InputError as error:
        outcome = Outcome(Failure("refused", one_line(error)))
    except Exception as error:
        outcome = Outcome(Failure("failed", one_line(f"{type(error).__name__}: {error}")))
    return replace(outcome, seconds=time.perf_counter() - began)


def _run(unit: Unit) -> Outcome:
    case = open_case(unit.case)
    if unit.digest != expected_digest(unit, case):
        raise InputError(f"'{case.name}' is not what it was when the suite was planned: files or versions differ")
    laboratory = Laboratory(unit.point.of(case), Conditions.at(unit.point), tick=beat)
    results = [result for result in laboratory.run(unit.task) if result.key.slug in unit.runs]
    found = tuple(result.key.slug for result in results)
    if found != unit.runs:
        raise RuntimeError(f"gave the runs {found}, planned were {unit.runs}")
    rows = [summarise(result) for result in results]
    if unit.point:
        size = _size(laboratory.setup(unit.task.integrator, unit.task.settings))
        point = dict(unit.point.values)
        return Outcome(rows=[{"run": row["run"], "point": point, **size, **row} for row in rows])
    outcome = Outcome(rows=rows, files={f"steps/{r.key.slug}.parquet": _steps(r) for r in results})
    return _described(outcome, laboratory, unit.task, results[0]) if unit.first else outcome


def expected_digest(unit: Unit, case: Case) -> str:
    """The unit's digest, computed anew from the files and versions that are here."""
    inputs = _inputs_at(digest.of_case(case), case, unit.point)
    return _mark(inputs, unit.task, unit.runs, unit.first)


def _size(setup: PreparedCase) -> dict[str, Any]:
    """What a point makes of the model and of its start."""
    start = setup.start
    size = {"nv": int(setup.model.nv), "rows": start.rows, "rank": start.rank, "dof": start.dof}
    return {**size, "closing_moved": start.moved}


def _described(outcome: Outcome, laboratory: Laboratory, task: Task, result: RunResult) -> Outcome:
    setup = laboratory.setup(task.integrator, task.settings)
    drawing = sketch(setup.model, setup.start.qpos, traced(result.steps)) if len(result.steps) else None
    truth = {} if setup.truth is None else {"truth.parquet": _parquet(setup.truth)}
    return replace(outcome, files={**outcome.files, **truth}, model=describe(setup), sketch=drawing)


def _steps(result: RunResult) -> bytes:
    buffer = io.BytesIO()
    result.table().sink_parquet(buffer, compression="zstd", row_group_size=GROUP)
    return buffer.getvalue()


def _parquet(table: pl.DataFrame) -> bytes:
    buffer = io.BytesIO()
    table.write_parquet(buffer, compression="zstd")
    return buffer.getvalue()
