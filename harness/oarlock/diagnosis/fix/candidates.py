"""What might help a model, by what was found out about it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.text import quoted
from oarlock.diagnosis.edit.changes import Armature, Change, Constants, Exclusion, Keyframe, Switched, numbers
from oarlock.diagnosis.edit.keyframe import new_name, source_key
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.fix.bench import Bench
from oarlock.diagnosis.lint.collision import Collision
from oarlock.diagnosis.lint.locked import lock
from oarlock.diagnosis.loops.poses import ClosedPose
from oarlock.diagnosis.runs.parted import Parted
from oarlock.diagnosis.runs.trials import Trial
from oarlock.diagnosis.verdict.references import exchanged
from oarlock.mechanics import controls
from oarlock.mechanics.names import Equality, element_name, equalities
from oarlock.stepping.closing import CONSISTENT

_JOINT = mujoco.mjtObj.mjOBJ_JOINT

UNMET = "no pose near the start meets it as it is written, inside of all ranges"
"""What speaks for other constants than those that are written."""

NAMED = 2.0
"""Times the drift without it: with what a finding names a run may open so much further, as a start in another pose does
by its softness; beyond that it is not what was meant."""


@dataclass(frozen=True)
class Offset:
    """Constants with which an equality holds at the start.

    Attributes:
        equality: whose they are.
        given: those that are there.
        change: the new ones.
        why: what speaks for them, in words; empty where nothing that is written does.
    """

    equality: Equality
    given: tuple[float, ...]
    change: Constants
    why: str

    def __str__(self) -> str:
        new, old = (numbers(np.array(values)) for values in (self.change.values, self.given))
        return f'{self.change.attribute} "{new}" of {quoted(self.equality.name)} in place of "{old}"'


def exclusions(exam: Examination) -> Iterator[tuple[Exclusion, Collision]]:
    """Of bodies that collide where an equality joins them, each pair once."""
    known: set[tuple[int, int]] = set()
    for one in exam.collisions:
        if one.bodies not in known:
            known.add(one.bodies)
            yield Exclusion(*one.bodies), one


def freeing(exam: Examination) -> Iterator[tuple[Exclusion, str]]:
    """Of bodies that overlap at the start and hold a servo, with what a run without their contacts showed."""
    for one in exam.stuck:
        late = one.late[0]
        for each in one.exclusions:
            said = f"whose contact holds {quoted(late.servo.name)} at {late.reached:.3g} {late.unit}"
            said += f" of {late.told:.3g}, {one.without:.3g} without it"
            yield Exclusion(each.bodies[0], each.bodies[1]), said


def switched(exam: Examination) -> Iterator[tuple[Switched, Parted]]:
    """Equalities that are switched off, whose sides part, and which hold where they are on."""
    for one in exam.parted:
        if one.held is not None and one.held.largest < one.opening.largest:
            own = [other for other in equalities(exam.model) if other.name == one.equality]
            yield Switched(own[0].index), one


def armatures(exam: Examination) -> Iterator[tuple[Armature, str]]:
    """What drives lack by what findings name, with the reason: of servos that shake, and of soft couplings."""
    model = exam.model
    for remark in exam.remarks.get("servo", []):
        value = remark.figures.get("armature")
        if value and remark.severity != "note":
            actuator = controls.actuators(model).index(remark.element)
            joint = int(model.actuator_trnid[actuator, 0])
            total = float(f"{value + model.dof_armature[model.jnt_dofadr[joint]]:.2g}")
            yield Armature((joint,), total), f"which servo {quoted(remark.element)} is too stiff for"
    if exam.rotors is not None:
        names = [element_name(model, _JOINT, joint) for joint in range(model.njnt)]
        joints = tuple(names.index(name) for name in exam.rotors.joints)
        yield Armature(joints, exam.rotors.armature), "whose single inertia makes their couplings soft"


def closed_keyframe(bench: Bench, changes: Sequence[Change] = ()) -> Keyframe | None:
    """The nearest closed pose in the keyframe that the start came from, or in a new one where it came from none.

    It is closed with the constants among changes. None where the file starts closed, or there is no such pose.
    """
    exam, base = bench.exam, bench.base
    pose = bench.pose(changes)
    if pose is None or not pose.closed:
        return None
    elsewhere = exam is not base and not (np.array_equal(exam.qpos, base.qpos) and np.array_equal(exam.qvel, base.qvel))
    if (pose.consistent and not elsewhere) or _drawn_apart(exam, pose) or _pushed(exam, pose) or any(exchanged(exam)):
        return None
    key = source_key(base.model, base.options.keyframe)
    if key is not None:
        return Keyframe(pose.qpos, pose.qvel, key=key)
    return Keyframe(pose.qpos, pose.qvel, name=new_name(base.model), ctrl=_held(base.model, exam.laws))


def _drawn_apart(exam: Examination, pose: ClosedPose) -> bool:
    """Whether all that stands open joins a point in the air (S5): closed, it would hold what nobody drew."""
    apart = {remark.element for remark in exam.remarks.get("drawn", [])}
    open_ = {one.equality for one in pose.openings if one.largest > CONSISTENT}
    return bool(open_) and open_ <= apart


def _pushed(exam: Examination, pose: ClosedPose) -> bool:
    """Whether a start is closed, and all that opens at it is a push on a structure, which shows its softness."""
    if max((one.largest for one in pose.openings), default=0.0) > CONSISTENT:
        return False
    rigid = {name for one in pose.mobility if one.locked and lock(exam.model, pose, one) for name in one.equalities}
    return bool(rigid) and {one.equality for one in pose.speeds if one.largest > CONSISTENT} <= rigid


def closes_inside(bench: Bench, taken: Sequence[Constants], change: Constants) -> bool:
    """Whether the start closes, or closes inside of more ranges, with a change beside those that are taken alone."""
    without = bench.pose(taken)
    left = None if without is None or not without.closed else _left(without)
    if left is not None and not left:
        return False
    with_it = bench.pose([*taken, change])
    if with_it is None or not with_it.closed:
        return False
    return left is None or _left(with_it) < left


def _left(pose: ClosedPose) -> set[str]:
    """The ranges of joints and tendons that a pose leaves."""
    return {one.limit for one in pose.outside if one.by > CONSISTENT}


def run_closed(bench: Bench, constants: Sequence[Constants]) -> Trial:
    """A run with some constants from the closed pose nearest to the start."""
    pose = closed_keyframe(bench, constants)
    return bench.run([*constants, pose] if pose is not None else constants)


def _held(model: mujoco.MjModel, laws: dict[str, str]) -> np.ndarray | None:
    """Constant controls (nu), for a new keyframe to hold; None where one is no constant, or all are 0."""
    held = np.zeros(model.nu)
    for name, law in laws.items():
        actuator = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name)
        try:
            held[actuator if actuator >= 0 else int(name.removeprefix("#"))] = float(law)
        except ValueError:
            return None
    return held if held.any() else None
