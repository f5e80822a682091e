"""The experiments: calibration, lockstep, one-step, free run. Each turns a task into finished runs.

They are walked on the native path or on the Python path.
"""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import polars as pl

from oarlock import native_path
from oarlock._core import MultiplierSolver
from oarlock.case_file import Baumgarte, Form, Integrator, Mode, Stabilisation
from oarlock.cases import Case
from oarlock.errors import InputError
from oarlock.native_path import NativePath
from oarlock.projection import TRACKED
from oarlock.python_path import PythonPath, Spools, Tick
from oarlock.results import SCHEMA, RunKey, RunResult
from oarlock.setup import Setup
from oarlock.solvers import MUJOCO, SolverSpec
from oarlock.spool import Spool, spools
from oarlock.truth import load_truth

Stepping = Literal["auto", "native", "python"]
"""Which path steps; ``auto`` is the native one where it can be taken."""

STEPPINGS: list[Stepping] = ["auto", "native", "python"]


@dataclass(frozen=True)
class Task:
    """Every form × solver it names, answered along one walk (in a free run each walks alone)."""

    mode: Mode
    walker: SolverSpec
    forms: tuple[Form, ...]
    solvers: tuple[SolverSpec, ...]
    integrator: Integrator
    settings: str
    stabilisation: Stabilisation = "baumgarte"


def run_key(
    case: str, task: Task, solver: str, form: Form | None, timestep_s: float, steps: int, stepping: str = "python"
) -> RunKey:
    """The key of one of the runs of a task."""
    exact = form == "hard" or (task.mode == "lockstep" and task.walker.name != MUJOCO)
    return RunKey(
        case=case,
        mode=task.mode,
        walker=solver if task.mode == "free" else str(task.walker),
        solver=solver,
        form=form,
        integrator=task.integrator,
        settings=task.settings,
        stepping="mujoco" if (task.mode, solver) == ("free", MUJOCO) else stepping,
        timestep_s=timestep_s,
        steps=steps,
        stabilisation=task.stabilisation if exact else None,
    )


class Laboratory:
    """Runs the tasks of one case; with a time constant or a disturbed start of ``Setup`` where they are given.

    What is too long for the memory is kept for the time being in ``folder``, or where the system keeps such.
    """

    def __init__(
        self,
        case: Case,
        timestep_s: float | None,
        duration_s: float,
        tick: Tick,
        *,
        ignore_inequalities: bool = False,
        stepping: Stepping = "auto",
        solref_s: float | None = None,
        seed: int | None = None,
        folder: Path | None = None,
    ):
        self.case = case
        self._solref_s, self._seed = solref_s, seed
        self._ignoring = ignore_inequalities
        self._timestep_s, self._duration_s = timestep_s, duration_s
        self._tick = tick
        # Not always the system's own folder: that may be memory, and where the results go there must be room anyway.
        self._spools: Spools = partial(spools, schema=SCHEMA, folder=folder)
        self._truth = load_truth(case) if seed is None else None  # it knows the case's own start only
        self._stepping: Stepping = stepping

    def setup(self, integrator: Integrator, settings: str = "default") -> Setup:
        """The case, prepared."""
        return Setup(
            self.case,
            self._truth,
            integrator,
            settings,
            self._timestep_s,
            self._duration_s,
            self._ignoring,
            solref_s=self._solref_s,
            seed=self._seed,
        )

    def run(self, task: Task) -> Iterator[RunResult]:
        """The runs of a task, each as soon as it is finished.

        Raises:
            InputError: the model or the task cannot be run as asked.
        """
        setup = self.setup(task.integrator, task.settings)
        path = self._path(task, setup)

        def results(names: list[tuple[str, Form | None]], tables: list[Spool], message: str):
            for (solver, form), steps in zip(names, tables, strict=True):
                yield self._result(task, setup, path.name, solver, form, steps, message)

        pairs: list[tuple[str, Form | None]] = [(str(spec), form) for form in task.forms for spec in task.solvers]
        if task.mode == "calibration":
            yield from results([(MUJOCO, None)], *path.calibration())
        elif task.mode == "lockstep":
            projector = self._projector(task, "hard")
            yield from results(pairs, *path.lockstep(task.walker, projector, task.forms, task.solvers))
        elif task.mode == "one-step":
            yield from results(pairs, *path.one_step(task.forms, task.solvers))
        else:
            for spec in task.solvers:
                for form in (None,) if spec.name == MUJOCO else task.forms:
                    tables = path.free(spec, form, self._projector(task, form))
                    yield from results([(str(spec), form)], *tables)

    def _path(self, task: Task, setup: Setup) -> NativePath | PythonPath:
        terms = Baumgarte() if task.stabilisation == "projection" else self.case.file.baumgarte
        if self._stepping != "python":
            refusal = native_path.refusal()
            if not refusal:
                return NativePath(setup, terms, self._make, self._tick, self._spools)
            if self._stepping == "native":
                raise InputError(f"no native stepping: {refusal}")
            warnings.warn(f"stepping in Python, which is slower: {refusal}", stacklevel=2)
        return PythonPath(setup, terms, self._make, self._tick, self._spools)

    def _make(self, spec: SolverSpec) -> MultiplierSolver:
        return spec.with_defaults(rank_cut=self.case.file.rank_cut).make()

    def _projector(self, task: Task, form: Form | None) -> SolverSpec | None:
        projects = form == "hard" and task.stabilisation != "baumgarte"
        return TRACKED.with_defaults(rank_cut=self.case.file.rank_cut) if projects else None

    def _result(
        self, task: Task, setup: Setup, path: str, solver: str, form: Form | None, steps: Spool, message: str
    ) -> RunResult:
        key = run_key(self.case.name, task, solver, form, setup.timestep_s, setup.steps, path)
        ends = steps.collect(pl.col("unconverged").sum(), (pl.col("projection") != "landed").sum())
        unconverged, unprojected = ends.row(0)
        status = "diverged" if message else "unconverged" if unconverged else "unprojected" if unprojected else "done"
        return RunResult(key, status, message, steps)
