"""Our own solutions of the states, under changes of what the rows are asked for.

MuJoCo asks the rows of an equality for J a + R λ = aref, and of connects and welds aref = −B J v − K d r − J̇v (since
3.7). A law says which part of that is left out or other: no softness R and no stabilisation (the exact solution), no
J̇v, some of the equalities, other masses, another friction cone. The answers are those of our own solver, from the
installed MuJoCo's M, J and forces; they do not depend on whether its own aref has J̇v.
"""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.cases.case_file import Baumgarte, Form
from oarlock.engines.asking import ACCURATE, States
from oarlock.mechanics.names import Equality, element_name, equalities
from oarlock.mechanics.rows import jacobian
from oarlock.stepping.question import Question
from oarlock.stepping.solvers import BESIDE, SolverSpec
from oarlock.stepping.state import State

CONES = {"pyramidal": mujoco.mjtCone.mjCONE_PYRAMIDAL, "elliptic": mujoco.mjtCone.mjCONE_ELLIPTIC}


@dataclass(frozen=True)
class Law:
    """What is asked of the rows.

    Attributes:
        rigid: R = 0 and no stabilisation: the exact solution.
        curvature: whether rows are asked for −J̇v.
        without: names of equalities that are left out.
        cone: of contacts; empty for the model's own.
        masses: (name of a body, kg) of bodies that have another mass.
        arrays: (name of an array of the model, its numbers) of those that another compiler makes otherwise.
    """

    rigid: bool = False
    curvature: bool = True
    without: tuple[str, ...] = ()
    cone: str = ""
    masses: tuple[tuple[str, float], ...] = ()
    arrays: tuple[tuple[str, tuple[float, ...]], ...] = ()


MUJOCO = Law()
"""As MuJoCo asks since 3.7."""

EXACT = Law(rigid=True)
"""What the constraints themselves say."""


@dataclass(frozen=True)
class Solved:
    """Answers of all states under a law.

    Attributes:
        qacc: accelerations (n, nv); force: constraint forces (n, nv); smooth: accelerations without them (n, nv).
        blocks: numbers of the velocities of each mechanism, as of ``Laws``.
    """

    qacc: np.ndarray
    force: np.ndarray
    smooth: np.ndarray
    blocks: tuple[np.ndarray, ...]

    def __getitem__(self, chosen: "np.ndarray | slice") -> "Solved":
        return Solved(self.qacc[chosen], self.force[chosen], self.smooth[chosen], self.blocks)


