"""What a comparison costs, as ratios to bare ``mj_step`` of the same model and steps: interleaved rounds, medians.

MuJoCo runs with its default Newton solver, its Jacobian and islands as the model asks for them, and its timers running,
as they do in a process that imported it; beside that in whichever setting of all three is fastest here.
"""

import statistics
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import mujoco
import numpy as np

from oarlock.base import core
from oarlock.base.errors import InputError
from oarlock.cases.case import load_case
from oarlock.cases.conditions import Conditions
from oarlock.experiments.laboratory import Laboratory
from oarlock.mechanics.engine_version import set_islands
from oarlock.mechanics.load import quiet_engine
from oarlock.stepping import native_path
from oarlock.stepping.native_path import NativePath
from oarlock.stepping.prepared import PreparedCase
from oarlock.stepping.python_path import PythonPath
from oarlock.stepping.solvers import MUJOCO, SolverSpec

MODELS = ("boat", "four_bar", "n_four_bar:N=10,connects=2", "n_four_bar:N=40,connects=2")
CONTACTS = ("gripping_gripper", "standing_leg")
"""Models in whose walks contacts push at every step: an exact step of theirs should cost no more than ``mj_step``."""
STEPS = 2000
ROUNDS = 15
RUNS = 16

BARE = "mj_step"
EXACT = "exact free run, auto"
PROJECTED = f"{EXACT}, projected"
_JACOBIANS = {
    "dense": mujoco.mjtJacobian.mjJAC_DENSE,
    "sparse": mujoco.mjtJacobian.mjJAC_SPARSE,
    "auto": mujoco.mjtJacobian.mjJAC_AUTO,
}
_SWITCHES = {
    "": {},
    ", no islands": {"islands": False},
    ", no islands, no timers": {"islands": False, "timers": False},
}
SETTINGS = {
    f"{BARE}, {name} Jacobian{without}": (jacobian, switches)
    for name, jacobian in _JACOBIANS.items()
    if name != "auto"
    for without, switches in _SWITCHES.items()
}
"""Setting of MuJoCo → its Jacobian, and whether it has islands and timers where that is not as usual."""

_TOLERANCE = mujoco.MjSpec().option.tolerance
"""MuJoCo's default."""

_APART, _TOGETHER = ", one after another", ", on all cores"

Contender = Callable[[], float]
"""Does what is to be timed once and gives the time of a step, s."""

Runs = Callable[[int], core.Run]
"""Makes a run of so many steps."""

Start = Callable[[mujoco.MjModel], tuple[np.ndarray, np.ndarray]]
"""Gives positions (nq) and velocities (nv) of a model."""


