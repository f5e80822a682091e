"""From a case, and what a user asks for, to tasks."""

from oarlock.base import core
from oarlock.base.errors import InputError
from oarlock.cases.case import Case
from oarlock.cases.case_file import Experiment
from oarlock.experiments.modes import ASKABLE, CALIBRATION, MODES
from oarlock.experiments.options import FORMS, RunOptions
from oarlock.experiments.task import Task
from oarlock.stepping.solvers import MUJOCO, SolverSpec

CASE = RunOptions()
"""The case as it is."""


def plan(case: Case, options: RunOptions = CASE) -> list[Task]:
    """The tasks of a case, or what is asked for in place of them, the calibration of every integrator in use first.

    Raises:
        InputError: an unknown solver or option in the case, or options that no solver of the case has.
    """
    if options.whole_case:
        experiments = case.file.experiments
    else:
        modes, forms = ASKABLE[options.mode or "all"], FORMS[options.form or "both"]
        experiments = [
            Experiment.model_validate(
                {
                    "mode": mode,
                    "walker": options.walker or MUJOCO,
                    "forms": forms,
                    "solvers": list(options.solvers) or ["pinv", "auto", "sr1-tracked"],
                    "integrators": [options.integrator] if options.integrator else None,
                    "stabilisation": options.stabilisation,
                }
            )
            for mode in (CALIBRATION, *modes)
        ]
    if options.rtol is not None:
        asked = [SolverSpec.parse(text) for experiment in experiments for text in experiment.solvers]
        if not any("rtol" in core.solvers()[spec.name][1] for spec in asked if spec.name != MUJOCO):
            raise InputError(f"rtol = {options.rtol:g}: none of the solvers asked for has it (sr1 takes eps_abs)")
    tasks = []
    for experiment in experiments:
        specs = (SolverSpec.parse(text).with_defaults(rtol=options.rtol) for text in experiment.solvers)
        solvers = list(dict.fromkeys(specs))
        if MODES[experiment.mode].against_mujoco:
            solvers = [spec for spec in solvers if spec.name != MUJOCO]
            if not solvers:
                raise InputError(f"mode {experiment.mode} compares solvers with MuJoCo: name one besides mujoco")
        for integrator in experiment.integrators or [case.file.run.integrator]:
            for settings in experiment.settings:
                case.file.setting(settings)
                walker = SolverSpec.parse(experiment.walker).with_defaults(rtol=options.rtol)
                forms = tuple(dict.fromkeys(experiment.forms))
                stabilisation = experiment.stabilisation or case.file.run.stabilisation
                task = Task(experiment.mode, walker, forms, tuple(solvers), integrator, settings, stabilisation)
                tasks.append(task)
    return tasks
