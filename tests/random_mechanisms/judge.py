"""Walks random mechanisms, and holds what solvers and tables say of their states against the oracle."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from oarlock.base.core import solvers
from oarlock.cases.case import Case
from oarlock.cases.case_file import Baumgarte, CaseFile, Form
from oarlock.mechanics.drive import Drive
from oarlock.stepping.path import Path as SteppingPath
from oarlock.stepping.paths import fitting_path
from oarlock.stepping.prepared import Prepared
from oarlock.stepping.projection import TRACKED
from oarlock.stepping.published import PublishedValues
from oarlock.stepping.solvers import MUJOCO, SolverSpec
from oarlock.stepping.state import State

from random_mechanisms.generator import Mechanism, Part
from random_mechanisms.oracle import exact

OURS = tuple(solvers())
"""As long as no test has brought one of its own."""

STEPS = 50

FREE = ("auto", "pinv", "sr1-tracked")
"""Solvers that walk alone; in lockstep all answer."""

RIGHT = 1e-6
"""Relative to a group's largest acceleration, with or without its constraints: a converged answer is off by no more."""

NO_ACCELERATION = 1e-3
"""m/s² or rad/s²: what an error is relative to where nothing moves faster."""

DECIDED = 10.0
"""Gap of eigenvalues from which the smallest ones of an open loop are those of its redundant rows. Below, softness has
opened it so far that its rank says nothing, and the state is left out."""


@dataclass(frozen=True)
class Judgement:
    """One answer to one state, of the group that is furthest off.

    Attributes:
        walk: ``lockstep`` or ``free``, and the form.
        solver: who answered.
        step: number of the step.
        converged: whether the answer says so.
        error: of the acceleration, relative.
        kind: of that group.
        condition: of its A.
        gap: between its eigenvalues, as of ``Exact``.
    """

    seed: int
    walk: str
    solver: str
    step: int
    converged: bool
    error: float
    kind: str
    condition: float
    gap: float

    @property
    def silent(self) -> bool:
        """Whether it is wrong without a word."""
        return self.converged and not self.error <= RIGHT


@dataclass
class Verdict:
    """What was found about one mechanism.

    Attributes:
        ranks: walk → ranks of the table, step by step, less the true one.
        undecided: states of groups too far open to be judged.
        drifts: walk → how far its rows were open at most, m or rad.
        ended: walk → what ended it, where it did not take all steps.
    """

    mechanism: Mechanism
    judgements: list[Judgement] = field(default_factory=list)
    ranks: dict[str, np.ndarray] = field(default_factory=dict)
    undecided: int = 0
    drifts: dict[str, float] = field(default_factory=dict)
    ended: dict[str, str] = field(default_factory=dict)

    @property
    def silent(self) -> list[Judgement]:
        """Answers that are wrong without a word."""
        return [judgement for judgement in self.judgements if judgement.silent]

    @property
    def wrong_ranks(self) -> dict[str, str]:
        """Walk → the first step with a wrong rank, and by how much, where there is one."""
        return {
            walk: f"step {np.flatnonzero(off)[0]}: {off[np.flatnonzero(off)[0]]:+d}"
            for walk, off in self.ranks.items()
            if off.any()
        }


class _Recorder(PublishedValues):
    """Keeps the states of a free walk, in place of holding them against published ones."""

    def __init__(self, model: mujoco.MjModel):
        super().__init__(model, (), "")
        self.states: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    @property
    def steps(self) -> list[int]:
        return list(range(STEPS))

    def errors(self, step: int, data: mujoco.MjData) -> dict[str, float]:
        self.states[step] = data.qpos.copy(), data.qvel.copy()
        return {}


