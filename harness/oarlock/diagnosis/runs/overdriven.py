"""More servos on a loop than it has freedom, told poses that it cannot have together: they pull it apart."""

import itertools
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.gaps import gaps
from oarlock.diagnosis.loops.loops import Group, Loops
from oarlock.diagnosis.runs.drifts import Drift
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.diagnosis.runs.walking import own_copy
from oarlock.diagnosis.runs.without import MOST, left_about
from oarlock.mechanics.names import Equality, element_name, equalities
from oarlock.mechanics.servos import Servo, servos

CHOICES = 10
"""Of servos to keep: of more no run is made."""

PARTS = 4
"""Of a run; the last of them tells what stays open for good."""

_JOINT = mujoco.mjtObj.mjOBJ_JOINT


@dataclass(frozen=True)
class Overdriven:
    """Servos that fight one another through a loop.

    Attributes:
        equality: of the loop, that opens furthest; others: of the group that open too.
        servos: their names; told: where each is told to be at that moment, with the joint, in words.
        dof: degrees of freedom that the loops of the group leave.
        drift: how far the equality opens, m or rad; drift_without: the most about that moment with ``dof`` of the
            servos alone, whichever they are.
        unit: of the two.
        lasts: whether both are what stays for good, over the last part of the run.
        time_s: when the equality opens furthest; of what lasts, the end of the run.
        kept: what is left with the servos on joints that nothing leads, or on those that are told most; None where
            they do not come nearer to where they are told.
    """

    equality: str
    others: tuple[str, ...]
    servos: tuple[str, ...]
    told: tuple[str, ...]
    dof: int
    drift: float
    drift_without: float
    unit: str
    lasts: bool = False
    time_s: float = 0.0
    kept: "Kept | None" = None


@dataclass(frozen=True)
class Kept:
    """A run with as many servos as there is freedom.

    Attributes:
        servos: that are kept; others: that are not.
        joint: of the first of them; told, before, after: where it is told to be, and ends in both runs, rad or m.
        unit: of the three.
        controls: with which the others would ask for where their joints then are, by their names.
    """

    servos: tuple[str, ...]
    others: tuple[str, ...]
    joint: str
    told: float
    before: float
    after: float
    unit: str
    controls: tuple[tuple[str, float], ...]


def find_overdriven(recording: Recording, drifts: list[Drift], loops: Loops, least: float) -> tuple[Overdriven, ...]:
    """Makes the run again with as many servos of a group as it has freedom, for every choice of them.

    A load that opens a loop opens it with some of the choices too; what none of them opens is made by their number.

    Args:
        recording: MuJoCo's run as configured.
        drifts: of its equalities.
        loops: at the closed start.
        least: drifts below it are not worth a run, m or rad.
    """
    if recording.end.how != "finished":
        return ()
    worst = {one.equality: one for one in drifts if one.level == "position" and one.largest > least}
    found = []
    for group in loops.groups:
        drifting = sorted(
            (worst[name] for name in group.equalities if name in worst), key=lambda one: one.largest, reverse=True
        )
        own = [one for one in servos(recording.model) if _joint(recording, one) in group.joints]
        if not drifting or not 0 < group.dof < len(own):
            continue
        lasting = _lasting(recording, _place(recording, drifting[0]), recording.position)
        left = _left(recording, drifting[0], group, own)
        if left is not None and left[0] <= (1.0 - MOST) * drifting[0].largest:
            found.append(_overdriven(recording, drifting, group, own, left[0]))
        elif left is not None and lasting > least and left[1] <= (1.0 - MOST) * lasting:
            found.append(_overdriven(recording, drifting, group, own, left[1], lasting))
    return tuple(found)


def _joint(recording: Recording, one: Servo) -> str:
    return element_name(recording.model, _JOINT, one.joint)


