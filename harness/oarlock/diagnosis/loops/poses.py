"""The start: whether it is consistent, the nearest pose that is, and what stands in the way where there is none."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from oarlock.base.errors import InputError, few
from oarlock.diagnosis.loops.gaps import (
    TRIES,
    Culprits,
    Opening,
    find_culprits,
    open_dofs,
    openings_of,
    settle,
    try_around,
)
from oarlock.diagnosis.loops.loops import Loops, loops_at
from oarlock.diagnosis.loops.mobility import Mobility, Tilt, find_mobility, find_tilts
from oarlock.mechanics.names import element_name
from oarlock.poses.assembly import Assembly
from oarlock.poses.chart import arm_of, lengths
from oarlock.poses.nearest import (
    Nearest,
    Outside,
    driven_joints,
    joints_called,
    nearest,
    nearest_kept,
    outside_ranges,
)
from oarlock.stepping.closing import CONSISTENT
from oarlock.stepping.projection import Projector
from oarlock.stepping.solvers import REFERENCE, SolverSpec

ALIKE = 1.0 - 1e-6
"""Of the largest change: of several joints that move by as much the first is named, whatever rounding says."""

_JOINT = mujoco.mjtObj.mjOBJ_JOINT


@dataclass(frozen=True)
class ClosedPose:
    """The consistent pose nearest to a start, or what stands in the way.

    Attributes:
        closed: whether every row is, see ``Assembly.close``; ``left`` says how well.
        qpos: the pose (nq), or the best one that was found.
        qvel: the velocities (nv) nearest to those given that the rows admit.
        openings: of every active equality, as given.
        speeds: the same of the rates, m/s and rad/s.
        left: what is left open at ``qpos``; of a closed pose, rounding.
        moved: largest change of a coordinate, rad or m, as the joint has it.
        moved_joint: whose; empty where nothing moved. moved_unit: ``m`` or ``rad``.
        moved_speed: largest change of a velocity.
        norm: the whole change, rad: the root of the sum of squares, lengths over ``arm``; of all closed poses inside of
            ranges this one has the least.
        arm: a length that counts as a radian, m.
        held: joints of open loops that were not to move.
        released: driven joints that were to be held, but then nothing closes.
        norm_free: ``norm`` if nothing were held; as ``norm`` where nothing is.
        rested: limits that the start is beyond, furthest first.
        outside: those that ``qpos`` is beyond: a consistent start stays where it is, and some loops close only there.
        detour: whether the pose was found only from a disturbed start.
        culprits: where it is not closed.
        loops: the loops at ``qpos``.
        mobility: of every group, where closed.
        tilts: of loops that are not closed, locked, or of a doubtful rank.
    """

    closed: bool
    qpos: np.ndarray
    qvel: np.ndarray
    openings: tuple[Opening, ...]
    speeds: tuple[Opening, ...]
    left: tuple[Opening, ...]
    moved: float
    moved_joint: str
    moved_unit: str
    moved_speed: float
    norm: float
    arm: float
    held: tuple[str, ...]
    released: tuple[str, ...]
    norm_free: float
    rested: tuple[Outside, ...]
    outside: tuple[Outside, ...]
    detour: bool
    culprits: tuple[Culprits, ...]
    loops: Loops
    mobility: tuple[Mobility, ...]
    tilts: tuple[Tilt, ...]

    @property
    def consistent(self) -> bool:
        """Whether the start already was, within ``CONSISTENT``."""
        return max((opening.largest for opening in (*self.openings, *self.speeds)), default=0.0) <= CONSISTENT

    @property
    def status(self) -> Literal["consistent", "closed", "locked", "cannot-close"]:
        """The whole in a word; a pose that is locked is closed."""
        if not self.closed:
            return "cannot-close"
        if any(one.locked for one in self.mobility):
            return "locked"
        return "consistent" if self.consistent else "closed"


def nearest_closed(
    model: mujoco.MjModel,
    qpos: np.ndarray | None = None,
    qvel: np.ndarray | None = None,
    data: mujoco.MjData | None = None,
    *,
    hold: Sequence[str] | None = (),
) -> ClosedPose:
    """The nearest consistent start: positions as ``nearest``, then velocities by v − M⁻¹JᵀA⁺Jv.

    A start that is closed within ``CONSISTENT`` is taken to rounding by Newton steps in the metric of M, and is not
    moved into ranges.

    Args:
        model: any; left alone.
        qpos: start (nq); None: that of ``data``, or the model's own.
        qvel: its velocities (nv); None: those of ``data``, or none.
        data: mocap bodies and which equalities are active; left alone.
        hold: joints that stay as they are; None: those that actuators act on, where the rest can close.

    Raises:
        InputError: the start is not finite or of another size; no joint of a name, or nothing closes while those stay;
            or as ``find_loops``.
    """
    for name, value, size in (("qpos", qpos, model.nq), ("qvel", qvel, model.nv)):
        if value is not None and (np.shape(value) != (size,) or not np.isfinite(value).all()):
            raise InputError(f"{name} of the start has the shape {np.shape(value)}, expected {size} finite numbers")
    assembly = Assembly(model, data)
    given = np.array(assembly.data.qpos if qpos is None else qpos, dtype=float)
    mujoco.mj_normalizeQuat(assembly.model, given)
    speed = np.array(assembly.data.qvel if qvel is None else qvel, dtype=float)
    assembly.place(given)
    assembly.require_finite()
    openings = openings_of(assembly, assembly.residual())
    speeds = openings_of(assembly, assembly.jacobian() @ speed, rates=True)
    way, released = _way(model, assembly, given, data, hold)
    if way is None:
        closed = assembly.close()
        detour = not closed and try_around(assembly, given, TRIES, open_dofs(assembly))
        closed = closed or detour
    else:
        assembly.place(way.qpos)
        closed, detour = True, way.detour
    if not closed:
        settle(assembly)
    loops = loops_at(assembly, closed)
    left = openings_of(assembly, assembly.residual())
    found = assembly.data.qpos.copy()
    velocity = _admitted(assembly, speed)
    change = assembly.difference(given, found)
    most = int((np.abs(change) >= ALIKE * np.abs(change).max()).argmax())
    moved = float(np.abs(change[most]))
    arm = arm_of(assembly) if way is None else way.arm
    norm = float(np.linalg.norm(change / np.where(lengths(model), arm, 1.0)))
    culprits = () if closed else find_culprits(assembly, given, loops, left)
    mobility = find_mobility(assembly, loops) if closed else ()
    stuck = {name for one in mobility if one.locked for name in one.equalities}
    stuck |= {name for group in loops.groups if group.spectrum.doubtful for name in group.equalities}
    suspect = stuck if closed else {name for one in culprits for name in one.equalities}
    return ClosedPose(
        closed=closed,
        qpos=found,
        qvel=velocity,
        openings=openings,
        speeds=speeds,
        left=left,
        moved=moved,
        moved_joint=element_name(model, _JOINT, int(model.dof_jntid[most])) if moved else "",
        moved_unit="m" if lengths(model)[most] else "rad",
        moved_speed=float(np.abs(velocity - speed).max()),
        norm=norm,
        arm=arm,
        held=way.held if way else (),
        released=released,
        norm_free=_norm_free(model, given, way, data) if way and way.held else norm,
        rested=outside_ranges(model, given, data),
        outside=outside_ranges(model, found, data),
        detour=detour,
        culprits=culprits,
        loops=loops,
        mobility=mobility,
        tilts=find_tilts(assembly, suspect),
    )


def _way(
    model: mujoco.MjModel, assembly: Assembly, given: np.ndarray, data: mujoco.MjData | None, hold: Sequence[str] | None
) -> tuple[Nearest | None, tuple[str, ...]]:
    """The way to the nearest closed pose, and the driven joints that had to be let go; None if there is nothing to do.

    Where ranges admit no closed pose, they are left.
    """
    asked = joints_called(model, tuple(hold or ()))
    if float(np.abs(assembly.residual()).max(initial=0.0)) <= CONSISTENT:
        return None, ()
    here = model, given, data
    held = driven_joints(model) if hold is None else asked
    if asked:
        for limits in (True, False):
            found = nearest(*here, held=asked, limits=limits, tolerance=CONSISTENT)
            if found is not None:
                return found, ()
        names = few([f"'{name}'" for name in hold or ()])
        raise InputError(f"--hold: no pose closes the loops with {names} held, expected joints that may stay")
    found, kept = nearest_kept(*here, held=held, tolerance=CONSISTENT)
    if kept:
        return found, ()
    concerned = {int(model.dof_jntid[dof]) for dof in open_dofs(assembly)}
    released = [element_name(model, _JOINT, joint) for joint in held if joint in concerned]
    return found, tuple(released) if found is not None else ()


def _norm_free(model: mujoco.MjModel, given: np.ndarray, way: Nearest, data: mujoco.MjData | None) -> float:
    """How far the nearest closed pose is with nothing held, rad."""
    found = nearest(model, given, data, limits=way.limits, tolerance=CONSISTENT)
    return way.norm if found is None else min(found.norm, way.norm)


def _admitted(assembly: Assembly, qvel: np.ndarray) -> np.ndarray:
    """The velocities (nv) nearest to some in kinetic energy that the rows admit."""
    data = assembly.data
    if not data.ne or not qvel.any():
        return qvel.copy()
    jacobian = assembly.jacobian()[assembly.at_rows()]
    projector = Projector(assembly.model, None, SolverSpec(REFERENCE))
    changed = qvel + projector.correction(data, -(jacobian @ qvel))
    return changed + projector.correction(data, -(jacobian @ changed))
