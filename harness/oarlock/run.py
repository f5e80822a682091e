"""From a case to tables: plans the runs, carries them out, keeps each as soon as it is finished, judges the gates."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, get_args

import numpy as np
import polars as pl

from oarlock import _core
from oarlock.aggregate import Verdict, judge, summarise
from oarlock.case_file import Experiment, Form, Gate, Integrator, Mode, Stabilisation
from oarlock.cases import Case, load_case
from oarlock.cores import cores
from oarlock.errors import InputError, choose
from oarlock.experiments import STEPPINGS, Laboratory, Task
from oarlock.mechanism import coordinates, equalities
from oarlock.provenance import inputs, occasion
from oarlock.reactions import verdict
from oarlock.results import ResultFolder, RunResult, uninterrupted
from oarlock.setup import Setup
from oarlock.sketch import sketch, traced
from oarlock.solvers import MUJOCO, SolverSpec

FORMS: dict[str, list[Form]] = {"matched": ["matched"], "hard": ["hard"], "both": ["matched", "hard"]}
MODES: dict[str, list[Mode]] = {
    "lockstep": ["lockstep"],
    "one-step": ["one-step"],
    "free": ["free"],
    "all": ["lockstep", "one-step", "free"],
}


@dataclass(frozen=True)
class Request:
    """What a user asks for; what is left open comes from the case."""

    solvers: Sequence[str] = ()
    form: str | None = None
    mode: str | None = None
    walker: str | None = None
    integrator: str | None = None
    timestep_s: float | None = None
    duration_s: float | None = None
    rtol: float | None = None
    stabilisation: str | None = None
    ignore_inequalities: bool = False

    @property
    def whole_case(self) -> bool:
        """Whether the case's own experiments are asked for."""
        return not (self.solvers or self.form or self.mode or self.walker or self.integrator or self.stabilisation)


@dataclass
class Results:
    """What a run gave.

    Attributes:
        summary: a row a run (polars).
        steps: a row a run and step (polars).
        rows: the summary as plain dictionaries.
        tables: the steps, a lazy table a run. A long run that is kept in a folder is read from there.
        frames: the same, each table in memory.
        verdicts: what the case expects and its gates, held against the model and the runs.
        provenance: versions, platform, commit, date.
    """

    case: Case
    rows: list[dict[str, Any]] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    provenance: dict[str, Any] = field(default_factory=dict)
    tables: list[pl.LazyFrame] = field(default_factory=list)

    @property
    def summary(self) -> pl.DataFrame:
        """A row a run."""
        return pl.DataFrame(self.rows, infer_schema_length=None)

    @property
    def steps(self) -> pl.DataFrame:
        """A row a run and step."""
        return pl.concat(self.tables).collect() if self.tables else pl.DataFrame()

    @property
    def frames(self) -> list[pl.DataFrame]:
        """The steps, a table a run."""
        return pl.collect_all(self.tables)

    @property
    def failures(self) -> list[Verdict]:
        """Gates that did not hold."""
        return [verdict for verdict in self.verdicts if verdict.held is False]

    def document(self) -> dict[str, Any]:
        """The summary JSON of the contract."""
        return {
            "provenance": self.provenance,
            "runs": self.rows,
            "gates": [
                {
                    **verdict.gate.model_dump(),
                    "run": verdict.run,
                    "value": verdict.value,
                    "held": verdict.held,
                }
                for verdict in self.verdicts
            ],
        }


def plan(case: Case, request: Request) -> list[Task]:
    """The tasks of a request, the calibration of every integrator in use first.

    Raises:
        InputError: an unknown solver, option, form, mode, walker, integrator or stabilisation.
    """
    valid = get_args(Integrator)
    if request.whole_case:
        experiments = case.file.experiments
    else:
        modes = MODES[choose("mode", request.mode or "all", list(MODES))]
        forms = FORMS[choose("form", request.form or "both", list(FORMS))]
        if request.integrator:
            choose("integrator", request.integrator, valid)
        if request.stabilisation:
            choose("stabilisation", request.stabilisation, get_args(Stabilisation))
        experiments = [
            Experiment.model_validate(
                {
                    "mode": mode,
                    "walker": request.walker or MUJOCO,
                    "forms": forms,
                    "solvers": list(request.solvers) or ["pinv", "auto", "sr1"],
                    "integrators": [request.integrator] if request.integrator else None,
                    "stabilisation": request.stabilisation,
                }
            )
            for mode in ("calibration", *modes)
        ]
    if request.rtol is not None:
        asked = [SolverSpec.parse(text) for experiment in experiments for text in experiment.solvers]
        if not any("rtol" in _core.solvers()[spec.name][1] for spec in asked if spec.name != MUJOCO):
            raise InputError(f"rtol = {request.rtol:g}: none of the solvers asked for has it (sr1 takes eps_abs)")
    tasks = []
    for experiment in experiments:
        specs = (SolverSpec.parse(text).with_defaults(rtol=request.rtol) for text in experiment.solvers)
        solvers = list(dict.fromkeys(specs))
        if experiment.mode in ("lockstep", "one-step"):
            solvers = [spec for spec in solvers if spec.name != MUJOCO]
            if not solvers:
                raise InputError(f"mode {experiment.mode} compares solvers with MuJoCo: name one besides mujoco")
        for integrator in experiment.integrators or [case.file.run.integrator]:
            for settings in experiment.settings:
                case.file.setting(settings)
                walker = SolverSpec.parse(experiment.walker).with_defaults(rtol=request.rtol)
                forms = tuple(experiment.forms)
                stabilisation = experiment.stabilisation or case.file.run.stabilisation
                task = Task(experiment.mode, walker, forms, tuple(solvers), integrator, settings, stabilisation)
                tasks.append(task)
    return tasks


def _walks(task: Task) -> int:
    """Number of walks of a task, for the progress bar."""
    if task.mode == "free":
        return sum(1 if spec.name == MUJOCO else len(task.forms) for spec in task.solvers)
    return 1


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
    progress.begin(setup.steps * sum(_walks(task) for task in tasks))

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


def describe(setup: Setup) -> dict[str, Any]:
    """What the model turns out to be at its consistent start."""
    start = setup.start
    return {
        "nq": int(setup.model.nq),
        "nv": int(setup.model.nv),
        "rows": start.rows,
        "rank": start.rank,
        "dof": start.dof,
        "closing_moved": start.moved,
        "unique_reactions": start.unique,
        "coordinates": coordinates(setup.model),
        "equalities": [asdict(equality) for equality in equalities(setup.model)],
    }


def case_document(case: Case, model: dict[str, Any]) -> dict[str, Any]:
    """The contents of ``case.json``: the case with the description of its model."""
    contents = {**case.file.model_dump(), "expect": case.expected(), "parameters": case.parameters}
    return {"name": case.name, "model": model, **contents}


def expectations(case: Case, model: dict[str, Any]) -> list[Verdict]:
    """What the case expects of its model, held against the model's description."""
    found = {**model, "reactions": verdict(model["unique_reactions"])}
    verdicts = []
    for name, expected in case.expected().items():
        bounds = {"equal": expected} if isinstance(expected, str) else {"min": expected, "max": expected}
        gate = Gate.model_validate({"figure": name, **bounds, "cause": "[expect] of the case"})
        verdicts.append(Verdict(gate, "start", found[name], gate.holds(found[name])))
    return verdicts


class _Keeper:
    """Keeps every run as soon as it is finished: in memory, and in a folder if there is one."""

    def __init__(self, results: Results, setup: Setup, model: dict[str, Any], folder: ResultFolder | None):
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
