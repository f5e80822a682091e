"""From a case to tables: plans the runs, carries them out, keeps each as soon as it is finished, judges the gates."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from oarlock.base.cores import cores
from oarlock.base.errors import InputError, choose
from oarlock.base.files import uninterrupted
from oarlock.cases.case import load_case
from oarlock.experiments.laboratory import STEPPINGS, Laboratory
from oarlock.experiments.outcome import Results, case_document, describe, expectations
from oarlock.experiments.plan import Request, plan
from oarlock.experiments.sketch import sketch, traced
from oarlock.stepping.prepared import PreparedCase
from oarlock.tables.aggregate import judge, summarise
from oarlock.tables.folder import ResultFolder
from oarlock.tables.provenance import inputs, occasion
from oarlock.tables.schema import RunResult


class Progress:
    """Listens to a run. The base class keeps silent."""

    def begin(self, steps: int) -> None:
        """The number of steps ahead is known."""

    def advance(self, steps: int) -> None:
        """Steps were done."""

    def finished(self, row: dict[str, Any]) -> None:
        """A run was finished and kept."""


def run(
    model: str | Path,
    *,
    solver: Sequence[str] | str = (),
    form: str | None = None,
    mode: str | None = None,
    walker: str | None = None,
    integrator: str | None = None,
    timestep_s: float | None = None,
    duration_s: float | None = None,
    rtol: float | None = None,
    stabilisation: str | None = None,
    ignore_inequalities: bool = False,
    stepping: str = "auto",
    out: Path | None = None,
    progress: Progress | None = None,
    threads: int | None = None,
) -> Results:
    """Cross-validates a model against MuJoCo.

    Args:
        model: name of a model, folder of a case, or path of an MJCF file; ``:key=value,…`` for other parameters.
        solver: solver specifications, such as ``"sr1:eps_abs=1e-7"``; the case's if empty.
        form: ``matched`` (MuJoCo's own softness), ``hard`` (exact constraints) or ``both``.
        mode: ``lockstep``, ``one-step``, ``free`` or ``all``.
        walker: who walks in lockstep: ``mujoco`` or a solver, which then walks in the hard form.
        integrator: ``euler``, ``implicit``, ``implicitfast`` or ``rk4``.
        timestep_s: timestep in s.
        duration_s: duration in s.
        rtol: relative tolerance of the solvers that have one.
        stabilisation: what keeps exact constraints from drifting: ``baumgarte``, ``projection`` or ``both``.
        ignore_inequalities: run without the model's contacts, limits and friction, MuJoCo too; the provenance says
            what was left out. Without it a run in which one becomes active is refused.
        stepping: ``native`` (the compiled step loops), ``python`` (the same, readable and slow) or ``auto``: native if
            MuJoCo is of the version that they were built against.
        out: folder that keeps the tables; every run is written as soon as it is finished.
        progress: listens.
        threads: native runs at once; as many as there are cores if left out. Times of solves are best taken with one.

    Raises:
        InputError: bad input; finished runs are kept.
    """
    case = load_case(model)
    for name, value in (("timestep", timestep_s), ("duration", duration_s)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InputError(f"{name} = {value:g} s, expected a finite number > 0")
    solvers = (solver,) if isinstance(solver, str) else tuple(solver)
    request = Request(
        solvers, form, mode, walker, integrator, timestep_s, duration_s, rtol, stabilisation, ignore_inequalities
    )
    tasks = plan(case, request)
    progress = progress or Progress()
    laboratory = Laboratory(
        case,
        timestep_s,
        duration_s or case.file.run.duration_s,
        progress.advance,
        ignore_inequalities=request.ignore_inequalities,
        stepping=choose("stepping", stepping, STEPPINGS),
        folder=out,
    )
    setup = laboratory.setup(tasks[0].integrator, tasks[0].settings)
    if duration_s is None and setup.timestep_s > case.file.run.duration_s:  # asked for, one step is enough
        raise InputError(
            f"timestep = {setup.timestep_s:g} s is longer than the duration of {case.file.run.duration_s:g} s, "
            "expected at least one step"
        )
    progress.begin(setup.steps * sum(len(task.walks()) for task in tasks))

    ignored = {} if setup.ignored is None else {"inequalities_ignored": setup.ignored}
    results = Results(case, provenance={**inputs(case), **ignored, **occasion()})
    model_found = describe(setup)
    results.verdicts += expectations(case, model_found)
    keeper = _Keeper(results, setup, model_found, ResultFolder(out) if out else None)
    for result in laboratory.run_all(tasks, threads or cores()):
        keeper.keep(result)
        progress.finished(results.rows[-1])
    # Bounds hold for the discretisation and the parameters that they were set for.
    own = timestep_s in (None, case.file.run.timestep_s) and duration_s in (None, case.file.run.duration_s)
    own = own and case.listed
    results.verdicts += judge(case, results.rows if own else [], complete=own and request.whole_case)
    keeper.close()
    return results


class _Keeper:
    """Keeps every run as soon as it is finished: in memory, and in a folder if there is one."""

    def __init__(self, results: Results, setup: PreparedCase, model: dict[str, Any], folder: ResultFolder | None):
        self._results, self._setup, self._folder = results, setup, folder
        self._sketched = False
        if folder:
            folder.write_json("case.json", case_document(results.case, model))
            if setup.truth is not None:
                folder.write_truth(setup.truth)

    def keep(self, result: RunResult) -> None:
        results, folder = self._results, self._folder
        results.rows.append(summarise(result))
        if not folder:
            results.tables.append(result.table())
            return
        with uninterrupted():
            folder.write_steps(result)
            folder.write_json("summary.json", results.document(), indent=None)  # written again after every run
        if not self._sketched and len(result.steps):
            path = traced(result.steps)
            folder.write_json("sketch.json", sketch(self._setup.model, self._setup.start.qpos, path))
            self._sketched = True
        if result.steps.on_disk:
            results.tables.append(pl.scan_parquet(folder.steps_path(result.key.slug)))
            result.steps.close()
        else:
            results.tables.append(result.table())

    def close(self) -> None:
        if self._folder:
            self._folder.write_json("summary.json", self._results.document())
            self._folder.forget_steps_but([row["run"] for row in self._results.rows])
