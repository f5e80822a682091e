"""The start: whether it is consistent, the nearest pose that is, and what stands in the way where there is none."""

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.diagnosis.loops.assembly import Assembly
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
from oarlock.stepping.closing import CONSISTENT
from oarlock.stepping.projection import Projector
from oarlock.stepping.solvers import REFERENCE, SolverSpec

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
        moved_joint: whose; empty where nothing moved.
        moved_speed: largest change of a velocity.
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
    moved_speed: float
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
) -> ClosedPose:
    """The nearest consistent start: positions by Newton steps in the metric of M, then velocities by v − M⁻¹JᵀA⁺Jv.

    Args:
        model: any; left alone.
        qpos: start (nq); None: that of ``data``, or the model's own.
        qvel: its velocities (nv); None: those of ``data``, or none.
        data: mocap bodies and which equalities are active; left alone.

    Raises:
        InputError: the start is not finite or of another size; or as ``find_loops``.
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
    closed = assembly.close()
    detour = not closed and try_around(assembly, given, TRIES, open_dofs(assembly))
    closed = closed or detour
    if not closed:
        settle(assembly)
    loops = loops_at(assembly, closed)
    left = openings_of(assembly, assembly.residual())
    found = assembly.data.qpos.copy()
    velocity = _admitted(assembly, speed)
    change = assembly.difference(given, found)
    most = int(np.abs(change).argmax())
    moved = float(np.abs(change[most]))
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
        moved_speed=float(np.abs(velocity - speed).max()),
        detour=detour,
        culprits=culprits,
        loops=loops,
        mobility=mobility,
        tilts=find_tilts(assembly, suspect),
    )


def _admitted(assembly: Assembly, qvel: np.ndarray) -> np.ndarray:
    """The velocities (nv) nearest to some in kinetic energy that the rows admit."""
    data = assembly.data
    if not data.ne or not qvel.any():
        return qvel.copy()
    jacobian = assembly.jacobian()[assembly.at_rows()]
    projector = Projector(assembly.model, None, SolverSpec(REFERENCE))
    changed = qvel + projector.correction(data, -(jacobian @ qvel))
    return changed + projector.correction(data, -(jacobian @ changed))
