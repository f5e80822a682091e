"""Servos that do not get where they are told although they stand still: what holds them, by the same run without it.

A limit, a contact or the weight of a load that a saturated servo cannot lift is in its way if the run without it takes
the servo most of the way that is left. Of several things in the way none is named without which the rest still holds.
"""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.loops import Loops
from oarlock.diagnosis.runs.obstacles import Obstacle, freed, obstacles
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.diagnosis.runs.walking import own_copy
from oarlock.diagnosis.runs.without import MOST, MOST_STEPS
from oarlock.mechanics.engine_version import tendon_dofs
from oarlock.mechanics.names import element_name
from oarlock.mechanics.newton import forward
from oarlock.mechanics.servos import Servo, servos, tendon_servos

FAR = 0.5
"""Of the commanded change: with less left, a servo went most of the way and is soft, or loaded."""

LEAST = 0.02
"""rad, or of the mechanism's size: of a smaller change no run is made."""

LAST = 0.1
"""Of the run, at its end: so long a servo has to be told the same, and to stand."""

STANDS = 0.01
"""Of the commanded change: who moves less in that time stands still."""

FULL = 0.99
"""Of the force that a servo may give: with more it is at its bound."""

SINGLE = 6
"""Obstacles at most of which each is tried whether it is needed."""

WRITTEN = math.radians(2.0 * math.pi)
"""rad. An angle that was written in radians, within a turn, and taken for degrees is smaller."""

_FOLLOWS = tuple(
    int(kind) for kind in (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
)
_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)


@dataclass(frozen=True)
class Late:
    """A servo that stands short of where it is told to be.

    Attributes:
        servo: it.
        element: the joint or tendon that it drives.
        start, told, reached: where that begins, is told to be and ends, in ``unit``.
        unit: rad or m.
        force: that it gives at the end, N or N m, before its gear.
        full: whether it may not give more.
    """

    servo: Servo
    element: str
    start: float
    told: float
    reached: float
    unit: str
    force: float
    full: bool

    @property
    def short(self) -> float:
        """How far it is from where it is told to be, in ``unit``."""
        return abs(self.told - self.reached)

    def arrives(self, there: float) -> bool:
        """Whether another end is so much nearer that what was taken away held it."""
        return abs(self.told - there) <= (1.0 - MOST) * self.short


@dataclass(frozen=True)
class Stuck:
    """Servos of a group of loops that something holds.

    Attributes:
        group: number of the group.
        late: the servos, the one that is furthest from its target first.
        obstacles: what holds them, that of the first servo's own joint first, then the strongest; empty: the weight
            of what they carry.
        without: where the first servo gets without it, in its unit.
        needed: force that it gives there without a bound on it, N or N m; None where no weight holds it.
        radians: where it gets with the ranges of hinges read in radians; None where that is not what was meant.
    """

    group: int
    late: tuple[Late, ...]
    obstacles: tuple[Obstacle, ...]
    without: float
    needed: float | None = None
    radians: float | None = None

    @property
    def meant(self) -> bool:
        """Whether it may be what a servo is for: it presses against another object, or the end of its own range."""
        own = {(one.servo.joint, one.servo.tendon): one for one in self.late}
        return any(one.outside for one in self.obstacles) or any(
            (late := own.get((one.joint, one.tendon))) is not None and one.stops(late.told) for one in self.obstacles
        )

    @property
    def exclusions(self) -> tuple[Obstacle, ...]:
        """The contacts, where nothing else holds it and all overlap at the start within the mechanism."""
        every = self.obstacles
        return every if all(one.bodies and one.depth > 0.0 and not one.outside for one in every) else ()


def find_stuck(
    recording: Recording, loops: Loops, size: float, in_degrees: Callable[[], bool] = lambda: False
) -> tuple[Stuck, ...]:
    """Looks at the end of a run for servos that stand short of what they are told, a group of loops each.

    Args:
        recording: MuJoCo's run as configured, to its end.
        loops: at the closed start.
        size: of the mechanism, m.
        in_degrees: whether the file gives its angles in degrees; asked only where ranges are in the way.
    """
    if recording.end.how != "finished" or recording.steps < 2:
        return ()
    late, found = list(_late(recording, size)), []
    end = _at(recording, recording.model, -1)
    for number in range(len(loops.groups)):
        dofs = set(loops.dofs(number))
        own = [one for one in late if not dofs.isdisjoint(_dofs(recording.model, one.servo))]
        if own:
            first = _at(recording, recording.model, 0)
            every = obstacles(recording.model, first, end, dofs)
            if (one := _held(recording, number, own, every, in_degrees)) is not None:
                found.append(one)
    return tuple(found)


