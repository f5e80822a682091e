"""From a case to tables: plans the runs, carries them out, keeps each as soon as it is finished, judges the gates."""

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from oarlock.base import core
from oarlock.base.arguments import complete, takes
from oarlock.base.cores import cores, one_thread
from oarlock.base.errors import InputError
from oarlock.base.files import uninterrupted
from oarlock.base.forks import require_threads
from oarlock.base.lock import locked
from oarlock.base.progress import Progress
from oarlock.base.scratch import sweep_up
from oarlock.cases.case import Case
from oarlock.experiments.description import case_document, describe, expectations
from oarlock.experiments.holdings import beside, others
from oarlock.experiments.laboratory import Laboratory
from oarlock.experiments.opening import open_case
from oarlock.experiments.options import RunOptions
from oarlock.experiments.outcome import Results
from oarlock.experiments.plan import plan
from oarlock.experiments.sketch import sketch, traced
from oarlock.experiments.task import Task
from oarlock.mechanics.fatal import mujoco_ends_in_a_line
from oarlock.mechanics.given import Model, path_of
from oarlock.stepping.native_path import refusal
from oarlock.stepping.prepared import PreparedCase
from oarlock.stepping.state import STILL
from oarlock.tables.aggregate import judge, summarise
from oarlock.tables.folder import SUMMARY, ResultFolder, scan_parquet
from oarlock.tables.provenance import inputs, occasion
from oarlock.tables.schema import RunResult


@takes(RunOptions)
def run(
    model: Model,
    options: RunOptions | None = None,
    *,
    out: str | Path | None = None,
    replace: bool = False,
    progress: Progress | None = None,
    **keywords: Any,
) -> Results:
    """Cross-validates a model against MuJoCo.

    Args:
        model: name of a model, folder of a case, or path of an MJCF file; ``:key=value,…`` for other parameters. Or
            MJCF as text, an ``MjModel`` or an ``MjSpec``.
        options: what is asked for in place of what the case of the model says.
        out: folder that keeps the tables; every run is written as soon as it is finished. It may hold the same runs of
            the same timestep and duration, which are written anew; others are not touched.
        replace: whether ``out`` may hold other results, which then go.
        progress: listens: ``finished`` gets the name of every run that was finished and kept.
        keywords: the fields of ``RunOptions``, one by one, as of ``oarlock run``: ``mode="free", duration=1.0``.

    Raises:
        InputError: bad input, or ``out`` holds other results or is in use; finished runs are kept.
    """
    require_threads()
    options = complete(RunOptions, options, keywords)
    return _run(path_of(model), options, None if out is None else Path(out), replace, progress or Progress())


def run_beside(model: str | Path, options: RunOptions, out: Path, progress: Progress) -> Results:
    """Runs a model as ``run`` does; where ``out`` holds other results, the tables go to ``out-2`` and so on."""
    reason = ""
    for folder in beside(out):
        try:
            results = _run(model, options, folder, False, progress)
        except _HeldError as held:
            reason = reason or str(held).partition(", expected")[0]
        else:
            if reason:
                progress.note(f"{reason}; the tables are in '{results.folder}'")
            return results
    raise AssertionError


class _HeldError(InputError):
    """A folder holds results that would be lost."""


def _run(model: str | Path, options: RunOptions, folder: Path | None, replace: bool, progress: Progress) -> Results:
    with one_thread(), mujoco_ends_in_a_line():
        return _run_quietly(open_case(model), options, folder, replace, progress)


def _run_quietly(case: Case, options: RunOptions, folder: Path | None, replace: bool, progress: Progress) -> Results:
    tasks = plan(case, options)
    laboratory = Laboratory(case, options.conditions, stepping=options.stepping, tick=progress.advance, folder=folder)
    setup = laboratory.setup(tasks[0].integrator, tasks[0].settings)
    with nullcontext() if folder is None else locked([folder], f"oarlock run {case.name}", progress.note):
        if folder is not None and not replace:
            _refuse_others(folder, case, tasks, setup)
        if left := sweep_up([folder, folder / "steps"] if folder else []):
            progress.note(left)
        return _carried_out(case, tasks, options, laboratory, setup, folder, progress)


