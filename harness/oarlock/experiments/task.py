"""A task of an experiment, and the keys of its runs."""

from dataclasses import dataclass

from oarlock.cases.case_file import Form, Integrator, Mode, Stabilisation
from oarlock.stepping.solvers import MUJOCO, SolverSpec
from oarlock.tables.schema import RunKey


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