def _lasting(recording: Recording, place: int, position: np.ndarray) -> float:
    """The median gap (m or rad) of an equality over the last part of a run, where a jump at the start has faded."""
    rows = position[-max(1, len(position) // PARTS) :, recording.layout.of_equality(place)]
    every = gaps(recording.model, recording.layout.equalities[place], rows)
    return max(float(np.median(sizes)) for sizes in every.values())


def _left(recording: Recording, drift: Drift, group: Group, own: list[Servo]) -> tuple[float, float] | None:
    """The most of a drift (m or rad) with any choice of its servos, about its moment and for good.

    None where a run does not last.
    """
    choices = list(itertools.combinations(own, group.dof))
    if len(choices) > CHOICES:
        return None
    place, most, lasts = _place(recording, drift), 0.0, 0.0
    for kept in choices:
        model = own_copy(recording.model)
        off = [one.index for one in own if one not in kept]
        model.actuator_gainprm[off], model.actuator_biasprm[off] = 0.0, 0.0
        again = rerun(recording, model)
        if again is None:
            return None
        most = max(most, left_about(recording, place, again.position).largest)
        lasts = max(lasts, _lasting(recording, place, again.position))
    return most, lasts


def _place(recording: Recording, drift: Drift) -> int:
    return [one.name for one in recording.layout.equalities].index(drift.equality)


def _kept(recording: Recording, group: Group, own: list[Servo]) -> Kept | None:
    model, start = recording.model, recording.qpos[0]
    places = {one.index: int(model.jnt_qposadr[one.joint]) for one in own}
    told = {one.index: one.reached(one.told(model, float(recording.ctrl[-1, one.index]))) for one in own}
    following = {int(model.eq_obj1id[one.index]) for one in equalities(model) if _leads(model, one, group)}
    ordered = sorted(own, key=lambda one: (one.joint in following, -abs(told[one.index] - start[places[one.index]])))
    keep, drop = ordered[: group.dof], ordered[group.dof :]
    freed = own_copy(model)
    off = [one.index for one in drop]
    freed.actuator_gainprm[off], freed.actuator_biasprm[off] = 0.0, 0.0
    again = rerun(recording, freed)
    if again is None:
        return None
    first = keep[0]
    before, after = (float(qpos[-1, places[first.index]]) for qpos in (recording.qpos, again.qpos))
    if abs(told[first.index] - after) > (1.0 - MOST) * abs(told[first.index] - before):
        return None
    return Kept(
        servos=tuple(one.name for one in keep),
        others=tuple(one.name for one in drop),
        joint=_joint(recording, first),
        told=told[first.index],
        before=before,
        after=after,
        unit="m" if model.jnt_type[first.joint] == mujoco.mjtJoint.mjJNT_SLIDE else "rad",
        controls=tuple((one.name, one.holding(float(again.qpos[-1, places[one.index]]))) for one in drop),
    )


def _leads(model: mujoco.MjModel, one: Equality, group: Group) -> bool:
    """Whether one joint of an equality of a group leads another."""
    return one.name in group.equalities and one.kind.holds == "joints" and model.eq_obj2id[one.index] >= 0


def _overdriven(
    recording: Recording,
    drifting: list[Drift],
    group: Group,
    own: list[Servo],
    left: float,
    lasting: float | None = None,
) -> Overdriven:
    model, worst = recording.model, drifting[0]
    step = recording.steps - 1 if lasting is not None else int(np.abs(recording.time - worst.time_s).argmin())
    told = []
    for one in own:
        unit = "m" if model.jnt_type[one.joint] == mujoco.mjtJoint.mjJNT_SLIDE else "rad"
        reached = one.reached(one.told(model, float(recording.ctrl[step, one.index])))
        told.append(f"{_joint(recording, one)} {reached + 0.0:.4g} {unit}")
    return Overdriven(
        equality=worst.equality,
        others=tuple(one.equality for one in drifting[1:]),
        servos=tuple(one.name for one in own),
        told=tuple(told),
        dof=group.dof,
        drift=worst.largest if lasting is None else lasting,
        drift_without=left,
        lasts=lasting is not None,
        time_s=float(recording.time[step]),
        kept=_kept(recording, group, own),
        unit="rad" if (worst.radians or 0.0) > (worst.metres or 0.0) else "m",
    )
