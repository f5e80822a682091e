"""A task of an experiment, its walks, and the keys of their runs."""

from dataclasses import dataclass, replace

from oarlock.cases.case_file import Form, ModeName, Stabilisation
from oarlock.cases.integrators import IntegratorName
from oarlock.experiments.modes import MODES, Answer
from oarlock.stepping.solvers import MUJOCO, SolverSpec
from oarlock.tables.schema import RunKey


@dataclass(frozen=True)
class Task:
    """Every form × solver that an experiment names, under one integrator and one setting of MuJoCo."""

    mode: ModeName
    walker: SolverSpec
    forms: tuple[Form, ...]
    solvers: tuple[SolverSpec, ...]
    integrator: IntegratorName
    settings: str
    stabilisation: Stabilisation | None = None
    """None: as ``held_by`` says."""

    def walks(self) -> "tuple[Walk, ...]":
        """Its walks, in the order in which they are taken."""
        return tuple(Walk(self._of(answers), tuple(answers)) for answers in MODES[self.mode].walks(self))

    def _of(self, answers: list[Answer]) -> "Task":
        """The task with only those who answer along one of its walks."""
        forms = tuple(dict.fromkeys(form for _, form in answers if form))
        solvers = tuple(dict.fromkeys(solver for solver, _ in answers))
        return replace(self, solvers=solvers, forms=forms or self.forms[:1])

    @property
    def held_by(self) -> Stabilisation:
        """What keeps exact constraints from drifting.

        If it is not said, projection where solvers walk: Baumgarte's terms fail at change points, where the rows lose
        rank. Along MuJoCo's walk nothing can be projected, and they are what an exact answer to its open rows is.
        """
        mode = MODES[self.mode]
        ours = mode.alone or mode.walked_in(self) == "hard"
        return self.stabilisation or ("projection" if ours else "baumgarte")

    @property
    def projected(self) -> bool:
        """Whether every step of a walk of this task ends in a projection to the constraints."""
        return self.held_by != "baumgarte" and MODES[self.mode].walked_in(self) == "hard"


@dataclass(frozen=True)
class Walk:
    """One walk of a task: a trajectory, and a run for each who answers along it.

    Attributes:
        task: the task, with only those who answer here.
        answers: solver and form of every run, in the order of their tables.
    """

    task: Task
    answers: tuple[Answer, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the runs, which tell them apart within a case."""
        return tuple(key.slug for key in self.keys("", 0.0, 0))

    def keys(self, case: str, timestep_s: float, steps: int, stepping: str = "python") -> tuple[RunKey, ...]:
        """The keys of the runs.

        Args:
            case: name of the case.
            timestep_s: timestep, s.
            steps: number of steps.
            stepping: name of the path that steps.
        """
        task, mode = self.task, MODES[self.task.mode]
        exact = mode.walked_in(task) == "hard"
        return tuple(
            RunKey(
                case=case,
                mode=task.mode,
                walker=str(solver if mode.alone else task.walker),
                solver=str(solver),
                form=form,
                integrator=task.integrator,
                settings=task.settings,
                stepping=MUJOCO if mode.alone and solver.name == MUJOCO else stepping,
                timestep_s=timestep_s,
                steps=steps,
                stabilisation=task.held_by if exact or form == "hard" else None,
            )
            for solver, form in self.answers
        )
