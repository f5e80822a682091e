"""Whether MuJoCo's run goes through a dead point: a joint is driven on to where the closed loops do not let it go.

At a dead point, or a turning point, of a joint the others still move while it does not, and it turns back. Exact loops
do so. Soft ones are torn open by a strong motor or a heavy link, and what follows is the motion of another mechanism.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.curves import Linkage
from oarlock.diagnosis.loops.gaps import Opening, opening, widest
from oarlock.diagnosis.loops.loops import Loops
from oarlock.diagnosis.runs.exact import ExactRun
from oarlock.diagnosis.runs.recording import Recording
from oarlock.mechanics.names import element_name
from oarlock.poses.assembly import Assembly
from oarlock.poses.layout import Layout

TORN = 1e-3
"""Of the size of the loops: one that opens by less was not torn."""

BEYOND = 0.3
"""rad, or of the size: a joint that goes further than its limit by this is through. Every rocker has such limits, and a
soft loop overshoots them by what it is open, divided by a length."""

CLOSED = 0.05
"""Of the size of the loops: a loop that is open by more before its joint comes to the limit was not torn there."""

TURNS = 0.1
"""rad, or of the size: the exact motion turns back where it comes so near to the limit."""

ROUND = 2.0 * np.pi
"""rad, or sizes: a joint that comes so far has no end."""

CANDIDATES = 4
"""So many joints at most are sent to their limits, those first that go beyond first."""

_JOINT = mujoco.mjtObj.mjOBJ_JOINT


@dataclass(frozen=True)
class DeadPoint:
    """A joint that MuJoCo's run takes beyond what its loops admit.

    Attributes:
        joint: its name; unit: of its coordinate; driven: whether an actuator moves it.
        limit: the furthest coordinate that the closed loops admit; furthest: MuJoCo's.
        time_s: when MuJoCo is beyond the limit for good measure, by ``BEYOND``.
        turns_s: when the exact motion is nearest to it and turns back; None where there is no exact run to that time.
        equality: that is torn most afterwards; equalities: all of the group.
        torn: by how much.
        speed: largest rate of the joint afterwards, per s.
    """

    joint: str
    unit: str
    driven: bool
    limit: float
    furthest: float
    time_s: float
    turns_s: float | None
    equality: str
    equalities: tuple[str, ...]
    torn: Opening
    speed: float


def find_dead_point(
    recording: Recording, exact: ExactRun | None, loops: Loops, size: float, data: mujoco.MjData
) -> DeadPoint | None:
    """Looks at the joints of the groups that are torn; None where none goes beyond its limit.

    Args:
        recording: MuJoCo's run.
        exact: the exact one, or None.
        loops: at the closed start.
        size: of the loops, m.
        data: mocap bodies and which equalities are active; left alone.
    """
    model, found = recording.model, []
    if recording.end.how != "finished" or not recording.steps:  # what diverges goes everywhere
        return None
    poses, times = recording.qpos, recording.time
    assembly = Assembly(model, data)
    for number, group in enumerate(loops.groups):
        places = [place for place, one in enumerate(recording.layout.equalities) if one.name in group.equalities]
        deviations = np.abs(recording.position)
        worst = max(float(deviations[:, recording.layout.of_equality(place)].max(initial=0.0)) for place in places)
        if worst <= TORN * size or group.dof < 1 or not Linkage.serves(model, loops, number):
            continue
        linkage = Linkage(assembly, loops, number, size)
        for joint, way, first in _beyond(linkage, poses, exact, loops.qpos, size):
            dead = _limited(linkage, recording, exact, loops.qpos, joint, way, first, poses, times, places)
            if dead is not None:
                found.append(dead)
    return min(found, key=lambda one: (not one.driven, one.time_s), default=None)


def _beyond(
    linkage: Linkage, poses: np.ndarray, exact: ExactRun | None, closed: np.ndarray, size: float
) -> list[tuple[int, float, int]]:
    """Joints that go beyond where the exact motion goes, with the way and the first pose, the first ones first."""
    found = []
    for joint, place in zip(linkage.joints, linkage.places, strict=True):
        known = exact.qpos[:, place] if exact is not None and len(exact.qpos) else closed[place : place + 1]
        margin = BEYOND * (size if linkage.unit_of(joint) == "m" else 1.0)
        for way in (1.0, -1.0):
            beyond = way * poses[:, place] > (way * known).max() + margin
            if beyond.any():
                found.append((joint, way, int(beyond.argmax())))
    return sorted(found, key=lambda one: one[2])[:CANDIDATES]


def _limited(
    linkage: Linkage,
    recording: Recording,
    exact: ExactRun | None,
    closed: np.ndarray,
    joint: int,
    way: float,
    first: int,
    poses: np.ndarray,
    times: np.ndarray,
    places: list[int],
) -> DeadPoint | None:
    model, place = recording.model, int(recording.model.jnt_qposadr[joint])
    unit = linkage.unit_of(joint)
    whole = linkage.size if unit == "m" else 1.0
    start, turns = closed, None
    if exact is not None and len(exact.qpos):
        nearest = int((way * exact.qpos[:, place]).argmax())
        if nearest in (0, len(exact.qpos) - 1):  # it does not turn: MuJoCo's motion is another one for another reason
            return None
        start, turns = exact.qpos[nearest], float(exact.time[nearest])
    furthest = float(way * (way * poses[:, place]).max())
    needed = min(way * (furthest - float(start[place])), ROUND * whole)
    reach = linkage.reach(start, joint, way, needed)
    if not np.isfinite(reach.limit) or way * (furthest - reach.limit) <= BEYOND * whole:
        return None
    if turns is not None and way * (reach.limit - float(start[place])) > TURNS * whole:
        return None
    at = int((way * poses[:, place] > way * reach.limit + BEYOND * whole).argmax())
    arrives = int((way * poses[:, place] > way * reach.limit).argmax())
    if float(recording.drift[: arrives + 1].max()) > CLOSED * linkage.size:
        return None
    layout, after = recording.layout, recording.position[at:]
    openings = {one: _worst(model, layout, one, after) for one in places}
    most = max(openings, key=lambda one: openings[one].largest)
    dof = int(model.jnt_dofadr[joint])
    return DeadPoint(
        joint=element_name(model, _JOINT, joint),
        unit=unit,
        driven=_driven(model, joint),
        limit=reach.limit,
        furthest=furthest,
        time_s=float(times[at]),
        turns_s=turns,
        equality=layout.equalities[most].name,
        equalities=tuple(layout.equalities[one].name for one in places),
        torn=openings[most],
        speed=float(np.abs(recording.qvel[at:, dof]).max()),
    )


def _driven(model: mujoco.MjModel, joint: int) -> bool:
    kinds = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    return bool((np.isin(model.actuator_trntype, kinds) & (model.actuator_trnid[:, 0] == joint)).any())


def _worst(model: mujoco.MjModel, layout: Layout, place: int, position: np.ndarray) -> Opening:
    own, equality = position[:, layout.of_equality(place)], layout.equalities[place]
    return opening(model, equality, own[widest(model, equality, own)])