def _dofs(model: mujoco.MjModel, servo: Servo) -> list[int]:
    return [int(model.jnt_dofadr[servo.joint])] if servo.joint >= 0 else tendon_dofs(model, servo.tendon)


def _at(recording: Recording, model: mujoco.MjModel, step: int) -> mujoco.MjData:
    """A state of a run with its forces; activations that follow controls have come to them."""
    data = recording.restart(model)
    data.qpos[:], data.qvel[:] = recording.qpos[step], recording.qvel[step]
    data.ctrl[:] = recording.ctrl[step]
    for index in np.flatnonzero(np.isin(model.actuator_dyntype, _FOLLOWS[1:])):
        data.act[model.actuator_actadr[index] + model.actuator_actnum[index] - 1] = data.ctrl[index]
    forward(model, data)
    return data


def _late(recording: Recording, size: float) -> Iterator[Late]:
    """The servos that stand short, whatever they drive."""
    model = recording.model
    data = mujoco.MjData(model)
    before = min(recording.steps - 2, int((1.0 - LAST) * recording.steps))
    for one in itertools.chain(servos(model), tendon_servos(model)):
        follows = int(model.actuator_dyntype[one.index]) in _FOLLOWS
        if not follows or np.ptp(recording.ctrl[before:, one.index]) or not recording.driven[one.index]:
            continue
        told = one.reached(one.told(model, float(recording.ctrl[-1, one.index])))
        start, then, reached = (_coordinate(model, data, one, recording.qpos[at]) for at in (0, before, -1))
        turns = one.joint >= 0 and model.jnt_type[one.joint] == _HINGE
        change = abs(told - start)
        stands = abs(reached - then) <= STANDS * change
        if change <= LEAST * (1.0 if turns else size) or not stands or abs(told - reached) <= FAR * change:
            continue
        force, full = _force(model, _at(recording, model, -1), one)
        sort = mujoco.mjtObj.mjOBJ_JOINT if one.joint >= 0 else mujoco.mjtObj.mjOBJ_TENDON
        element = element_name(model, sort, max(one.joint, one.tendon))
        yield Late(one, element, start, told, reached, "rad" if turns else "m", force, full)


def _coordinate(model: mujoco.MjModel, data: mujoco.MjData, servo: Servo, qpos: np.ndarray) -> float:
    if servo.joint >= 0:
        return float(qpos[model.jnt_qposadr[servo.joint]])
    data.qpos[:] = qpos
    mujoco.mj_fwdPosition(model, data)
    return float(data.ten_length[servo.tendon])


def _force(model: mujoco.MjModel, data: mujoco.MjData, servo: Servo) -> tuple[float, bool]:
    """What a servo gives at a state, and whether a bound on it or on its joint keeps it from giving more."""
    force = float(data.actuator_force[servo.index])
    low, high = model.actuator_forcerange[servo.index].tolist()
    full = bool(model.actuator_forcelimited[servo.index]) and (force >= FULL * high or force <= FULL * low)
    if servo.joint >= 0 and model.jnt_actfrclimited[servo.joint]:
        low, high = model.jnt_actfrcrange[servo.joint].tolist()
        passed = float(data.qfrc_actuator[model.jnt_dofadr[servo.joint]])
        full = full or passed >= FULL * high or passed <= FULL * low
    return force, full


# What holds them.


