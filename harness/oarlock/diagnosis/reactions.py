"""What goes through the equalities of one state of a user's own, and how much of it the rigid model determines."""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.cases.case_file import Baumgarte
from oarlock.cases.case_file import Reactions as Verdict
from oarlock.diagnosis.loops.directions import Directions
from oarlock.diagnosis.loops.uniqueness import find_uniqueness
from oarlock.diagnosis.loops.wrenches import Series, wrenches
from oarlock.diagnosis.runs.beside import find_beside
from oarlock.mechanics.engine_version import SLEEP
from oarlock.mechanics.inequalities import IGNORED
from oarlock.mechanics.made_of import MadeOf
from oarlock.poses.assembly import Assembly
from oarlock.stepping.question import Question
from oarlock.stepping.solvers import REFERENCE, SolverSpec
from oarlock.stepping.state import State

_RIGID = Baumgarte(beta=0.0, k=0.0)
"""Nothing is pulled back: constraints that hold ask for J a = −J̇v and no more."""


@dataclass(frozen=True)
class Load:
    """What an equality does; what it has none of is None.

    Attributes:
        force: on the first body at its anchor, world axes (3), N; the second gets the opposite. Of a connect or weld.
        torque: on the first body, world axes (3), N m; the second gets the opposite. Of a weld.
        along: of a joint or tendon equality, what it does to each of its ends (1 or 2): N m on a hinge, N on a slide
            or as the tension of a tendon that it lengthens.
    """

    force: np.ndarray | None
    torque: np.ndarray | None
    along: np.ndarray | None


@dataclass(frozen=True)
class EqualityReaction:
    """What goes through one active equality.

    Attributes:
        equality: its name, or its number as ``#3``.
        kind: ``connect``, ``weld``, ``joint`` or ``tendon``.
        ends: names of its two bodies, joints or tendons; of a coupling to a constant only one.
        given: by MuJoCo's own multipliers, those of a soft constraint.
        exact: by the multipliers of the least norm that hold the constraints exactly.
        free: the part of ``given`` that the motion does not determine: any other would do, together with what goes
            through other equalities. ``exact`` has no such part.
        verdict: whether what goes through is ``unique``, ``partly unique`` or ``not unique``, along the directions
            that hold something.
        force: which directions of the force are determined; None where there is no force.
        torque: the same of the torque.
        beside: limits, contacts and friction of this state that share its load, in words: beside them it is not unique.
    """

    equality: str
    kind: str
    ends: tuple[str, ...]
    given: Load
    exact: Load
    free: Load
    verdict: Verdict
    force: Directions | None
    torque: Directions | None
    beside: tuple[str, ...] = ()


def reactions(
    model: mujoco.MjModel, data: mujoco.MjData, *, ignore_inequalities: bool = False
) -> tuple[EqualityReaction, ...]:
    """What goes through every active equality at a state, in newtons and newton metres.

    The state is that of ``data``: positions, velocities, activations, controls and applied forces, mocap bodies and
    which equalities are active. Model and data are left as they are; what MuJoCo computes of the state is computed
    anew on a copy.

    Args:
        model: any with equalities.
        data: the state.
        ignore_inequalities: without contacts, limits and friction, for MuJoCo too.

    Returns:
        One for each active equality, in the order of the model.

    Raises:
        InputError: an equality of a kind whose rows are not known; a state that is not finite, or that of another
            model.
    """
    MadeOf(model, model).require(data)
    if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
        raise InputError(f"the state is not finite: qpos {data.qpos}, qvel {data.qvel}")
    model, data = copy.copy(model), copy.copy(data)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    model.opt.enableflags &= ~SLEEP  # a tree that sleeps has no rows
    if ignore_inequalities:
        model.opt.disableflags |= IGNORED
    assembly = Assembly(model, data)
    if not assembly.equalities:
        return ()
    assembly.place(data.qpos)
    rows = assembly.at_rows()
    mujoco.mj_forward(model, data)
    beside = {one.equality: one.others for one in find_beside(model, data)}
    state = State(model, data, _RIGID)
    state.read()
    question = Question(state, "hard")
    question.ask()
    exact, _ = question.solve(SolverSpec(REFERENCE).make())
    both = np.zeros((2, 1, len(assembly.rows)))
    both[0, 0, rows], both[1, 0, rows] = data.efc_force[: data.ne], exact
    pose = data.qpos[None].copy()
    given, least = (wrenches(model, pose, multipliers, data) for multipliers in both)
    known = find_uniqueness(model, pose, data).equalities
    return tuple(
        EqualityReaction(
            equality=equality.name,
            kind=equality.kind.name,
            ends=theirs.ends,
            given=_load(theirs.total),
            exact=_load(ours.total),
            free=_load(theirs.free),
            verdict=what.verdict,
            force=what.force,
            torque=what.torque,
            beside=beside.get(equality.name, ()),
        )
        for equality, theirs, ours, what in zip(assembly.equalities, given, least, known, strict=True)
    )


def _load(series: Series) -> Load:
    """The only sample of a series."""
    return Load(*(None if values is None else values[0] for values in (series.force, series.torque, series.ends)))
