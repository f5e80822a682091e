"""The constraint problem of one state, and the answer of a solver to it."""

from typing import NamedTuple

import mujoco
import numpy as np

from oarlock.base import core
from oarlock.cases.case_file import Form
from oarlock.mechanics.inertia import Inertia
from oarlock.stepping.inequalities import Inequalities, Push
from oarlock.stepping.state import State


class Answer(NamedTuple):
    """The answer of a solver to the question of one state.

    Attributes:
        multipliers: λ (ne), in N or N m.
        qacc: accelerations (nv) that they give.
        qfrc: constraint forces (nv): Jᵀλ, and those of limits, friction loss and contacts.
        info: what the solver reports.
    """

    multipliers: np.ndarray
    qacc: np.ndarray
    qfrc: np.ndarray
    info: core.Info


class Question:
    """The problem A λ = b of one state in one form.

    Args:
        state: the state, which is read anew before every question.
        form: ``matched`` or ``hard``.
    """

    def __init__(self, state: State, form: Form):
        self.state = state
        self.form: Form = form
        self._inertia = Inertia(state.model)
        self.inequalities = Inequalities(state.model)

    def ask(self) -> None:
        """Assembles A and b from the state as it was last read.

        The forces of limits, friction loss and contacts are among the smooth ones.
        """
        state = self.state
        aref, softness = state.question(self.form)
        self._inertia.hold_rank(state.data, state.jacobian)
        self._inertia.assemble(state.data, state.jacobian, state.unconstrained, aref, softness)
        if state.others is None:
            self.inequalities.answer(state.data, None, self._inertia.system, aref)
        else:
            pushed = self.inequalities.answer(state.data, state.others, self._inertia.system, aref)
            self._inertia.start_from(pushed)

    def solve(self, solver: core.MultiplierSolver) -> tuple[np.ndarray, core.Info]:
        """Solves for the multipliers λ (ne); returns them and what the solver reports."""
        return solver.solve_system(self._inertia.system)

    def reference(self, solver: core.MultiplierSolver) -> tuple[np.ndarray, core.Info]:
        """The minimum-norm multipliers λ (ne) by the direct solver that judges ``solver``, and what it reports."""
        return self._inertia.system.reference(solver)

    def answer(self, solver: core.MultiplierSolver) -> Answer:
        """Solves for the multipliers and computes the accelerations and forces that follow."""
        multipliers, info = self.solve(solver)
        qacc, qfrc = self._inertia.acceleration(self.state.data, multipliers)
        if info.status == "inaccurate":
            least, _ = self._inertia.acceleration(self.state.data, self.reference(solver)[0])
            info = self._inertia.system.confirm(info, qacc, least)
        qfrc, proved = self.inequalities.conclude(qacc, qfrc)
        # Whoever iterates leaves a residual of its own, which stiff rows magnify.
        if not proved and info.products == 0 and info.status == "converged":
            info = self._inertia.system.doubt(info)
        return Answer(multipliers, qacc, qfrc, info)


class SolvedForce:
    """A force law: applies the answer of one solver to the question of every state."""

    def __init__(self, state: State, form: Form, solver: core.MultiplierSolver):
        self.question = Question(state, form)
        self._state, self.solver = state, solver
        self._infos: list[core.Info] = []
        self._pushes: list[Push] = []

    @property
    def info(self) -> core.Info:
        """What the solver reported last."""
        return self._infos[-1]

    def take_pushes(self) -> list[Push]:
        """Returns what limits, friction loss and contacts took since the last call, one entry per stage with any."""
        pushes, self._pushes = self._pushes, []
        return pushes

    def take_infos(self) -> list[core.Info]:
        """Returns what the solver reported since the last call, one entry per stage, and forgets it."""
        infos, self._infos = self._infos, []
        return infos

    def apply(self, data: mujoco.MjData) -> None:
        """Solves the question of a state and writes qacc, qfrc_constraint and efc_force."""
        self._state.read()
        self.question.ask()
        answer = self.question.answer(self.solver)
        data.qacc[:] = answer.qacc
        data.qfrc_constraint[:] = answer.qfrc
        inequalities = self.question.inequalities
        inequalities.remember(answer.qacc)
        data.efc_force[:] = np.concatenate([answer.multipliers, inequalities.forces])
        self._infos.append(answer.info)
        self._pushes += inequalities.pushes
