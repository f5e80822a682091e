"""Solvers by name, and their answers to the question of one state."""

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from oarlock import _core
from oarlock.case_file import Form
from oarlock.errors import InputError, choose
from oarlock.inertia import Inertia
from oarlock.options import join_options, split_options
from oarlock.state import State

MUJOCO = "mujoco"
"""Stands among the solvers for MuJoCo itself, in free runs and as a walker."""

REFERENCE = "pinv"
"""The solver whose multipliers count as the minimum-norm ones."""

RUN_REFERENCE = "pinv-tracked"
"""The same along a run, where the last step's decomposition helps."""


def solver_names() -> list[str]:
    """Names in the registry of the compiled core."""
    return list(_core.solvers())


@dataclass(frozen=True)
class SolverSpec:
    """A solver with options, as written: ``sr1:eps_abs=1e-7,max_iterations=20``."""

    name: str
    options: tuple[tuple[str, float], ...] = ()

    @classmethod
    def parse(cls, text: str) -> "SolverSpec":
        """Reads a specification.

        Raises:
            InputError: unknown solver or option, or a value that is not a number or out of range.
        """
        name, given = split_options(text, "solver option")
        choose("solver", name, [MUJOCO, *solver_names()])
        options = [(key, float(value)) for key, value in given.items()]
        spec = cls(name, tuple(options))
        if name == MUJOCO and options:
            raise InputError(f"'{text}': MuJoCo takes no options here, its settings come from the case")
        if name != MUJOCO:
            spec.make()
        return spec

    def __str__(self) -> str:
        return join_options(self.name, dict(self.options))

    def with_defaults(self, **defaults: float | None) -> "SolverSpec":
        """Adds options that the solver has and the specification leaves open; None is left out."""
        if self.name == MUJOCO:
            return self
        known = _core.solvers()[self.name][1]
        given = dict(self.options)
        added = {k: v for k, v in defaults.items() if v is not None and k in known and k not in given}
        return SolverSpec(self.name, (*self.options, *added.items()))

    def make(self) -> _core.MultiplierSolver:
        """A fresh solver. Raises InputError for an unknown option or a value out of range."""
        return _core.make_solver(self.name, **dict(self.options))


class Answer(NamedTuple):
    """Multipliers (ne) of one state, the accelerations and constraint forces (nv) they give, and the solver's info."""

    multipliers: np.ndarray
    qacc: np.ndarray
    qfrc: np.ndarray
    info: _core.Info


class Question:
    """A λ = b of one state in one form."""

    def __init__(self, state: State, form: Form):
        self.state = state
        self.form: Form = form
        self._inertia = Inertia(state.model)

    def ask(self) -> None:
        """Assembles the system from the state as it was last read."""
        state = self.state
        aref, softness = state.question(self.form)
        self._inertia.assemble(state.data, state.jacobian, state.unconstrained, aref, softness)

    def solve(self, solver: _core.MultiplierSolver) -> tuple[np.ndarray, _core.Info]:
        """One solver's multipliers (ne) and info."""
        return solver.solve_system(self._inertia.system)

    def answer(self, solver: _core.MultiplierSolver) -> Answer:
        """One solver's multipliers, and what follows of them."""
        multipliers, info = self.solve(solver)
        qacc, qfrc = self._inertia.acceleration(self.state.data, multipliers)
        return Answer(multipliers, qacc, qfrc, info)


class SolvedForce:
    """A force law: the answer of one solver to the question of every state it is shown."""

    def __init__(self, state: State, form: Form, solver: _core.MultiplierSolver):
        self.question = Question(state, form)
        self._state, self._solver = state, solver
        self._infos: list[_core.Info] = []

    def take_infos(self) -> list[_core.Info]:
        """The infos of the solves since they were last taken: one a stage."""
        infos, self._infos = self._infos, []
        return infos

    def apply(self, data: mujoco.MjData) -> None:
        """Writes qacc, qfrc_constraint and efc_force."""
        self._state.read()
        self.question.ask()
        answer = self.question.answer(self._solver)
        data.qacc[:] = answer.qacc
        data.qfrc_constraint[:] = answer.qfrc
        data.efc_force[:] = answer.multipliers
        self._infos.append(answer.info)
