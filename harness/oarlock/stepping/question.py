"""The question of one state, and the answer of a solver to it."""

from typing import NamedTuple

import mujoco
import numpy as np

from oarlock.base import core
from oarlock.cases.case_file import Form
from oarlock.mechanics.inertia import Inertia
from oarlock.stepping.state import State


class Answer(NamedTuple):
    """Multipliers (ne) of one state, the accelerations and constraint forces (nv) they give, and the solver's info."""

    multipliers: np.ndarray
    qacc: np.ndarray
    qfrc: np.ndarray
    info: core.Info


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

    def solve(self, solver: core.MultiplierSolver) -> tuple[np.ndarray, core.Info]:
        """One solver's multipliers (ne) and info."""
        return solver.solve_system(self._inertia.system)

    def answer(self, solver: core.MultiplierSolver) -> Answer:
        """One solver's multipliers, and what follows of them."""
        multipliers, info = self.solve(solver)
        qacc, qfrc = self._inertia.acceleration(self.state.data, multipliers)
        return Answer(multipliers, qacc, qfrc, info)


class SolvedForce:
    """A force law: the answer of one solver to the question of every state it is shown."""

    def __init__(self, state: State, form: Form, solver: core.MultiplierSolver):
        self.question = Question(state, form)
        self._state, self._solver = state, solver
        self._infos: list[core.Info] = []

    def take_infos(self) -> list[core.Info]:
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
