"""From a request and a case to tasks."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

from oarlock.base import core
from oarlock.base.errors import InputError, choose
from oarlock.cases.case import Case
from oarlock.cases.case_file import Experiment, Form, Integrator, Stabilisation
from oarlock.experiments.modes import ASKED, CALIBRATION, MODES
from oarlock.experiments.task import Task
from oarlock.stepping.solvers import MUJOCO, SolverSpec

FORMS: dict[str, list[Form]] = {"matched": ["matched"], "hard": ["hard"], "both": ["matched", "hard"]}


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


def plan(case: Case, request: Request) -> list[Task]:
    """The tasks of a request, the calibration of every integrator in use first.

    Raises:
        InputError: an unknown solver, option, form, mode, walker, integrator or stabilisation.
    """
    valid = get_args(Integrator)
    if request.whole_case:
        experiments = case.file.experiments
    else:
        modes = ASKED[choose("mode", request.mode or "all", list(ASKED))]
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
            for mode in (CALIBRATION, *modes)
        ]
    if request.rtol is not None:
        asked = [SolverSpec.parse(text) for experiment in experiments for text in experiment.solvers]
        if not any("rtol" in core.solvers()[spec.name][1] for spec in asked if spec.name != MUJOCO):
            raise InputError(f"rtol = {request.rtol:g}: none of the solvers asked for has it (sr1 takes eps_abs)")
    tasks = []
    for experiment in experiments:
        specs = (SolverSpec.parse(text).with_defaults(rtol=request.rtol) for text in experiment.solvers)
        solvers = list(dict.fromkeys(specs))
        if MODES[experiment.mode].against_mujoco:
            solvers = [spec for spec in solvers if spec.name != MUJOCO]
            if not solvers:
                raise InputError(f"mode {experiment.mode} compares solvers with MuJoCo: name one besides mujoco")
        for integrator in experiment.integrators or [case.file.run.integrator]:
            for settings in experiment.settings:
                case.file.setting(settings)
                walker = SolverSpec.parse(experiment.walker).with_defaults(rtol=request.rtol)
                forms = tuple(dict.fromkeys(experiment.forms))
                stabilisation = experiment.stabilisation or case.file.run.stabilisation
                task = Task(experiment.mode, walker, forms, tuple(solvers), integrator, settings, stabilisation)
                tasks.append(task)
    return tasks
