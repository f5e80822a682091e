"""Mocap targets that a mechanism cannot follow: out of reach, turned as it cannot turn, or faster than its rows.

A mocap body goes where a program puts it. What is joined to it by a connect or a weld follows as a spring pulls it: a
target beyond its reach stretches the spring for good, and no stiffness brings them together. The nearest pose that a
target can have is where the mechanism stands when the spring is as short as it gets; a run with the target there tells
whether it is met. MuJoCo's rows take a target for standing still, so that behind one that moves they lag,

    b J v + k d r = 0,    r = v b/(k d) = 2 timeconst dampratio² v    where d is about 1
"""

import copy
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from oarlock.diagnosis.loops.gaps import TRIES_OF_PART, Opening, opening, openings_of, settle, try_around, widest
from oarlock.diagnosis.runs.drifts import Drift
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.mechanics.controls import Laws, drive
from oarlock.mechanics.names import Equality, element_name
from oarlock.poses.assembly import Assembly, anchors
from oarlock.stepping.closing import CONSISTENT

LEAVES = 0.1
"""Of a gap: a target at the pose that is told leaves less."""

STIFF_REF, STIFF_IMP = (2.0, 0.5), (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""Of timesteps, and a dampratio; and a solimp: rows that lag by a step of the target's motion."""

_BODY = mujoco.mjtObj.mjOBJ_BODY
_SCALE = 10
"""Place of a weld's torquescale in ``eq_data``."""


@dataclass(frozen=True)
class Target:
    """A mocap body that what is joined to it does not meet.

    Attributes:
        equality: that joins them; body: the mocap body; held: the other one.
        short: what is left between them where the mechanism comes nearest.
        time_s: when, of a target that moves; None: it stands.
        turned: whether the place can be reached, and not the orientation.
        pos, quat: the nearest pose that can be had, (3) and (4).
        left: what a run with the target there leaves; None where it is not known.
        speed: of the target, m/s, where it is that which it is too fast by; 0: it is out of reach.
        solref: with which a run of a target that is too fast leaves ``left``.
    """

    equality: str
    body: str
    held: str
    short: Opening
    time_s: float | None
    turned: bool
    pos: np.ndarray
    quat: np.ndarray
    left: Opening | None = None
    speed: float = 0.0
    solref: str = ""


def target_of(model: mujoco.MjModel, one: Equality) -> int | None:
    """The end (0 or 1) of a connect or weld that is on a mocap body; None: neither is, or both are."""
    if not one.kind.joins_points:
        return None
    ends = [end for end, body in enumerate(one.bodies) if model.body_mocapid[body] >= 0]
    return ends[0] if len(ends) == 1 else None


def find_targets(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    recording: Recording | None,
    drifts: list[Drift],
    opened: set[str],
    least: float,
    laws: Laws | dict[str, str],
    moved: bool,
) -> tuple[Target, ...]:
    """Looks at the equalities with a mocap body that stay open.

    Args:
        model: the user's.
        data: at the start.
        recording: MuJoCo's run as configured.
        drifts: of its equalities.
        opened: equalities that no pose near the start closes.
        least: drifts below it are not worth a word, m or rad.
        laws: what drives it.
        moved: whether mocap bodies are moved.
    """
    every = Assembly(model, data).equalities
    worst = {one.equality: one for one in drifts if one.level == "position" and one.largest > least}
    found = []
    for one in every:
        end = target_of(model, one)
        if end is None:
            continue
        if one.name in opened and not moved:
            found.append(_out_of_reach(model, data, recording, one, end, data.qpos.copy()))
        elif moved and one.name in worst and recording is not None and recording.end.how == "finished":
            found.append(_behind(model, data, recording, one, end, worst[one.name], laws))
    return tuple(one for one in found if one is not None)


def _behind(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    recording: Recording,
    one: Equality,
    end: int,
    worst: Drift,
    laws: Laws | dict[str, str],
) -> Target | None:
    """A target that moves, at the moment at which it is furthest."""
    step = int(np.abs(recording.time - worst.time_s).argmin())
    there = mujoco.MjData(model)
    there.eq_active[:] = data.eq_active
    given = drive(model, laws)
    for law in given.mocaps:
        there.mocap_pos[law.mocap], there.mocap_quat[law.mocap] = law.at(worst.time_s)
    there.qpos[:] = recording.qpos[step]
    beyond = _out_of_reach(model, there, None, one, end, recording.qpos[step].copy())
    if beyond is not None and beyond.short.largest > 0.5 * worst.largest:
        return replace(beyond, time_s=worst.time_s)
    own = [law for law in given.mocaps if law.body == one.bodies[end]]
    h = float(model.opt.timestep)
    if not own or own[0].constant or not step:
        return None
    places = [own[0].at(time)[0] for time in (worst.time_s - h, worst.time_s)]
    speed = float(np.linalg.norm(places[1] - places[0])) / h
    stiff = copy.deepcopy(recording.model)
    stiff.eq_solref[one.index] = STIFF_REF[0] * h, STIFF_REF[1]
    stiff.eq_solimp[one.index] = STIFF_IMP
    again = rerun(recording, stiff)
    left = None if again is None else _widest(recording, one, again.position)
    whole = Opening(one.name, worst.metres, worst.radians)
    if left is None or left.largest > 0.5 * whole.largest:
        left = None
    return Target(
        equality=one.name,
        body=element_name(model, _BODY, one.bodies[end]),
        held=element_name(model, _BODY, one.bodies[1 - end]),
        short=whole,
        time_s=worst.time_s,
        turned=False,
        pos=places[1],
        quat=own[0].at(worst.time_s)[1],
        left=left,
        speed=speed,
        solref=f"{STIFF_REF[0] * h:g} {STIFF_REF[1]:g}",
    )


def _out_of_reach(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    recording: Recording | None,
    one: Equality,
    end: int,
    start: np.ndarray,
) -> Target | None:
    """A target that no pose meets; None where one does, or where it is another equality that stands in the way."""
    assembly = _nearest(model, data, start)
    if assembly is None:
        return None
    own = [other.index for other in assembly.equalities].index(one.index)
    short = openings_of(assembly, assembly.residual())[own]
    turned = False
    if one.kind.turns:
        points = copy.copy(model)
        points.eq_data[one.index, _SCALE] = 0.0
        placed = _nearest(points, data, start)
        if placed is None:
            turned = True
            assembly = Assembly(points, data)
            assembly.place(start)
            if not assembly.close():
                try_around(assembly, start, TRIES_OF_PART, list(range(model.nv)))
            short = _angle(model, assembly.data, one)
        else:
            assembly = placed
    pos, quat = _met(model, assembly.data, one, end, turned=turned)
    left = None
    if recording is not None:
        moved = copy.deepcopy(recording.model)
        moved.body_pos[one.bodies[end]], moved.body_quat[one.bodies[end]] = pos, quat
        again = rerun(recording, moved)
        if again is not None:
            left = _widest(recording, one, again.position[-max(1, recording.steps // 4) :])
    names = [element_name(model, _BODY, body) for body in (one.bodies[end], one.bodies[1 - end])]
    return Target(one.name, names[0], names[1], short, None, turned, pos, quat, left)


def _nearest(model: mujoco.MjModel, data: mujoco.MjData, start: np.ndarray) -> Assembly | None:
    """Where the rows' squares are least, around a start; None where they can be closed."""
    assembly = Assembly(model, data)
    assembly.place(start)
    if assembly.close() or try_around(assembly, start, TRIES_OF_PART, list(range(model.nv))):
        return None
    settle(assembly)
    return None if float(np.abs(assembly.residual()).max(initial=0.0)) <= CONSISTENT else assembly


def _angle(model: mujoco.MjModel, data: mujoco.MjData, one: Equality) -> Opening:
    turn = np.zeros(4)
    mujoco.mju_mulQuat(turn, _conjugate(_wanted(model, data, one)), _orientations(model, data, one)[1])
    return Opening(one.name, None, 2.0 * float(np.arccos(min(1.0, abs(float(turn[0]))))))


def _orientations(model: mujoco.MjModel, data: mujoco.MjData, one: Equality) -> tuple[np.ndarray, np.ndarray]:
    """Of the two sides of a weld: of its bodies, or of its sites."""
    found = []
    for end in (0, 1):
        quat = data.xquat[one.bodies[end]].copy()
        if one.sites is not None:
            turned = np.zeros(4)
            mujoco.mju_mulQuat(turned, quat, model.site_quat[one.sites[end]])
            quat = turned
        found.append(quat)
    return found[0], found[1]


def _relative(model: mujoco.MjModel, one: Equality) -> np.ndarray:
    return np.array([1.0, 0.0, 0.0, 0.0]) if one.sites is not None else model.eq_data[one.index, 6:10].copy()


def _wanted(model: mujoco.MjModel, data: mujoco.MjData, one: Equality) -> np.ndarray:
    """How a weld wants its second side turned, by its first."""
    wanted = np.zeros(4)
    mujoco.mju_mulQuat(wanted, _orientations(model, data, one)[0], _relative(model, one))
    return wanted


def _conjugate(quat: np.ndarray) -> np.ndarray:
    found = np.zeros(4)
    mujoco.mju_negQuat(found, quat)
    return found


def _met(
    model: mujoco.MjModel, data: mujoco.MjData, one: Equality, end: int, *, turned: bool
) -> tuple[np.ndarray, np.ndarray]:
    """The pose of a mocap body that meets what is joined to it, where that stands."""
    body = one.bodies[end]
    quat = data.xquat[body].copy()
    if one.kind.turns:
        first, second = _orientations(model, data, one)
        change = np.zeros(4)
        if end == 1:  # the second side is to be turned as the first one wants it
            mujoco.mju_mulQuat(change, _wanted(model, data, one), _conjugate(second))
        else:
            wanted = np.zeros(4)
            mujoco.mju_mulQuat(wanted, second, _conjugate(_relative(model, one)))
            mujoco.mju_mulQuat(change, wanted, _conjugate(first))
        new = np.zeros(4)
        mujoco.mju_mulQuat(new, change, quat)
        quat = new
    points = anchors(model, data, one)
    frame, turn = data.xmat[body].reshape(3, 3), np.zeros(9)
    mujoco.mju_quat2Mat(turn, quat)
    local = frame.T @ (points[end] - data.xpos[body])
    return points[1 - end] - turn.reshape(3, 3) @ local, quat


def _widest(recording: Recording, one: Equality, position: np.ndarray) -> Opening:
    """The widest gap of an equality in some rows (steps, rows) of all."""
    place = [other.index for other in recording.layout.equalities].index(one.index)
    rows = position[:, recording.layout.of_equality(place)]
    return opening(recording.model, one, rows[widest(recording.model, one, rows)])
