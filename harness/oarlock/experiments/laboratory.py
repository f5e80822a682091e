"""Turns tasks into finished runs: takes their walks on the native path or on the Python path."""

import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Event

from oarlock.base.core import MultiplierSolver
from oarlock.base.errors import InputError
from oarlock.cases.case import Case
from oarlock.cases.case_file import Baumgarte
from oarlock.cases.conditions import OWN, Conditions
from oarlock.cases.integrators import IntegratorName
from oarlock.cases.truth import load_truth
from oarlock.experiments.modes import MODES
from oarlock.experiments.task import Task, Walk
from oarlock.stepping import native_path
from oarlock.stepping.beginning import Beginning
from oarlock.stepping.ending import Ending
from oarlock.stepping.native_path import NativePath
from oarlock.stepping.path import Path as SteppingPath
from oarlock.stepping.path import Spools, Tick, silent
from oarlock.stepping.prepared import PreparedCase
from oarlock.stepping.projection import TRACKED
from oarlock.stepping.python_path import PythonPath
from oarlock.stepping.solvers import SolverSpec
from oarlock.stepping.start import ConsistentStart
from oarlock.tables.promise import ended
from oarlock.tables.schema import SCHEMA, RunKey, RunResult
from oarlock.tables.spool import Spool, spools


class _StoppedError(Exception):
    """The runs beside this one came to an end that is also its own."""


