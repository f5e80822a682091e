"""The Python path: the experiments walked by ``stepping.py``. The readable one, and the oracle of the native path.

Rows are of the start of every step, where state, question and answer belong together.
"""

import time
from collections.abc import Callable

import mujoco
import numpy as np

from oarlock.base.errors import DiskError, InputError
from oarlock.cases.case_file import Baumgarte, Form
from oarlock.mechanics.energy import Energy
from oarlock.mechanics.prepare import unsolved
from oarlock.stepping.ending import Ending
from oarlock.stepping.figures import projecting
from oarlock.stepping.path import REFERENCE_SOLVER, SPOOLS, TICK_STEPS, Make, Spools, Tables, Tick, silent
from oarlock.stepping.prepared import Prepared
from oarlock.stepping.projection import Projector
from oarlock.stepping.question import Question, SolvedForce
from oarlock.stepping.recorder import Recorder, Row
from oarlock.stepping.solvers import MUJOCO, SolverSpec
from oarlock.stepping.state import State
from oarlock.stepping.walkers import ForcedWalker, MujocoForce, MujocoWalker, Walker, is_finite

Finish = Callable[[float], None]
"""Called with the time in µs that the step took, once it is taken: writes the rows that were begun before it."""


class Companion:
    """MuJoCo's own trajectory, beside another one. Run it inside ``drive.installed()``, as ``MujocoWalker``."""

    def __init__(self, prepared: Prepared):
        self._prepared = prepared
        self._walker = MujocoWalker(prepared.model, prepared.data())
        self._alive = True

    def compare(self, qpos: np.ndarray) -> float | None:
        """How far positions are from it (rad or m), None where it did not get to; then takes its next step."""
        if not self._alive:
            return None
        data = self._walker.data
        apart = self._prepared.apart(data.qpos, qpos)
        self._walker.look()
        self._walker.step()
        self._alive = is_finite(data)
        return apart


