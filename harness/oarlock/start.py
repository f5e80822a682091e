"""A consistent start: positions on the constraint manifold, velocities along it."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.cases import Case
from oarlock.drive import Drive
from oarlock.errors import InputError, choose
from oarlock.inequalities import IGNORED, refuse_inequalities
from oarlock.mechanism import closing_jacobian, element_name, equalities
from oarlock.projection import Projector, gap
from oarlock.reactions import unique_reactions
from oarlock.solvers import REFERENCE, SolverSpec

CLOSED = 1e-12
"""A loop is closed when no row is off by more, in m or rad: about 1000 rounding errors of a length of 1 m, so that a
start that is already consistent comes out as it went in."""

KEYFRAME = "start"
"""Name of the model's keyframe that a start begins from, where there is one; entries of [start] come on top."""

MAX_STEPS = 50
TRUST = 0.5
"""Longest Newton step of one coordinate, in rad or m."""


@dataclass(frozen=True)
class ConsistentStart:
    """A start and what the constraints are there."""

    qpos: np.ndarray
    qvel: np.ndarray
    rows: int
    rank: int
    dof: int
    moved: float
    """Largest change that closing made to a coordinate, in rad or m."""
    unique: dict[str, bool]
    """Equality → whether the rigid model determines its multipliers."""


def _write_named(model: mujoco.MjModel, target: np.ndarray, values: dict, what: str, case: Case) -> None:
    joints = [model.joint(index).name for index in range(model.njnt)]
    sizes = {0: (7, 6), 1: (4, 3), 2: (1, 1), 3: (1, 1)}
    for name, value in values.items():
        index = joints.index(choose(f"joint in [start] {what} of case '{case.name}'", name, joints))
        size = sizes[int(model.jnt_type[index])][0 if what == "qpos" else 1]
        entries = np.atleast_1d(np.asarray(value, dtype=float))
        if len(entries) != size:
            raise InputError(
                f"[start] {what} of joint '{name}' in case '{case.name}' has {len(entries)} numbers, expected {size}"
            )
        address = model.jnt_qposadr[index] if what == "qpos" else model.jnt_dofadr[index]
        target[address : address + size] = entries


def _worst(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[str, float]:
    row = int(np.abs(data.efc_pos[: data.ne]).argmax())
    index = int(data.efc_id[row])
    return element_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, index), gap(data)


def consistent_start(model: mujoco.MjModel, case: Case) -> ConsistentStart:
    """Closes the loops of a case's start, then makes its velocities obey them.

    Positions by Newton steps in the metric of M, damped when they do not help (Levenberg–Marquardt); velocities by
    v − M⁻¹ Jᵀ A⁺ J v. Ranks are counted at the closed pose.

    Raises:
        InputError: a name or a size is wrong, rows other than equality rows are active, or a loop cannot be closed.
    """
    data = mujoco.MjData(model)
    keys = [model.key(index).name for index in range(model.nkey)]
    if KEYFRAME in keys:
        data.qpos[:], data.qvel[:] = model.key_qpos[keys.index(KEYFRAME)], model.key_qvel[keys.index(KEYFRAME)]
    _write_named(model, data.qpos, case.file.start.qpos, "qpos", case)
    _write_named(model, data.qvel, case.file.start.qvel, "qvel", case)
    Drive(model, case).apply(data)
    if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
        raise InputError(f"start of case '{case.name}' is not finite: qpos {data.qpos}, qvel {data.qvel}")

    given = data.qpos.copy()
    with _loops_only(model):
        _close(model, data, case)
    mujoco.mj_fwdPosition(model, data)
    refuse_inequalities(model, data)

    projector = Projector(model, case.file.rank_cut, SolverSpec(REFERENCE))
    mujoco.mj_fwdVelocity(model, data)
    velocity = projector.correction(data, -(closing_jacobian(model, data) @ data.qvel))
    if np.abs(data.efc_vel[: data.ne]).max() > CLOSED:
        data.qvel += velocity
    difference = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, difference, 1.0, given, data.qpos)
    return ConsistentStart(
        qpos=data.qpos.copy(),
        qvel=data.qvel.copy(),
        rows=int(data.ne),
        rank=projector.rank,
        dof=model.nv - projector.rank,
        moved=float(np.abs(difference).max()),
        unique=unique_reactions(model, data, projector.rank),
    )


@contextmanager
def _loops_only(model: mujoco.MjModel) -> Iterator[None]:
    """Switches contacts, limits and friction off: on its way to a closed pose the mechanism may pass through them."""
    flags = model.opt.disableflags
    model.opt.disableflags |= IGNORED
    try:
        yield
    finally:
        model.opt.disableflags = flags


def _close(model: mujoco.MjModel, data: mujoco.MjData, case: Case) -> None:
    mujoco.mj_fwdPosition(model, data)
    if data.ne == 0:
        names = ", ".join(equality.name for equality in equalities(model))
        raise InputError(f"no active equality rows at the start (equalities: {names}), expected a closed loop")
    projector = Projector(model, case.file.rank_cut, SolverSpec(REFERENCE))
    error = gap(data)
    damping = 0.0
    for _ in range(MAX_STEPS):
        if error <= CLOSED:
            return
        step = projector.correction(data, -data.efc_pos[: data.ne], damping)
        step *= min(1.0, TRUST / max(np.abs(step).max(), TRUST))
        before = data.qpos.copy()
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        mujoco.mj_fwdPosition(model, data)
        after = gap(data)
        if after < error:
            error, damping = after, damping / 10.0 if damping > 1e-12 else 0.0
            continue
        data.qpos[:] = before
        mujoco.mj_fwdPosition(model, data)
        if error <= 100 * CLOSED:
            return  # rounding: long mechanisms cannot do better
        scale = float(np.abs(data.efc_diagA[: data.ne]).max())
        damping = max(10.0 * damping, 1e-6 * scale)
    name, open_by = _worst(model, data)
    raise InputError(
        f"start of case '{case.name}' cannot be closed: equality '{name}' stays open by {open_by:.3g} after "
        f"{MAX_STEPS} steps, expected at most {CLOSED:g}"
    )
