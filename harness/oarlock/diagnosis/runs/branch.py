"""Whether MuJoCo's run and the exact one end on the same assembly branch.

A mechanism with one freedom moves on a curve of closed poses. Where curves cross at a singular pose, or come close to
one another beside it, a soft loop may go on along another one. It is told in two ways:

- The direction of the curve, with the sign that the rows give it, changes steadily along the curve, and is reversed for
  who jumps to the other one. MuJoCo's run and the exact one must be reversed at the same times.
- MuJoCo's last pose is closed, and the curve through the exact motion's last pose is followed to both sides, straight
  through singular poses: where it nowhere comes to MuJoCo's pose, that is on another one.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.curves import ARC, Linkage
from oarlock.diagnosis.loops.events import RankHistory
from oarlock.diagnosis.loops.loops import Loops
from oarlock.diagnosis.runs.exact import ExactRun
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.undriven import Coupling
from oarlock.mechanics.names import element_name
from oarlock.poses.assembly import Assembly

APART = 2.0 * ARC
"""rad, or sizes. Poses of a curve are half of that apart at most: what is further from all of them is not on it."""

LOOKS = 12
"""Times of the run at which it is looked where MuJoCo's motion left the branch."""

SAMPLES = 4000
"""Poses of a run at most whose direction is looked at."""

ALONG = 0.9
"""Cosine between the direction of the curve and the motion's: where it is less, rows of an open loop do not tell."""

ALIKE = 0.05
"""Of the run: MuJoCo's and the exact motion pass the same singular pose within so much time."""


CONSTANT = 1e-6
"""Of the way of a joint: two that stay together to that turn one to one."""


@dataclass(frozen=True)
class Branch:
    """Another branch that MuJoCo's run ends on.

    Attributes:
        equalities: of the group.
        joint: whose coordinate differs most at the end of the run.
        apart: by how much its coordinates are apart there; unit: rad (modulo whole turns) or m.
        since_s: when MuJoCo left the exact motion's branch.
        kept: whether the settings of the recipe keep it on that branch: then it is what opens the loop that leads away.
        line_s: when the exact motion passes a singular pose about there, where both branches cross; None: it does not.
        coupling: of two joints that is so all along the exact motion, with which the run stays on it.
    """

    equalities: tuple[str, ...]
    joint: str
    apart: float
    unit: str
    since_s: float
    kept: bool = False
    line_s: float | None = None
    coupling: Coupling | None = None


def find_branch(
    recording: Recording, exact: ExactRun, loops: Loops, near: set[str], size: float, data: mujoco.MjData
) -> Branch | None:
    """Looks at groups with one freedom; None where all end on the exact motion's branch, or none can be told.

    Args:
        recording: MuJoCo's run.
        exact: the exact one, to the same time.
        loops: at the closed start.
        near: equalities of which one at least is in a group that is looked at.
        size: of the loops, m.
        data: mocap bodies and which equalities are active; left alone.
    """
    model = recording.model
    if not len(recording.qpos) or not len(exact.qpos) or not np.isfinite(recording.qpos[-1]).all():
        return None
    assembly = Assembly(model, data)
    for number, group in enumerate(loops.groups):
        if group.dof != 1 or near.isdisjoint(group.equalities) or not Linkage.serves(model, loops, number):
            continue
        linkage = Linkage(assembly, loops, number, size)
        since = _jumped(linkage, recording, exact) if linkage.oriented else None
        if since is None:
            since = _elsewhere(linkage, recording, exact)
        if since is None:
            continue
        theirs, ours = linkage.coordinates(recording.qpos[-1]), linkage.coordinates(exact.qpos[-1])
        each = linkage.apart_each(theirs, ours)
        joint = linkage.joints[int(each.argmax())]
        unit = linkage.unit_of(joint)
        name = element_name(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
        return Branch(group.equalities, name, float(each.max()) * (size if unit == "m" else 1.0), unit, since)
    return None


def crossing(branch: Branch, history: RankHistory | None, end_s: float) -> float | None:
    """When the motion passes the singular pose at which a run left its branch, if it does."""
    events = history.events if history is not None else ()
    near = [
        event.time_s
        for event in events
        if event.kind == "singular"
        and not {*event.equalities}.isdisjoint(branch.equalities)
        and abs(event.time_s - branch.since_s) <= ALIKE * end_s
    ]
    return min(near, key=lambda time: abs(time - branch.since_s), default=None)


def alike(recording: Recording, exact: ExactRun, loops: Loops, equalities: tuple[str, ...]) -> Coupling | None:
    """The coupling of two joints of a group that turn one to one all along the exact motion; None where none do."""
    model = recording.model
    number = next(at for at, group in enumerate(loops.groups) if group.equalities == equalities)
    one = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    joints = [int(model.dof_jntid[dof]) for dof in loops.dofs(number)]
    joints = [joint for joint in joints if model.jnt_type[joint] in one]
    driven = [joint for joint in joints if np.isin(joint, model.actuator_trnid[:, 0])]
    grounded = [joint for joint in joints if model.body_weldid[model.body_parentid[model.jnt_bodyid[joint]]] == 0]
    for first, second in ((a, b) for b in driven or joints for a in grounded if a != b):
        if model.jnt_type[first] != model.jnt_type[second]:
            continue
        here, there = (exact.qpos[:, model.jnt_qposadr[joint]] for joint in (first, second))
        for ratio in (1.0, -1.0):
            if np.ptp(here) > APART and float(np.ptp(here - ratio * there)) <= CONSTANT * float(np.ptp(here)):
                zeros = [float(model.qpos0[model.jnt_qposadr[joint]]) for joint in (first, second)]
                offset = float(here[0] - zeros[0] - ratio * (there[0] - zeros[1]))
                names = [element_name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) for joint in (first, second)]
                return Coupling(names[0], names[1], 0.0 if abs(offset) < CONSTANT else offset, ratio)
    return None