def _held(
    recording: Recording, number: int, late: list[Late], every: list[Obstacle], in_degrees: Callable[[], bool]
) -> Stuck | None:
    limits = [one for one in every if not one.bodies]
    inside = [one for one in every if one.bodies and not one.outside]
    outside = [one for one in every if one.outside]
    for chosen in (limits, inside, [*limits, *inside], outside, every):
        ends = _ends(recording, chosen) if chosen else None
        if ends is None or not _arriving(recording, late, ends):
            continue
        chosen = _needed(recording, chosen, late)
        ends = _ends(recording, chosen)
        assert ends is not None
        own = _arriving(recording, late, ends)
        servo = own[0].servo
        chosen = sorted(chosen, key=lambda one: ((one.joint, one.tendon) != (servo.joint, servo.tendon), -one.force))
        there = _there(recording, own[0], ends)
        radians = _in_radians(recording, chosen, own, in_degrees)
        return Stuck(number, tuple(own), tuple(chosen), there, radians=radians)
    return _loaded(recording, number, [one for one in late if one.full])


def _ends(recording: Recording, chosen: list[Obstacle]) -> np.ndarray | None:
    """The last pose (nq) of the same run without some obstacles; None where it does not last."""
    model = freed(recording.model, chosen)
    again = rerun(recording, model) if model is not None else None
    return None if again is None else again.qpos[-1]


def _there(recording: Recording, one: Late, ends: np.ndarray) -> float:
    return _coordinate(recording.model, mujoco.MjData(recording.model), one.servo, ends)


def _arriving(recording: Recording, late: list[Late], ends: np.ndarray) -> list[Late]:
    """The servos that a last pose takes most of the way that was left, the furthest from its target first."""
    own = [one for one in late if one.arrives(_there(recording, one, ends))]
    return sorted(own, key=lambda one: -one.short / max(abs(one.told - one.start), mujoco.mjMINVAL))


def _needed(recording: Recording, chosen: list[Obstacle], late: list[Late]) -> list[Obstacle]:
    """Those without which the rest does not free as many servos, the weakest tried first."""
    if not 1 < len(chosen) <= SINGLE or len(chosen) * recording.steps > MOST_STEPS:
        return chosen
    ends = _ends(recording, chosen)
    assert ends is not None
    most = len(_arriving(recording, late, ends))
    for one in sorted(chosen, key=lambda one: one.force):
        rest = [other for other in chosen if other is not one]
        ends = _ends(recording, rest) if rest else None
        if ends is not None and len(_arriving(recording, late, ends)) == most:
            chosen = rest
    return chosen


def _in_radians(
    recording: Recording, chosen: list[Obstacle], late: list[Late], in_degrees: Callable[[], bool]
) -> float | None:
    """Where a servo gets with ranges that were meant in radians; None where they were not, or that does not help."""
    model = recording.model
    small = [
        joint
        for joint in np.flatnonzero((model.jnt_type == _HINGE) & model.jnt_limited.astype(bool)).tolist()
        if 0.0 < np.abs(model.jnt_range[joint]).max() <= WRITTEN
    ]
    if any(one.joint not in small for one in chosen) or not in_degrees():
        return None
    model = own_copy(model)
    model.jnt_range[small] = np.degrees(model.jnt_range[small])
    again = rerun(recording, model)
    if again is None or len(_arriving(recording, late, again.qpos[-1])) < len(late):
        return None
    return _there(recording, late[0], again.qpos[-1])


def _loaded(recording: Recording, number: int, late: list[Late]) -> Stuck | None:
    """Servos at the bound of their force that the weight of what they carry holds."""
    if not late or not recording.model.opt.gravity.any():
        return None
    model = own_copy(recording.model)
    model.opt.gravity[:] = 0.0
    again = rerun(recording, model)
    own = _arriving(recording, late, again.qpos[-1]) if again is not None else []
    if again is None or not own:
        return None
    model = own_copy(recording.model)
    model.actuator_forcelimited[[one.servo.index for one in own]] = 0
    model.jnt_actfrclimited[[one.servo.joint for one in own if one.servo.joint >= 0]] = 0
    strong = rerun(recording, model)
    if strong is None or not _arriving(recording, own[:1], strong.qpos[-1]):
        return None
    one, there = own[0], _there(recording, own[0], strong.qpos[-1])
    needed = one.servo.stiffness * one.servo.gear * (one.told - there)
    return Stuck(number, tuple(own), (), _there(recording, one, again.qpos[-1]), needed=needed)