class Track:
    """A model with what is timed on it, by explicit Euler: a step is one solve.

    Args:
        name: of a model that comes with the package, with its parameters.
        steps: so many a walk takes.
        start: positions (nq) and velocities (nv) of a closed state of the model to begin from; the case's, if left out.

    Attributes:
        rank: of the rows, as the case says; None where it does not.
        terms: Baumgarte's of the case.
        steps: so many a walk takes.

    Raises:
        InputError: the native path cannot be taken, or there is no such model.
    """

    def __init__(self, name: str, steps: int, start: Start | None = None):
        if native_path.refusal():
            raise InputError(f"no native stepping: {native_path.refusal()}")
        case = load_case(name)
        timestep_s = case.file.run.timestep_s or 1e-3
        rank = case.expected().get("rank")
        self.rank = rank if isinstance(rank, int) else None
        self._laboratory = Laboratory(case, Conditions(duration_s=steps * timestep_s))
        self._start = start
        self.terms = case.file.baumgarte
        self.steps = steps

    @property
    def model(self) -> mujoco.MjModel:
        """The model as it walks, its Jacobian left to MuJoCo."""
        return self.prepared().model

    def prepared(self) -> PreparedCase:
        """The same with where it starts and what drives it."""
        return self._setup(_JACOBIANS["auto"])

    def contenders(self) -> dict[str, Contender]:
        """All that a table of steps compares, by name."""
        bare = {name: self.bare(jacobian, **switches) for name, (jacobian, switches) in SETTINGS.items()}
        exact = {EXACT: self.free("auto"), "exact free run, sr1-tracked": self.free("sr1-tracked")}
        return {
            BARE: self.bare(),
            **bare,
            **exact,
            PROJECTED: self.free("auto", projected=True),
            "lockstep, sr1-tracked, all figures, recorded": self._lockstep(),
            "the same on the Python path": self._python(),
            **self._many(f"{RUNS} runs", self._recorded()),
            **self._many(f"{RUNS} runs of {BARE}", self._bare()),
        }

    def _setup(self, jacobian: mujoco.mjtJacobian | None = None, islands: bool = True) -> PreparedCase:
        """What walks; its Jacobian as a run has it, if nothing is said."""
        setup = self._laboratory.setup("euler")
        if self._start is not None:
            setup.qpos, setup.qvel = self._start(setup.model)
        if jacobian is not None:
            setup.model.opt.jacobian = jacobian
        # A model that is a reference asks MuJoCo's solver to go on until nothing improves.
        setup.model.opt.tolerance = max(setup.model.opt.tolerance, _TOLERANCE)
        if not islands:
            set_islands(setup.model, False)
        return setup

    def _path(self, setup: PreparedCase) -> NativePath:
        return NativePath(setup, self.terms, self._make)

    def _make(self, spec: SolverSpec) -> core.MultiplierSolver:
        return spec.with_defaults(rank_cut=self._laboratory.case.file.rank_cut).make()

    def bare(
        self, jacobian: mujoco.mjtJacobian = _JACOBIANS["auto"], islands: bool = True, timers: bool = True
    ) -> Contender:
        """``mj_step`` alone."""
        runs = self.bare_runs(jacobian, islands)
        return lambda: self._timed(partial(runs(self.steps).walk, timers))

    def bare_runs(self, jacobian: mujoco.mjtJacobian = _JACOBIANS["auto"], islands: bool = True) -> Runs:
        """Runs of ``mj_step`` alone."""
        return self._path(self._setup(jacobian, islands)).core.bare

    def free(self, solver: str, *, projected: bool = False) -> Contender:
        """A free run on exact constraints, nothing recorded; a projection may end every step."""
        runs = self.free_runs(solver, projected=projected)
        return lambda: self._timed(runs(self.steps).walk)

    def walked(self, solver: str) -> core.Run:
        """The same, at its end."""
        run = self.free_runs(solver)(self.steps)
        run.walk()
        return run

    def free_runs(self, solver: str, *, projected: bool = False) -> Runs:
        """Free runs on exact constraints."""
        core = self._path(self._setup()).core
        own = self.solver(solver)
        last = self.solver(solver) if projected else None
        return lambda steps: core.free_solved(steps, "hard", own, last)

    def solver(self, name: str) -> core.MultiplierSolver:
        """A new solver, with the rank cut of the case."""
        return self._make(SolverSpec(name))

    def profile(self, solver: str) -> Callable[[], dict[str, Any]]:
        """The same walk with looks at the clock between the parts of a step: what ``Setup.profile`` says of it."""
        core, own = self._path(self._setup()).core, self.solver(solver)
        return lambda: core.profile(self.steps, own)

    def _lockstep(self) -> Contender:
        core = self._path(self._setup()).core
        own = self.solver("sr1-tracked")

        def once() -> float:
            run = core.lockstep(self.steps, [("hard", [own])])
            return self._timed(lambda: (run.advance(self.steps), run.tables()))

        return once

    def _python(self) -> Contender:
        path = PythonPath(self._setup(), self.terms, self._make)
        tracked = (SolverSpec("sr1-tracked"),)
        return lambda: self._timed(lambda: path.lockstep(SolverSpec(MUJOCO), None, ("hard",), tracked))

    def _recorded(self) -> Callable[[], core.Run]:
        runs = self.free_runs("auto")
        return lambda: runs(self.steps)

    def _bare(self) -> Callable[[], core.Run]:
        runs = self.bare_runs()
        return lambda: runs(self.steps)

    def _many(self, name: str, make: Callable[[], core.Run]) -> dict[str, Contender]:
        """Runs one after another and on all cores. Those of ``mj_step`` say what the machine allows."""

        def one_after_another() -> float:
            runs = [make() for _ in range(RUNS)]
            return self._timed(lambda: [run.advance(self.steps) for run in runs]) / RUNS

        def on_all_cores() -> float:
            runs = [make() for _ in range(RUNS)]
            return self._timed(lambda: core.advance_all(runs, self.steps)) / RUNS

        return {name + _APART: one_after_another, name + _TOGETHER: on_all_cores}

    def _timed(self, work: Callable[[], Any]) -> float:
        began = time.perf_counter()
        work()
        return (time.perf_counter() - began) / self.steps


def bench_stepping(
    models: tuple[str, ...] | list[str] = MODELS,
    rounds: int = ROUNDS,
    steps: int = STEPS,
    names: tuple[str, ...] | None = None,
) -> Iterator[list[dict[str, Any]]]:
    """The table of each model as soon as it is measured; of some ``names`` only, which follow one another closely then.

    Every row has model, name, step_us (median), ratio to bare ``mj_step``, ratio_to_fastest, to its fastest setting,
    and speedup, of runs on all cores over the same one after another, else None (medians of the ratios of each round).

    Raises:
        InputError: the native path cannot be taken, or there is no such model.
    """
    for model in models:
        everyone = Track(model, steps).contenders()
        contenders = {name: once for name, once in everyone.items() if names is None or name in names}
        times: dict[str, list[float]] = {name: [] for name in contenders}
        with quiet_engine():
            for _ in range(rounds):
                for name, once in contenders.items():
                    times[name].append(once())
        fastest = min(
            (name for name in times if name.startswith(BARE)), key=lambda name: statistics.median(times[name])
        )

        def ratio(name: str, over: str, times: dict[str, list[float]] = times) -> float:
            return statistics.median(a / b for a, b in zip(times[name], times[over], strict=True))

        yield [
            {
                "model": model,
                "name": name,
                "step_us": 1e6 * statistics.median(times[name]),
                "ratio": ratio(name, BARE),
                "ratio_to_fastest": ratio(name, fastest),
                "speedup": ratio(name.replace(_TOGETHER, _APART), name) if name.endswith(_TOGETHER) else None,
            }
            for name in contenders
        ]
