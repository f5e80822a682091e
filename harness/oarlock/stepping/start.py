"""Consistent starts: positions on the constraint manifold, velocities along it."""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.text import quoted
from oarlock.cases.case import Case
from oarlock.cases.point import DISTURBANCE
from oarlock.mechanics import controls
from oarlock.mechanics.drive import Drive
from oarlock.mechanics.names import element_name
from oarlock.mechanics.reactions import unique_reactions
from oarlock.mechanics.rows import closing_jacobian
from oarlock.stepping.beginning import Beginning, beginning_of_case
from oarlock.stepping.closing import CLOSED, CONSISTENT, close, culprits, require_rows
from oarlock.stepping.moving import Moving
from oarlock.stepping.projection import Projector, gap
from oarlock.stepping.solvers import REFERENCE, SolverSpec


@dataclass(frozen=True)
class ConsistentStart:
    """A consistent start and what the constraints are there.

    Attributes:
        qpos: positions (nq), with all loops closed.
        qvel: velocities (nv) that obey the constraints.
        rows: number of equality rows, ne.
        rank: rank of A = J M⁻¹ Jᵀ.
        dof: degrees of freedom, nv − rank.
    """

    qpos: np.ndarray
    qvel: np.ndarray
    rows: int
    rank: int
    dof: int
    moved: float
    """Largest change of a coordinate by closing the loops, rad or m."""
    unique: dict[str, bool]
    """Name of an equality → whether the rigid model determines its multipliers."""


def _cannot_close(model: mujoco.MjModel, data: mujoco.MjData, given: np.ndarray, case: Case) -> str:
    row = int(np.abs(data.efc_pos[: data.ne]).argmax())
    name = element_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, int(data.efc_id[row]))
    said = f"equality {quoted(name)} stays open by {gap(data):.3g}, expected at most {CONSISTENT:g}"
    data.qpos[:] = given
    return f"start of case '{case.name}' cannot be closed: {said}; {culprits(model, data, case.file.rank_cut)}"


def _disturb(model: mujoco.MjModel, data: mujoco.MjData, seed: int) -> None:
    moved, pushed = np.random.default_rng(seed).normal(scale=DISTURBANCE, size=(2, model.nv))
    mujoco.mj_integratePos(model, data.qpos, moved, 1.0)
    data.qvel += pushed


def opening_rate(model: mujoco.MjModel, data: mujoco.MjData, drive: Drive) -> np.ndarray | float:
    """∂r/∂t (ne) at the start, m/s or rad/s: what mocap bodies that move make of rows on which nothing else does."""
    moving = Moving.of(model, drive)
    return 0.0 if moving is None else moving.rate(data)


def carried(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray, drive: Drive) -> np.ndarray:
    """The velocities (nv) nearest to those given, in the metric of M, with which a pose stays closed at the start.

    Args:
        model: the model.
        qpos: a closed pose, (nq).
        qvel: velocities there, (nv).
        drive: what moves.
    """
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    drive.apply(data)
    mujoco.mj_fwdPosition(model, data)
    rate = closing_jacobian(model, data) @ qvel + opening_rate(model, data, drive)
    return qvel + Projector(model, None, SolverSpec(REFERENCE)).correction(data, -rate)


def consistent_start(
    model: mujoco.MjModel, case: Case, seed: int | None = None, begins: Beginning | None = None
) -> ConsistentStart:
    """Closes the loops of a case's start, then makes its velocities obey the constraints.

    Positions are found by Newton steps in the metric of M, damped when they do not help (Levenberg–Marquardt), and
    velocities by v − M⁻¹ Jᵀ A⁺ J v. Ranks are counted at the closed pose.

    Args:
        model: the model of the case, prepared.
        case: the case.
        seed: seed of normal numbers of standard deviation ``DISTURBANCE`` that disturb the start before it is closed;
            None for the start as it is.
        begins: where the case begins, if that is known already.

    Raises:
        InputError: a name or a size is wrong, or a loop cannot be closed.
    """
    begins = begins or beginning_of_case(model, case)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.act[:] = begins.qpos, begins.qvel, begins.act
    drive = controls.drive(model, begins.laws)
    drive.apply(data)
    if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
        raise InputError(f"start of case '{case.name}' is not finite: qpos {data.qpos}, qvel {data.qvel}")
    if seed is not None:
        _disturb(model, data, seed)

    given = data.qpos.copy()
    require_rows(model, data)
    if not close(model, data, case.file.rank_cut) and gap(data) > CONSISTENT:
        raise InputError(_cannot_close(model, data, given, case))
    mujoco.mj_fwdPosition(model, data)

    projector = Projector(model, case.file.rank_cut, SolverSpec(REFERENCE))
    mujoco.mj_fwdVelocity(model, data)
    rate = closing_jacobian(model, data) @ data.qvel + opening_rate(model, data, drive)
    velocity = projector.correction(data, -rate)
    if np.abs(rate if drive.mocaps else data.efc_vel[: data.ne]).max() > CLOSED:
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