def _refuse_others(folder: Path, case: Case, tasks: list[Task], setup: PreparedCase) -> None:
    names = {name for task in tasks for walk in task.walks() for name in walk.names}
    held = others(folder, case.name, names, setup.timestep_s, setup.steps, setup.ignored, setup.told)
    if held:
        raise _HeldError(f"'{folder}' holds {held}, expected another folder (--out), or --replace")


def _carried_out(
    case: Case,
    tasks: list[Task],
    options: RunOptions,
    laboratory: Laboratory,
    setup: PreparedCase,
    folder: Path | None,
    progress: Progress,
) -> Results:
    progress.begin("running", setup.steps * sum(len(task.walks()) for task in tasks))

    ignored = {} if setup.ignored is None else {"inequalities_ignored": setup.ignored}
    told = {} if setup.told is None else {"motion": setup.told}
    refused = {"native_stepping": refusal()} if refusal() and options.stepping != "python" else {}
    asked = {one.name for task in tasks for one in (*task.solvers, task.walker)}
    slow = [name for name in core.python_solvers() if name in asked]
    called = {"python_solvers": ", ".join(slow)} if slow else {}
    provenance = {**inputs(case), **refused, **ignored, **called, **told, **occasion()}
    results = Results(case, provenance=provenance, model=describe(setup), truth=setup.truth, folder=folder)
    results.motion = setup.told or str(setup.begins)
    results.verdicts += expectations(case, results.model)
    keeper = _Keeper(results, setup)
    for result in laboratory.run_all(tasks, options.threads or cores()):
        keeper.keep(result)
        row = results.rows[-1]
        progress.finished(row["run"], message="" if row["status"] == "done" else f"{row['status']}: {row['message']}")
    # Bounds hold for the discretisation and the parameters that they were set for.
    own = options.conditions.own(case) and case.listed
    results.verdicts += judge(case, results.rows if own else [], complete=own and options.whole_case)
    keeper.close()
    return results


class _Keeper:
    """Keeps every run as soon as it is finished: in memory, and in the folder of the results if there is one."""

    def __init__(self, results: Results, setup: PreparedCase):
        self._results, self._setup = results, setup
        self._seen = self._exact = False
        self._folder = ResultFolder(results.folder) if results.folder else None
        if self._folder:
            self._folder.write_json("case.json", case_document(results.case, results.model))
            if results.truth is not None:
                results.sums |= self._folder.write_truth(results.truth)

    def keep(self, result: RunResult) -> None:
        results, folder = self._results, self._folder
        results.rows.append(summarise(result))
        if folder:
            with uninterrupted():
                results.sums |= folder.write_steps(result)
                folder.write_json(SUMMARY, results.kept(), indent=None)  # written again after every run
        path = traced(result.steps) if len(result.steps) else np.zeros((0, self._setup.model.nq))
        exact = (result.key.mode, result.key.form) == ("free", "hard")
        if len(path) > 1 and results.rows[-1]["status"] != "diverged" and (exact or not self._exact):
            moves = bool(np.abs(path - path[0]).max() > STILL)
            results.still = not moves and (results.still or not self._seen or (exact and not self._exact))
            self._seen, self._exact = True, exact
        if results.sketch is None and len(result.steps):
            results.sketch = sketch(self._setup.model, self._setup.start.qpos, path)
            if folder:
                folder.write_json("sketch.json", results.sketch)
        if folder and result.steps.on_disk:
            results.tables.append(scan_parquet(folder.steps_path(result.key.slug)))
            result.steps.close()
        else:
            results.tables.append(result.table())

    def close(self) -> None:
        if self._folder:
            self._folder.write_json(SUMMARY, self._results.kept())
            self._folder.forget_steps_but([row["run"] for row in self._results.rows])