class PythonPath:
    """The experiments of one prepared."""

    name = "python"

    def __init__(
        self,
        prepared: Prepared,
        terms: Baumgarte,
        make: Make = SolverSpec.make,
        tick: Tick = silent,
        spools: Spools = SPOOLS,
    ):
        self._prepared, self._terms, self._make, self._tick, self._spools = prepared, terms, make, tick, spools

    def calibration(self) -> Tables:
        """MuJoCo's own force through our stepping, against MuJoCo: the trajectory difference must be rounding."""
        prepared = self._prepared
        theirs = Companion(prepared)
        data = prepared.data()
        walker = ForcedWalker(prepared.model, data, prepared.drive, MujocoForce(prepared.model))
        recorder = self._recorder()

        def record(step: int) -> Finish:
            row = Row(data.qpos, prepared.place(data), data.efc_pos[: data.ne], data.efc_vel[: data.ne])
            apart = theirs.compare(data.qpos)
            recorder.note(row, step=step, time_s=data.time, status="converged", trajectory_diff=apart)
            return lambda step_us: recorder.end(step_us=step_us)

        ending = self._walk(walker, record)
        return [recorder.steps()], ending

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
        prepared = self._prepared
        data = prepared.data()
        state = self._state(data)
        force, last = None, None
        if walker.name == MUJOCO:
            leader: Walker = MujocoWalker(prepared.model, data)
        else:
            force = SolvedForce(state, "hard", self._make(walker))
            last = self._projector(projector)
            leader = ForcedWalker(prepared.model, data, prepared.drive, force, last)
        make, recorders = self._make, self._recorders(len(forms) * len(solvers))
        tables = iter(recorders)
        questions = [
            (Question(state, form), make(REFERENCE_SOLVER), [(make(spec), next(tables)) for spec in solvers])
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

        ending = self._walk(leader, record)
        return [recorder.steps() for recorder in recorders], ending

    def one_step(self, forms: tuple[Form, ...], solvers: tuple[SolverSpec, ...]) -> Tables:
        """From each of MuJoCo's states, one step each: what a single step adds to the difference. Form by form.

        Never projected: from MuJoCo's states, which are open, the way to the manifold would drown what a step adds.
        """
        prepared = self._prepared
        data, ours = prepared.data(), prepared.data()
        state = self._state(ours)
        forces = [SolvedForce(state, form, self._make(spec)) for form in forms for spec in solvers]
        walkers = [ForcedWalker(prepared.model, ours, prepared.drive, force) for force in forces]
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
                    apart = prepared.apart(data.qpos, qpos)
                    recorder.end(infos=force.take_infos(), trajectory_diff=apart, step_us=step_us)

            return finish

        ending = self._walk(MujocoWalker(prepared.model, data), record)
        return [recorder.steps() for recorder in recorders], ending

    def free(
        self,
        solver: SolverSpec,
        form: Form | None,
        projector: SolverSpec | None,
        reference: SolverSpec = REFERENCE_SOLVER,
    ) -> Tables:
        """One engine walks alone, against MuJoCo as configured and against the truth; MuJoCo has no form."""
        if form is None:
            return self._free_mujoco()
        return self._free_solved(solver, form, projector, reference)

    def _free_mujoco(self) -> Tables:
        prepared = self._prepared
        data = prepared.data()
        state = self._state(data)
        walker = MujocoWalker(prepared.model, data)
        energy = Energy(prepared.model)
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
                **prepared.published.errors(step, data),
            }
            recorder.note(self._row(state, data.qacc, data.efc_force), **figures)
            return lambda step_us: recorder.end(step_us=step_us)

        ending = self._walk(walker, record)
        return [recorder.steps()], ending

    def _free_solved(
        self, solver: SolverSpec, form: Form, projector: SolverSpec | None, reference: SolverSpec
    ) -> Tables:
        prepared = self._prepared
        theirs = Companion(prepared)
        model = unsolved(prepared.model)
        data = prepared.data(model)
        state = State(model, data, self._terms)
        force = SolvedForce(state, form, self._make(solver))
        last = Projector(model, solver=projector) if projector else None
        walker = ForcedWalker(model, data, prepared.drive, force, last)
        reference_solver = self._make(reference)
        energy = Energy(prepared.model)
        recorder = self._recorder()

        def record(step: int) -> Finish:
            figures = {
                "step": step,
                "time_s": data.time,
                "trajectory_diff": theirs.compare(data.qpos),
                **energy.of(data),
                **prepared.published.errors(step, data),
            }
            minimum, known = force.question.solve(reference_solver)
            row = self._row(state, data.qacc, data.efc_force, minimum)
            recorder.note(row, reference=known, **figures)

            def finish(step_us: float) -> None:
                recorder.end(infos=force.take_infos(), **projecting(last), step_us=step_us)

            return finish

        ending = self._walk(walker, record)
        return [recorder.steps()], ending

    def _state(self, data: mujoco.MjData) -> State:
        return State(self._prepared.model, data, self._terms)

    def _projector(self, solver: SolverSpec | None) -> Projector | None:
        return Projector(self._prepared.model, solver=solver) if solver else None

    def _walk(self, walker: Walker, record: Callable[[int], Finish]) -> Ending | None:
        """Walks all steps, recording each as it is taken; gives what ended the walk early, if anything did."""
        data = walker.data
        ticks = 0
        # A run that diverges overflows on its way; it ends with a status, not with warnings.
        with self._prepared.drive.installed(), np.errstate(over="ignore", invalid="ignore"):
            for step in range(self._prepared.steps):
                try:
                    began = time.perf_counter()
                    walker.look()
                    looked = time.perf_counter()
                    finish = record(step)
                    recorded = time.perf_counter()
                    walker.step()
                    finish(1e6 * (time.perf_counter() - recorded + looked - began))
                except DiskError:
                    raise
                except InputError as error:
                    return Ending(step, data.time, error)
                if not is_finite(data):
                    return Ending(step, data.time)
                ticks += 1
                if ticks == TICK_STEPS:
                    self._tick(ticks)
                    ticks = 0
        self._tick(ticks)
        return None

    def _recorder(self) -> Recorder:
        return self._recorders(1)[0]

    def _recorders(self, count: int) -> list[Recorder]:
        return [Recorder(self._prepared, spool) for spool in self._spools(count)]

    def _row(self, state: State, *answers: np.ndarray) -> Row:
        """What a run notes of a state, and the answers to it: from ``Row.qacc`` on."""
        data, jacobian = state.data, state.jacobian.ravel()
        place = self._prepared.place(data)
        return Row(data.qpos, place, state.residual, state.rate, state.curvature, jacobian, *answers)