class _Asked:
    """The states of one walk, as the oracle sees them; each is solved once for every form."""

    def __init__(self, mechanism: Mechanism, states: dict[int, tuple[np.ndarray, np.ndarray]]):
        self._mechanism, self._states = mechanism, states
        self._data = mujoco.MjData(mechanism.model)
        self._state = State(mechanism.model, self._data, Baumgarte())
        self._mass = np.zeros((mechanism.model.nv, mechanism.model.nv))
        self.undecided = 0

    def read(self, step: int) -> None:
        """Goes to the state of a step."""
        data, model = self._data, self._mechanism.model
        data.qpos[:], data.qvel[:] = self._states[step]
        data.time = step * model.opt.timestep
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        self._state.read()
        mujoco.mj_fullM(model, data, self._mass)

    def answers(self, form: Form) -> Iterator[tuple[Part, np.ndarray, float, float, float]]:
        """Each group with its exact accelerations, what errors are relative to, condition and gap."""
        state, owners = self._state, self._data.efc_id[: self._data.ne]
        aref, softness = state.question(form)
        for part in self._mechanism.parts:
            dofs = part.dofs
            mine = np.array([int(owner) in part.equalities for owner in owners])
            mine &= np.abs(state.jacobian[:, dofs]).max(axis=1, initial=0.0) > 0
            rank = part.rank if softness is None else int(mine.sum())
            found = exact(
                self._mass[np.ix_(dofs, dofs)],
                state.jacobian[np.ix_(mine, dofs)],
                state.unconstrained[dofs],
                aref[mine],
                rank,
                None if softness is None else softness[mine],
            )
            if found.gap < DECIDED:
                self.undecided += 1
                continue
            largest = np.abs([found.acceleration, state.unconstrained[dofs]]).max(initial=0.0)
            yield part, found.acceleration, max(largest, NO_ACCELERATION), found.condition, found.gap

    def acceleration(self, multipliers: np.ndarray) -> np.ndarray:
        """The acceleration (nv) that multipliers (ne) make."""
        change = np.zeros((1, self._mechanism.model.nv))
        qfrc = self._state.jacobian.T @ multipliers
        mujoco.mj_solveM(self._mechanism.model, self._data, change, qfrc[None])
        return self._state.unconstrained + change[0]


def judge(mechanism: Mechanism, names: tuple[str, ...] = (), free: tuple[str, ...] = FREE) -> Verdict:
    """Walks a mechanism with everyone and judges the states at the start, in the middle, at the end, and where the
    rank of the table is another one than before.

    Args:
        mechanism: the mechanism.
        names: solvers in lockstep; all, if left out.
        free: solvers that walk alone.
    """
    names = names or OURS
    verdict = Verdict(mechanism)
    theirs, path = _path(mechanism)
    path.free(SolverSpec(MUJOCO), None, None)
    forms: tuple[Form, ...] = ("hard", "matched")
    tables, ending = path.lockstep(SolverSpec(MUJOCO), None, forms, tuple(SolverSpec(name) for name in names))
    frames = [table.frame() for table in tables]
    count = len(names)
    for form, own in zip(forms, (frames[:count], frames[count:]), strict=True):
        _hold(verdict, f"lockstep {form}", form, dict(zip(names, own, strict=True)), theirs.states, ending)
    for name in free:
        recorder, path = _path(mechanism)
        (table,), ending = path.free(SolverSpec(name), "hard", TRACKED)
        _hold(verdict, f"free {name}", "hard", {name: table.frame()}, recorder.states, ending)
    return verdict


def _path(mechanism: Mechanism) -> tuple[_Recorder, SteppingPath]:
    model = mechanism.model
    case = Case("random", Path(), CaseFile.model_validate({"title": "random"}))
    recorder = _Recorder(model)
    prepared = Prepared(model, Drive(model, case), model.qpos0.copy(), mechanism.qvel, STEPS, published=recorder)
    return recorder, fitting_path(prepared, Baumgarte())


def _hold(
    verdict: Verdict,
    walk: str,
    form: Form,
    frames: dict[str, Any],
    states: dict[int, tuple[np.ndarray, np.ndarray]],
    ending: Any,
) -> None:
    """Judges the tables of one walk in one form."""
    mechanism, first = verdict.mechanism, next(iter(frames.values()))
    if ending is not None:
        verdict.ended[walk] = f"step {ending.step}: {ending.error or 'not finite'}"
    taken = len(first)
    if taken == 0:
        return
    sampled = {0, taken // 2, taken - 1}
    if form == "hard":
        ranks = first["rank"].fill_null(-1).to_numpy() - mechanism.rank
        verdict.ranks[walk] = ranks
        verdict.drifts[walk] = float(first["drift_pos"].max())
        sampled |= set((np.flatnonzero(np.diff(ranks)) + 1).tolist()[:3])
    asked = _Asked(mechanism, states)
    for step in sorted(sampled):
        asked.read(step)
        answers = list(asked.answers(form))
        for name, frame in frames.items():
            qacc = asked.acceleration(np.array(frame["multipliers"][step].to_list()))
            judged = [
                (float(np.nan_to_num(np.abs(qacc[part.dofs] - right).max() / scale, nan=np.inf)), part.kind, *rest)
                for part, right, scale, *rest in answers
            ]
            if judged:
                converged = frame["status"][step] == "converged"
                verdict.judgements.append(Judgement(mechanism.seed, walk, name, step, converged, *max(judged)))
    verdict.undecided += asked.undecided