class _Asked(State):
    """A state whose rows are asked by a law."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, law: Law, known: np.ndarray):
        super().__init__(model, data, Baumgarte())
        self._law, self._known = law, known

    def question(self, form: Form) -> tuple[np.ndarray, np.ndarray | None]:
        """As ``State``, under the law."""
        data = self.data
        ne = data.ne
        if self._law.rigid:
            return (-self.curvature if self._law.curvature else np.zeros(ne)), None
        terms = data.efc_KBIP[:ne]
        aref = -terms[:, 1] * self.rate - terms[:, 0] * terms[:, 2] * self.residual
        if self._law.curvature:
            # Rows of couplings have none in MuJoCo's own law.
            aref = aref - np.where(self._known[data.efc_id[:ne]], self.curvature, 0.0)
        return aref, data.efc_R[:ne]


class Laws:
    """Solves the states of a model under laws, each once.

    Args:
        model: with its own settings.
        states: the states.
    """

    def __init__(self, model: mujoco.MjModel, states: States):
        self.model = copy.copy(model)
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        # How far an iteration goes is no part of what is compared.
        for name, value in ACCURATE.items():
            setattr(self.model.opt, name, type(getattr(self.model.opt, name))(value))
        self.states = states
        self.equalities: list[Equality] = equalities(self.model)
        self.blocks = blocks(self.model, states)
        self._solved: dict[Law, Solved] = {}

    def installed(self) -> Solved:
        """The answers of the installed MuJoCo's own solver."""
        data, rows = mujoco.MjData(self.model), []
        for number in range(len(self.states)):
            self.place(data, number)
            mujoco.mj_forward(self.model, data)
            rows.append((data.qacc.copy(), data.qfrc_constraint.copy(), data.qacc_smooth.copy()))
        return self._joined(rows)

    def stepped(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n, nq) and velocities (n, nv) after one step of the installed MuJoCo."""
        data, qpos, qvel = mujoco.MjData(self.model), [], []
        for number in range(len(self.states)):
            self.place(data, number)
            mujoco.mj_step(self.model, data)
            qpos.append(data.qpos.copy())
            qvel.append(data.qvel.copy())
        return np.array(qpos), np.array(qvel)

    def place(self, data: mujoco.MjData, number: int) -> None:
        """Writes a state into a data of the model, or of a copy."""
        place(self.model, data, self.states, number)

    def solve(self, law: Law, chosen: np.ndarray | None = None) -> Solved:
        """The answers under a law, of all states or of some.

        Raises:
            InputError: the law makes no mechanism of it: a mass of zero, rows of a kind that is not known.
        """
        if law in self._solved:
            return self._solved[law] if chosen is None else self._solved[law][chosen]
        numbers = range(len(self.states)) if chosen is None else chosen.tolist()
        model = self._changed(law)
        data = mujoco.MjData(model)
        known = np.array([one.kind.curvature_since is not None for one in self.equalities])
        left_out = [one.index for one in self.equalities if one.name in law.without]
        state = _Asked(model, data, law, known)
        form: Form = "hard" if law.rigid else "matched"
        rows = []
        for number in numbers:
            self.place(data, number)
            data.eq_active[left_out] = 0
            mujoco.mj_forward(model, data)
            rows.append(_answer(state, form, data))
        solved = self._joined(rows)
        if chosen is None:
            self._solved[law] = solved
        return solved

    def _joined(self, rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> Solved:
        qacc, force, smooth = (np.array(column) for column in zip(*rows, strict=True))
        return Solved(qacc, force, smooth, self.blocks)

    def _changed(self, law: Law) -> mujoco.MjModel:
        if not law.cone and not law.masses and not law.arrays:
            return self.model
        model = copy.copy(self.model)
        for name, values in law.arrays:
            own = getattr(model, name, None)
            if not isinstance(own, np.ndarray) or own.size != len(values):
                raise InputError(f"'{name}' is no array of {len(values)} numbers of this model")
            own[:] = np.reshape(values, own.shape)
        if law.cone:
            model.opt.cone = CONES[law.cone]
        for name, mass in law.masses:
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
            if body < 0 or not 0.0 < mass < np.inf or not model.body_mass[body] > 0.0:
                raise InputError(f"body '{name}' with a mass of {mass:g} kg is no mechanism")
            model.body_inertia[body] *= mass / model.body_mass[body]
            model.body_mass[body] = mass
        if law.masses:
            mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def masses(self) -> dict[str, float]:
        """The mass of every body by its name, kg."""
        names = (element_name(self.model, mujoco.mjtObj.mjOBJ_BODY, body) for body in range(1, self.model.nbody))
        return dict(zip(names, self.model.body_mass[1:].tolist(), strict=True))


def _answer(state: _Asked, form: Form, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    smooth = data.qacc_smooth.copy()
    if data.ne == 0:
        return data.qacc.copy(), data.qfrc_constraint.copy(), smooth
    state.read()
    question = Question(state, form)
    question.ask()
    answer = question.answer(SolverSpec(BESIDE).make())
    return answer.qacc.copy(), answer.qfrc.copy(), smooth


STILL = 1e-3
"""Of the largest scale of all states: one in which less accelerates, such as a mechanism that floats at rest, is
measured by this, for what it has of its own is rounding."""

FAINT = 1e-9
"""Of the largest of all mechanisms: what a mechanism that hardly moves is measured by at least."""


def blocks(model: mujoco.MjModel, states: States) -> tuple[np.ndarray, ...]:
    """Numbers of the velocities of each mechanism: trees that no constraint row joins at any of the states.

    Each is measured by itself: the accelerations of a light rotor are no measure for a four-bar beside it.
    """
    data = mujoco.MjData(model)
    group = model.dof_treeid.astype(int).copy()
    for number in range(len(states)):
        place(model, data, states, number)
        mujoco.mj_fwdPosition(model, data)
        for touched in np.unique(jacobian(model, data) != 0.0, axis=0) if data.nefc else ():
            joined = np.unique(group[touched])
            if len(joined) > 1:
                group[np.isin(group, joined)] = joined[0]
    return tuple(np.flatnonzero(group == one) for one in np.unique(group))


def place(model: mujoco.MjModel, data: mujoco.MjData, states: States, number: int) -> None:
    """Writes a state into a data of a model."""
    mujoco.mj_resetData(model, data)
    data.time = states.time[number]
    data.qpos[:], data.qvel[:] = states.qpos[number], states.qvel[number]
    data.act[:], data.ctrl[:] = states.act[number], states.ctrl[number]


def apart(values: np.ndarray, solved: Solved, sizes: np.ndarray | None = None) -> np.ndarray:
    """Relative difference of accelerations (n, nv) from a solution, of each state and mechanism (n, blocks).

    Args:
        values: the accelerations.
        solved: the solution.
        sizes: what differences are measured by, (n, blocks); by default ``scale`` of the solution.
    """
    return norms(values - solved.qacc, solved.blocks) / (scale(solved) if sizes is None else sizes)


def scale(solved: Solved) -> np.ndarray:
    """What differences of accelerations are measured by, (n, blocks): ‖q̈‖, or what the constraints change if larger.

    At an equilibrium the first is nothing but rounding; where neither is more, see ``STILL``.
    """
    changed = norms(solved.qacc - solved.smooth, solved.blocks)
    return _clear(np.maximum(norms(solved.qacc, solved.blocks), changed))


def forces_apart(values: np.ndarray, solved: Solved) -> np.ndarray:
    """Relative difference of constraint forces (n, nv) from a solution, (n, blocks)."""
    return norms(values - solved.force, solved.blocks) / _clear(norms(solved.force, solved.blocks))


def norms(values: np.ndarray, blocks: tuple[np.ndarray, ...]) -> np.ndarray:
    """The size of each mechanism's part of values (n, nv), (n, blocks)."""
    return np.array([np.linalg.norm(values[:, block], axis=1) for block in blocks]).T.reshape(len(values), len(blocks))


def _clear(sizes: np.ndarray) -> np.ndarray:
    largest = sizes.max(axis=0, initial=0.0)
    return np.maximum(sizes, np.maximum(STILL * largest, max(FAINT * largest.max(initial=0.0), np.finfo(float).tiny)))


def opening(model: mujoco.MjModel, qpos: np.ndarray) -> np.ndarray:
    """How far rows of equalities are open at positions (n, nq): the largest of each (n), m or rad."""
    data, found = mujoco.MjData(model), np.zeros(len(qpos))
    for row, place in enumerate(qpos):
        data.qpos[:] = place
        mujoco.mj_fwdPosition(model, data)
        found[row] = np.abs(data.efc_pos[: data.ne]).max(initial=0.0)
    return found
