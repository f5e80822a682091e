"""The Python path: the experiments walked by ``stepping.py``. The readable one, and the oracle of the native path.

Rows are of the start of every step, where state, question and answer belong together.
"""

import time
from collections.abc import Callable

import mujoco
import numpy as np

from oarlock.base.errors import DiskError, InputError, RefusedError, one_line
from oarlock.cases.case_file import Baumgarte, Form
from oarlock.mechanics.energy import Energy
from oarlock.mechanics.prepare import unsolved
from oarlock.stepping.figures import projecting
from oarlock.stepping.path import Finish, Make, Spools, Tables, Tick
from oarlock.stepping.projection import Projector
from oarlock.stepping.question import Question, SolvedForce
from oarlock.stepping.recorder import Recorder, Row
from oarlock.stepping.setup import Setup
from oarlock.stepping.solvers import MUJOCO, RUN_REFERENCE, SolverSpec
from oarlock.stepping.state import State
from oarlock.stepping.walkers import ForcedWalker, MujocoForce, MujocoWalker, Walker, is_finite

_TICK_STEPS = 200


class Companion:
    """MuJoCo's own trajectory, beside another one. Run it inside ``drive.installed()``, as ``MujocoWalker``."""

    def __init__(self, setup: Setup):
        self._setup = setup
        self._walker = MujocoWalker(setup.model, setup.data())
        self._alive = True

    def compare(self, qpos: np.ndarray) -> float | None:
        """How far positions are from it (rad or m), None where it did not get to; then takes its next step."""
        if not self._alive:
            return None
        data = self._walker.data
        apart = self._setup.apart(data.qpos, qpos)
        self._walker.look()
        self._walker.step()
        self._alive = is_finite(data)
        return apart