class Laboratory:
    """Runs the tasks of one case under some conditions.

    Args:
        case: what is run.
        conditions: where they are not the case's own.
        stepping: which path steps, as of ``RunOptions``.
        tick: is told of the steps that were done.
        folder: keeps for the time being what is too long for the memory; None: where the system keeps such.
    """

    def __init__(
        self,
        case: Case,
        conditions: Conditions = OWN,
        *,
        stepping: str = "auto",
        tick: Tick = silent,
        folder: Path | None = None,
    ):
        self.case, self.conditions = case, conditions
        self._told = tick
        self._stopped = Event()
        # Not always the system's own folder: that may be memory, and where the results go there must be room anyway.
        self._spools: Spools = partial(spools, schema=SCHEMA, folder=folder)
        # It knows the case's own start only.
        self._truth = load_truth(case) if conditions.seed is None and conditions.motion.states is None else None
        self._stepping = stepping
        self._setups: dict[tuple[IntegratorName, str], PreparedCase] = {}
        self._start: ConsistentStart | None = None
        self._commanded: Beginning | None = None

    def setup(self, integrator: IntegratorName, settings: str = "default") -> PreparedCase:
        """The case, prepared anew; its start is looked for once, for it is the same for all of them."""
        given = (self.conditions, self._start, self._commanded)
        prepared = PreparedCase(self.case, self._truth, integrator, settings, *given)
        self._start = prepared.start
        if self.conditions.motion.controller is not None:
            self._commanded = prepared.begins
        return prepared

    def run(self, task: Task) -> Iterator[RunResult]:
        """The runs of a task, each as soon as it is finished.

        Raises:
            InputError: the model or the task cannot be run as asked.
        """
        for walk in self._walks(task):
            yield from walk()

    def run_all(self, tasks: list[Task], threads: int) -> Iterator[RunResult]:
        """The runs of many tasks in their order, natively on so many threads at once; each as soon as it is its turn.

        Raises:
            InputError: as ``run``; what comes before is given out first.
        """
        if threads == 1 or self._on_python() or self._moved(tasks):
            for task in tasks:
                yield from self.run(task)
            return
        with ThreadPoolExecutor(threads) as pool:
            # Setting up is not for threads: MuJoCo's warnings go through one hook of the process.
            walks = [pool.submit(walk) for task in tasks for walk in self._walks(task)]
            try:
                for walk in walks:
                    yield from walk.result()
            except BaseException:
                self._stopped.set()
                pool.shutdown(cancel_futures=True)
                raise

    def _tick(self, steps: int) -> None:
        if self._stopped.is_set():
            raise _StoppedError
        self._told(steps)

    def _walks(self, task: Task) -> Iterator[Callable[[], list[RunResult]]]:
        """The walks of a task, each set up and ready to be taken; gives the runs of all who answer along it."""
        setup = self._shared(task.integrator, task.settings)
        path = self._path(task, setup)
        return (partial(self._take, walk, setup, path) for walk in task.walks())

    def _take(self, walk: Walk, setup: PreparedCase, path: SteppingPath) -> list[RunResult]:
        projector = TRACKED.with_defaults(rank_cut=self.case.file.rank_cut) if walk.task.projected else None
        tables = _tables(path, walk, projector)
        keys = walk.keys(self.case.name, setup.timestep_s, setup.steps, path.name)
        return [
            _result(key, steps, ending.message() if ending else "")
            for key, (steps, ending) in zip(keys, tables, strict=True)
        ]

    def _shared(self, integrator: IntegratorName, settings: str) -> PreparedCase:
        """A setup for all walks that ask for the same: they leave it as it is."""
        if (integrator, settings) not in self._setups:
            self._setups[integrator, settings] = self.setup(integrator, settings)
        return self._setups[integrator, settings]

    def _on_python(self) -> bool:
        """Whether steps are taken on the Python path; says why where that was not asked for."""
        if self._stepping == "python":
            return True
        refusal = native_path.refusal()
        if refusal and self._stepping == "native":
            raise InputError(f"no native stepping: {refusal}")
        if refusal:
            warnings.warn(f"stepping in Python, which is slower: {refusal}", stacklevel=2)
        return bool(refusal)

    def _moved(self, tasks: list[Task]) -> bool:
        """Whether the tasks, which have one drive, are not for threads: MuJoCo's hook for controls is the process's."""
        return any(self._refused(self._shared(task.integrator, task.settings)) for task in tasks[:1])

    def _refused(self, setup: PreparedCase) -> bool:
        """Whether what is set up can be stepped on the Python path alone."""
        refusal = native_path.refusal_of(setup)
        if refusal and self._stepping == "native":
            raise InputError(f"no native stepping: {refusal}")
        return bool(refusal)

    def _path(self, task: Task, setup: PreparedCase) -> SteppingPath:
        terms = Baumgarte() if task.held_by == "projection" else self.case.file.baumgarte
        kind = PythonPath if self._on_python() or self._refused(setup) else NativePath
        return kind(setup, terms, self._make, self._tick, self._spools)

    def _make(self, spec: SolverSpec) -> MultiplierSolver:
        return spec.with_defaults(rank_cut=self.case.file.rank_cut).make()


def _tables(path: SteppingPath, walk: Walk, projector: SolverSpec | None) -> list[tuple[Spool, Ending | None]]:
    """The table of each who answers along a walk, and how it ended.

    A solver of somebody's own that does not answer any more ends its own run: the others take the walk anew without it.
    """
    task = walk.task
    tables, ending = MODES[task.mode].take(path, task, projector)
    failed = _failed(task, ending)
    if failed is None:
        return [(table, ending) for table in tables]
    others = replace(task, solvers=tuple(solver for solver in task.solvers if solver.name != failed))
    left = Walk(others, tuple(answer for answer in walk.answers if answer[0].name != failed))
    again = iter(_tables(path, left, projector))
    found = []
    for table, (solver, _) in zip(tables, walk.answers, strict=True):
        if solver.name == failed:
            found.append((table, ending))
        else:
            table.close()
            found.append(next(again))
    return found


def _failed(task: Task, ending: Ending | None) -> str | None:
    """Name of the solver that ended a walk which is not its own, and on which others answer."""
    failed = None if ending is None else ending.solver
    names = {solver.name for solver in task.solvers}
    return failed if failed in names - {task.walker.name} and len(names) > 1 else None


def _result(key: RunKey, steps: Spool, message: str) -> RunResult:
    return RunResult(key, *ended(key, steps, message), steps)