def _jumped(linkage: Linkage, recording: Recording, exact: ExactRun) -> float | None:
    """When MuJoCo's run is reversed and the exact one is not, or the other way round; None if never."""
    theirs, ours = (_reversals(linkage, run.qpos, run.time) for run in (recording, exact))
    end = min(float(recording.time[-1]), float(exact.time[-1]))
    window = ALIKE * end
    for place in range(max(len(theirs), len(ours))):
        own, other = (times[place] if place < len(times) else np.inf for times in (theirs, ours))
        if abs(own - other) > window:
            first = min(own, other)
            return first if first < end - window else None
    return None


def _reversals(linkage: Linkage, qpos: np.ndarray, times: np.ndarray) -> list[float]:
    chosen = np.unique(np.linspace(0, len(qpos) - 1, min(SAMPLES, len(qpos))).astype(int))
    moves = np.diff(linkage.coordinates(qpos[chosen]), axis=0)
    lengths = np.linalg.norm(moves, axis=1)
    found: list[float] = []
    before: tuple[np.ndarray, float] | None = None
    for place in np.flatnonzero(lengths > 0.0).tolist():
        move = moves[place] / lengths[place]
        along = linkage.along(qpos[chosen[place]], move)
        if abs(along) < ALONG:  # at a singular pose, or one that is open beside it: the rows do not tell
            continue
        if before is not None and before[1] * along < 0.0 and before[0] @ move > 0.0:
            found.append(float(times[chosen[place]]))
        before = move, along
    return found


def _elsewhere(linkage: Linkage, recording: Recording, exact: ExactRun) -> float | None:
    """Since when MuJoCo is on a curve that the exact motion does not come to; None if it is not at the end."""
    theirs = _closed(linkage, recording.qpos[-1])
    ours = linkage.coordinates(exact.qpos)
    if theirs is None or float(linkage.apart(ours, theirs).min()) <= APART:
        return None
    curve, whole = linkage.curve(exact.qpos[-1])
    every = np.concatenate([curve, ours])
    if not whole or float(linkage.apart(every, theirs).min()) <= APART:
        return None
    since = recording.steps - 1
    for step in np.linspace(0, recording.steps - 1, LOOKS).astype(int)[::-1].tolist():
        pose = _closed(linkage, recording.qpos[step])
        if pose is not None and float(linkage.apart(every, pose).min()) <= APART:
            break
        since = step
    return float(recording.time[since])


def _closed(linkage: Linkage, qpos: np.ndarray) -> np.ndarray | None:
    """Coordinates (k) of the closed pose near an open one (nq)."""
    linkage.place(qpos)
    return linkage.coordinates(linkage.pose) if linkage.close() else None