class PythonPath:
    """The experiments of one setup."""

    name = "python"

    def __init__(self, setup: Setup, terms: Baumgarte, make: Make, tick: Tick, spools: Spools):
        self._setup, self._terms, self._make, self._tick, self._spools = setup, terms, make, tick, spools

    def calibration(self) -> Tables:
        """MuJoCo's own force through our stepping, against MuJoCo: the trajectory difference must be rounding."""
        setup = self._setup
        theirs = Companion(setup)
        data = setup.data()
        walker = ForcedWalker(setup.model, data, setup.drive, MujocoForce(setup.model))
        recorder = self._recorder()

        def record(step: int) -> Finish:
            row = Row(data.qpos, setup.place(data), data.efc_pos[: data.ne], data.efc_vel[: data.ne])
            apart = theirs.compare(data.qpos)
            recorder.note(row, step=step, time_s=data.time, status="converged", trajectory_diff=apart)
            return lambda step_us: recorder.end(step_us=step_us)

        message = self._walk(walker, record)
        return [recorder.steps()], message

    def lockstep(
        self,
        walker: SolverSpec,
        projector: SolverSpec | None,
        forms: tuple[Form, ...],
        solvers: tuple[SolverSpec, ...],
    ) -> Tables:
        """One engine walks; at each of its states every solver answers the same question, and MuJoCo its own.

        A solver walks in the hard form, and a projector with a solver of its own may end its steps. The tables come
        form by form.
        """
        setup = self._setup
        data = setup.data()
        state = self._state(data)
        force, last = None, None
        if walker.name == MUJOCO:
            leader: Walker = MujocoWalker(setup.model, data)
        else:
            force = SolvedForce(state, "hard", self._make(walker))
            last = self._projector(projector)
            leader = ForcedWalker(setup.model, data, setup.drive, force, last)
        make, recorders = self._make, self._recorders(len(forms) * len(solvers))
        tables = iter(recorders)
        questions = [
            (Question(state, form), make(SolverSpec(RUN_REFERENCE)), [(make(spec), next(tables)) for spec in solvers])
            for form in forms
        ]

        def record(step: int) -> Finish:
            state.read()
            qacc, qfrc = leader.mujoco_answer()
            for question, reference_solver, answering in questions:
                question.ask()
                minimum, reference = question.solve(reference_solver)
                for solver, recorder in answering:
                    answer = question.answer(solver)
                    row = self._row(state, answer.qacc, answer.multipliers, minimum, answer.qfrc, qacc, qfrc)
                    recorder.note(row, step=step, time_s=data.time, infos=[answer.info], reference=reference)

            def finish(step_us: float) -> None:
                for recorder in recorders:
                    recorder.end(**projecting(last), step_us=step_us)
                if force is not None:
                    force.take_infos()

            return finish

        message = self._walk(leader, record)
        return [recorder.steps() for recorder in recorders], message

    def one_step(self, forms: tuple[Form, ...], solvers: tuple[SolverSpec, ...]) -> Tables:
        """From each of MuJoCo's states, one step each: what a single step adds to the difference. Form by form.

        Never projected: from MuJoCo's states, which are open, the way to the manifold would drown what a step adds.
        """
        setup = self._setup
        data, ours = setup.data(), setup.data()
        state = self._state(ours)
        forces = [SolvedForce(state, form, self._make(spec)) for form in forms for spec in solvers]
        walkers = [ForcedWalker(setup.model, ours, setup.drive, force) for force in forces]
        recorders = self._recorders(len(forces))

        def record(step: int) -> Finish:
            reached = []
            for walker, recorder in zip(walkers, recorders, strict=True):
                ours.qpos[:], ours.qvel[:], ours.act[:] = data.qpos, data.qvel, data.act
                ours.time = data.time
                walker.look()
                row = self._row(state, ours.qacc, ours.efc_force)
                recorder.note(row, step=step, time_s=ours.time)
                walker.step()
                reached.append(ours.qpos.copy())

            def finish(step_us: float) -> None:
                for force, recorder, qpos in zip(forces, recorders, reached, strict=True):
                    apart = setup.apart(data.qpos, qpos)
                    recorder.end(infos=force.take_infos(), trajectory_diff=apart, step_us=step_us)

            return finish

        message = self._walk(MujocoWalker(setup.model, data), record)
        return [recorder.steps() for recorder in recorders], message

    def free(self, solver: SolverSpec, form: Form | None, projector: SolverSpec | None) -> Tables:
        """One engine walks alone, against MuJoCo as configured and against the truth; MuJoCo has no form."""
        if form is None:
            return self._free_mujoco()
        return self._free_solved(solver, form, projector)

    def _free_mujoco(self) -> Tables:
        setup = self._setup
        data = setup.data()
        state = self._state(data)
        walker = MujocoWalker(setup.model, data)
        energy = Energy(setup.model)
        recorder = self._recorder()

        def record(step: int) -> Finish:
            state.read()
            iterations = walker.iterations
            figures = {
                "step": step,
                "time_s": data.time,
                "status": "converged",
                "solves": 1,
                "unconverged": 0,
                "iterations": iterations,
                "iterations_worst": iterations,
                **energy.of(data),
                **setup.published.errors(step, data),
            }
            recorder.note(self._row(state, data.qacc, data.efc_force), **figures)
            return lambda step_us: recorder.end(step_us=step_us)

        message = self._walk(walker, record)
        return [recorder.steps()], message

    def _free_solved(self, solver: SolverSpec, form: Form, projector: SolverSpec | None) -> Tables:
        setup = self._setup
        theirs = Companion(setup)
        model = unsolved(setup.model)
        data = setup.data(model)
        state = State(model, data, self._terms)
        force = SolvedForce(state, form, self._make(solver))
        last = Projector(model, solver=projector) if projector else None
        walker = ForcedWalker(model, data, setup.drive, force, last)
        reference_solver = self._make(SolverSpec(RUN_REFERENCE))
        energy = Energy(setup.model)
        recorder = self._recorder()

        def record(step: int) -> Finish:
            figures = {
                "step": step,
                "time_s": data.time,
                "trajectory_diff": theirs.compare(data.qpos),
                **energy.of(data),
                **setup.published.errors(step, data),
            }
            minimum, reference = force.question.solve(reference_solver)
            row = self._row(state, data.qacc, data.efc_force, minimum)
            recorder.note(row, reference=reference, **figures)

            def finish(step_us: float) -> None:
                recorder.end(infos=force.take_infos(), **projecting(last), step_us=step_us)

            return finish

        message = self._walk(walker, record)
        return [recorder.steps()], message

    def _state(self, data: mujoco.MjData) -> State:
        return State(self._setup.model, data, self._terms)

    def _projector(self, solver: SolverSpec | None) -> Projector | None:
        return Projector(self._setup.model, solver=solver) if solver else None

    def _walk(self, walker: Walker, record: Callable[[int], Finish]) -> str:
        """Walks all steps, recording each as it is taken; gives what ended the run early, or nothing."""
        data = walker.data
        ticks = 0
        # A run that diverges overflows on its way; it ends with a status, not with warnings.
        with self._setup.drive.installed(), np.errstate(over="ignore", invalid="ignore"):
            for step in range(self._setup.steps):
                try:
                    began = time.perf_counter()
                    walker.look()
                    looked = time.perf_counter()
                    finish = record(step)
                    recorded = time.perf_counter()
                    walker.step()
                    finish(1e6 * (time.perf_counter() - recorded + looked - began))
                except (RefusedError, DiskError):
                    raise
                except InputError as error:
                    if step == 0:
                        raise
                    return f"step {step}, t = {data.time:.6g} s: {one_line(error)}"
                if not is_finite(data):
                    return f"step {step}, t = {data.time:.6g} s: the state is no longer finite"
                ticks += 1
                if ticks == _TICK_STEPS:
                    self._tick(ticks)
                    ticks = 0
        self._tick(ticks)
        return ""

    def _recorder(self) -> Recorder:
        return self._recorders(1)[0]

    def _recorders(self, count: int) -> list[Recorder]:
        return [Recorder(self._setup, spool) for spool in self._spools(count)]

    def _row(self, state: State, *answers: np.ndarray) -> Row:
        """What a run notes of a state, and the answers to it: from ``Row.qacc`` on."""
        data, jacobian = state.data, state.jacobian.ravel()
        place = self._setup.place(data)
        return Row(data.qpos, place, state.residual, state.rate, state.curvature, jacobian, *answers)
