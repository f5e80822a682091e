"""The experiments: calibration, lockstep, one-step, free run. Each turns a task into finished runs.

Rows are written at the start of every step, where state, question and answer belong together.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
import polars as pl

from oarlock.case_file import Baumgarte, Form, Integrator, Mode, Stabilisation
from oarlock.cases import Case
from oarlock.drive import Drive
from oarlock.errors import InputError, RefusedError, one_line
from oarlock.inequalities import ignore_inequalities
from oarlock.mechanism import load_mechanism
from oarlock.metrics import Energy, against_mujoco, drift, largest, projecting, solving
from oarlock.observed import Observed
from oarlock.projection import Projector
from oarlock.published import PublishedValues
from oarlock.results import Recorder, RunKey, RunResult
from oarlock.solvers import MUJOCO, REFERENCE, Question, SolvedForce, SolverSpec
from oarlock.start import ConsistentStart, consistent_start
from oarlock.state import State
from oarlock.stepping import ForcedWalker, MujocoForce, MujocoWalker, Walker
from oarlock.truth import TruthTrajectory, load_truth

Tick = Callable[[int], None]
"""Called with the number of steps just done."""

Finish = Callable[[float], None]
"""Called with the time in µs that the step took, once it is taken: writes the rows that were begun before it."""

_TICK_STEPS = 200
STEPPING = "python"


MAX_STEPS = 10_000_000
"""Steps of a run at most: their rows are kept in memory until it is finished."""


def _steps(duration_s: float, timestep_s: float) -> int:
    if duration_s / timestep_s > MAX_STEPS:
        raise InputError(
            f"{duration_s:g} s at a timestep of {timestep_s:g} s are {duration_s / timestep_s:.3g} steps, "
            f"expected at most {MAX_STEPS:,}"
        )
    return max(1, round(duration_s / timestep_s))


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


def run_key(case: str, task: Task, solver: str, form: Form | None, timestep_s: float, steps: int) -> RunKey:
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
        stepping="mujoco" if (task.mode, solver) == ("free", MUJOCO) else STEPPING,
        timestep_s=timestep_s,
        steps=steps,
        stabilisation=task.stabilisation if exact else None,
    )


class Setup:
    """A prepared model with its drive, its consistent start, its number of steps, and the truth at each of them.

    ``ignored`` says which contacts, limits and friction were switched off, or None where none were to be. For
    ``solref_s`` see ``load_mechanism``, for ``seed`` ``consistent_start``.
    """

    def __init__(
        self,
        case: Case,
        truth: TruthTrajectory | None,
        integrator: Integrator,
        settings: str,
        timestep_s: float | None,
        duration_s: float,
        ignoring: bool = False,
        *,
        solref_s: float | None = None,
        seed: int | None = None,
    ):
        self.model = load_mechanism(
            case, integrator=integrator, timestep_s=timestep_s, settings=settings, solref_s=solref_s
        )
        ignoring = ignoring or case.file.run.ignore_inequalities
        self.ignored = ignore_inequalities(self.model) if ignoring else None
        self.drive = Drive(self.model, case)
        self.start: ConsistentStart = consistent_start(self.model, case, seed)
        self.timestep_s = float(self.model.opt.timestep)
        self.steps = _steps(duration_s, self.timestep_s)
        self.published = PublishedValues(self.model, case, own=timestep_s is None)
        if self.published.last_step == self.steps:
            self.steps += 1  # states are recorded at the start of a step, and this one belongs to the end
        self.truth: pl.DataFrame | None = None
        if truth is not None and case.file.truth is not None:
            known = case.file.truth
            where = f"[truth] of case '{case.name}'"
            self._observed = Observed(self.model, where, joint=known.joint, site=known.site)
            times = np.arange(self.steps) * self.timestep_s
            self._true_path = truth.position(times)
            names = ["position"] if known.joint else ["x", "y", "z"]
            self.truth = pl.DataFrame({"time_s": times, **dict(zip(names, self._true_path.T, strict=True))})

    def data(self) -> mujoco.MjData:
        """A fresh data at the start."""
        data = mujoco.MjData(self.model)
        data.qpos[:], data.qvel[:] = self.start.qpos, self.start.qvel
        return data

    def truth_error(self, step: int, data: mujoco.MjData) -> float | None:
        """Distance of the joint or site that the truth knows from where it should be at the start of a step.

        In the coordinate that is furthest off, at a state whose position stage is done.
        """
        if self.truth is None or not np.isfinite(self._true_path[step]).all():
            return None
        return largest(self._observed.position(data) - self._true_path[step])

    def apart(self, qpos1: np.ndarray, qpos2: np.ndarray) -> float | None:
        """Largest difference of two positions in any coordinate (rad or m); None if one of them is not finite."""
        apart = np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, apart, 1.0, qpos1, qpos2)
        difference = largest(apart)
        return difference if np.isfinite(difference) else None


class Laboratory:
    """Runs the tasks of one case; with a time constant or a disturbed start of ``Setup`` where they are given."""

    def __init__(
        self,
        case: Case,
        timestep_s: float | None,
        duration_s: float,
        tick: Tick,
        *,
        ignore_inequalities: bool = False,
        solref_s: float | None = None,
        seed: int | None = None,
    ):
        self.case = case
        self._solref_s, self._seed = solref_s, seed
        self._ignoring = ignore_inequalities
        self._timestep_s, self._duration_s = timestep_s, duration_s
        self._tick = tick
        self._truth = load_truth(case) if seed is None else None  # it knows the case's own start only
        self._trajectories: dict[tuple[Integrator, str], np.ndarray] = {}

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
        experiment = {
            "calibration": self._calibration,
            "lockstep": self._lockstep,
            "one-step": self._one_step,
            "free": self._free,
        }[task.mode]
        yield from experiment(task, self.setup(task.integrator, task.settings))

    # The four experiments.

    def _calibration(self, task: Task, setup: Setup) -> Iterator[RunResult]:
        """MuJoCo's own force through our stepping, against MuJoCo: the trajectory difference must be rounding."""
        theirs = self._mujoco_trajectory(setup, task)
        data = setup.data()
        walker = ForcedWalker(setup.model, data, setup.drive, MujocoForce(setup.model))
        recorder = Recorder()

        def record(step: int) -> Finish:
            figures = {
                "step": step,
                "time_s": data.time,
                "status": "converged",
                "drift_pos": largest(data.efc_pos),
                "drift_vel": largest(data.efc_vel),
                "trajectory_diff": setup.apart(theirs[step], data.qpos),
                "truth_error": setup.truth_error(step, data),
                "qpos": data.qpos.copy(),
            }
            return lambda step_us: recorder.append(**figures, step_us=step_us)

        message = self._walk(setup, walker, record)
        yield self._result(task, setup, MUJOCO, None, recorder, message)

    def _lockstep(self, task: Task, setup: Setup) -> Iterator[RunResult]:
        """One engine walks; at each of its states every solver answers the same question, and MuJoCo its own."""
        data = setup.data()
        state = self._state(task, setup, data)
        projector = None
        if task.walker.name == MUJOCO:
            walker: Walker = MujocoWalker(setup.model, data)
        else:
            force = SolvedForce(state, "hard", self._make(task.walker))
            projector = self._projector(task, setup, "hard")
            walker = ForcedWalker(setup.model, data, setup.drive, force, projector)
        questions = [(Question(state, form), self._make(SolverSpec(REFERENCE))) for form in task.forms]
        solvers = {(form, spec): self._make(spec) for form in task.forms for spec in task.solvers}
        recorders = {key: Recorder() for key in solvers}

        def record(step: int) -> Finish:
            state.read()
            qacc, qfrc = walker.mujoco_answer()
            rows = []
            for question, reference_solver in questions:
                question.ask()
                reference = question.answer(reference_solver)
                for spec in task.solvers:
                    answer = question.answer(solvers[question.form, spec])
                    figures = {
                        **self._common(setup, step, data, state, answer.qacc),
                        **solving([answer], reference),
                        **against_mujoco(answer, qacc, qfrc),
                        "multipliers": answer.multipliers,
                    }
                    rows.append((recorders[question.form, spec], figures))

            def finish(step_us: float) -> None:
                for recorder, figures in rows:
                    recorder.append(**figures, **projecting(projector), step_us=step_us)

            return finish

        message = self._walk(setup, walker, record)
        for (form, spec), recorder in recorders.items():
            yield self._result(task, setup, str(spec), form, recorder, message)

    def _one_step(self, task: Task, setup: Setup) -> Iterator[RunResult]:
        """From each of MuJoCo's states, one step each: what a single step adds to the difference.

        Never projected: from MuJoCo's states, which are open, the way to the manifold would drown what a step adds.
        """
        data, ours = setup.data(), setup.data()
        state = self._state(task, setup, ours)
        recorders: dict[tuple[Form, SolverSpec], Recorder] = {
            (form, spec): Recorder() for form in task.forms for spec in task.solvers
        }
        forces = {key: SolvedForce(state, key[0], self._make(key[1])) for key in recorders}
        walkers = {key: ForcedWalker(setup.model, ours, setup.drive, force) for key, force in forces.items()}

        def record(step: int) -> Finish:
            rows = []
            for key, walker in walkers.items():
                ours.qpos[:], ours.qvel[:], ours.act[:] = data.qpos, data.qvel, data.act
                ours.time = data.time
                walker.look()
                figures = self._common(setup, step, ours, state, ours.qacc)
                figures["multipliers"] = forces[key].answers[0].multipliers
                walker.step()
                figures.update(solving(forces[key].answers, None))
                forces[key].answers.clear()
                rows.append((recorders[key], figures, ours.qpos.copy()))

            def finish(step_us: float) -> None:
                for recorder, figures, qpos in rows:
                    recorder.append(**figures, trajectory_diff=setup.apart(data.qpos, qpos), step_us=step_us)

            return finish

        message = self._walk(setup, MujocoWalker(setup.model, data), record)
        for (form, spec), recorder in recorders.items():
            yield self._result(task, setup, str(spec), form, recorder, message)

    def _free(self, task: Task, setup: Setup) -> Iterator[RunResult]:
        """One engine walks alone, against MuJoCo as configured and against the truth."""
        for spec in task.solvers:
            if spec.name == MUJOCO:
                yield self._free_mujoco(task, setup)
                continue
            for form in task.forms:
                yield self._free_solved(task, setup, form, spec)

    def _free_mujoco(self, task: Task, setup: Setup) -> RunResult:
        data = setup.data()
        state = self._state(task, setup, data)
        walker = MujocoWalker(setup.model, data)
        energy = Energy(setup.model)
        recorder = Recorder()

        def record(step: int) -> Finish:
            state.read()
            iterations = walker.iterations
            figures = {
                **self._common(setup, step, data, state, data.qacc),
                "status": "converged",
                "solves": 1,
                "unconverged": 0,
                "iterations": iterations,
                "iterations_worst": iterations,
                **energy.of(data),
                **setup.published.errors(step, data),
                "multipliers": data.efc_force.copy(),
            }
            return lambda step_us: recorder.append(**figures, step_us=step_us)

        message = self._walk(setup, walker, record)
        return self._result(task, setup, MUJOCO, None, recorder, message)

    def _free_solved(self, task: Task, setup: Setup, form: Form, spec: SolverSpec) -> RunResult:
        theirs = self._mujoco_trajectory(setup, task)
        data = setup.data()
        state = self._state(task, setup, data)
        force = SolvedForce(state, form, self._make(spec))
        projector = self._projector(task, setup, form)
        walker = ForcedWalker(setup.model, data, setup.drive, force, projector)
        reference_solver = self._make(SolverSpec(REFERENCE))
        energy = Energy(setup.model)
        recorder = Recorder()

        def record(step: int) -> Finish:
            figures = {
                **self._common(setup, step, data, state, data.qacc),
                "trajectory_diff": setup.apart(theirs[step], data.qpos),
                **energy.of(data),
                **setup.published.errors(step, data),
                "multipliers": force.answers[0].multipliers,
            }
            reference = force.question.answer(reference_solver)

            def finish(step_us: float) -> None:
                solves = solving(force.answers, reference)
                recorder.append(**figures, **solves, **projecting(projector), step_us=step_us)
                force.answers.clear()

            return finish

        message = self._walk(setup, walker, record)
        return self._result(task, setup, str(spec), form, recorder, message)

    # What they share.

    def _make(self, spec: SolverSpec):
        return spec.with_defaults(rank_cut=self.case.file.rank_cut).make()

    def _state(self, task: Task, setup: Setup, data: mujoco.MjData) -> State:
        terms = Baumgarte() if task.stabilisation == "projection" else self.case.file.baumgarte
        return State(setup.model, data, terms)

    def _projector(self, task: Task, setup: Setup, form: Form) -> Projector | None:
        projects = form == "hard" and task.stabilisation != "baumgarte"
        return Projector(setup.model, self.case.file.rank_cut) if projects else None

    def _walk(self, setup: Setup, walker: Walker, record: Callable[[int], Finish]) -> str:
        """Walks all steps, recording each as it is taken; gives what ended the run early, or nothing."""
        data = walker.data
        ticks = 0
        # A run that diverges overflows on its way; it ends with a status, not with warnings.
        with setup.drive.installed(), np.errstate(over="ignore", invalid="ignore"):
            for step in range(setup.steps):
                try:
                    began = time.perf_counter()
                    walker.look()
                    looked = time.perf_counter()
                    finish = record(step)
                    recorded = time.perf_counter()
                    walker.step()
                    finish(1e6 * (time.perf_counter() - recorded + looked - began))
                except RefusedError:
                    raise
                except InputError as error:
                    if step == 0:
                        raise
                    return f"step {step}, t = {data.time:.6g} s: {one_line(error)}"
                if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
                    return f"step {step}, t = {data.time:.6g} s: the state is no longer finite"
                ticks += 1
                if ticks == _TICK_STEPS:
                    self._tick(ticks)
                    ticks = 0
        self._tick(ticks)
        return ""

    def _mujoco_trajectory(self, setup: Setup, task: Task) -> np.ndarray:
        """MuJoCo's own free run with the task's settings, (steps, nq); NaN where it did not get to."""
        key = (task.integrator, task.settings)
        if key not in self._trajectories:
            path = np.full((setup.steps, setup.model.nq), np.nan)
            data = setup.data()

            def record(step: int) -> Finish:
                path[step] = data.qpos
                return lambda _step_us: None

            self._walk(setup, MujocoWalker(setup.model, data), record)
            self._trajectories[key] = path
        return self._trajectories[key]

    def _common(self, setup: Setup, step: int, data: mujoco.MjData, state: State, qacc: np.ndarray) -> dict:
        return {
            "step": step,
            "time_s": data.time,
            **drift(state, qacc),
            "truth_error": setup.truth_error(step, data),
            "qpos": data.qpos.copy(),
            "residual": state.residual.copy(),
        }

    def _result(self, task: Task, setup: Setup, solver: str, form, recorder: Recorder, message: str) -> RunResult:
        key = run_key(self.case.name, task, solver, form, setup.timestep_s, setup.steps)
        steps = recorder.frame()
        unconverged = steps["unconverged"].sum() or 0
        unprojected = (steps["projection"] != "landed").sum() or 0
        status = "diverged" if message else "unconverged" if unconverged else "unprojected" if unprojected else "done"
        return RunResult(key, status, message, steps)
