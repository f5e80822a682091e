"""From servos that something holds to findings: what is wrong although the loops hold."""

from collections.abc import Iterator
from dataclasses import asdict

import mujoco
import numpy as np

from oarlock.base.errors import few
from oarlock.base.text import called, quoted
from oarlock.diagnosis.examination import starved
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.loops.gaps import gaps
from oarlock.diagnosis.runs.obstacles import Obstacle
from oarlock.diagnosis.runs.stuck import Late, Stuck
from oarlock.diagnosis.runs.undriven import Spring, Undriven
from oarlock.diagnosis.verdict.blame import beyond_repair, in_words, position
from oarlock.diagnosis.verdict.cost import TORN, metres
from oarlock.diagnosis.verdict.findings import Finding, Severity, found
from oarlock.mechanics.load import takes_degrees
from oarlock.mechanics.names import element_name

MOST_COORDINATES = 10
"""Of a pose that is written out."""

HALF = 0.5
"""Of a way: with less of it left without gravity, it is the weight that does it."""

PARTS = 4
"""Of the run; in the last of them what opens a loop has to last."""

SMALL = 0.1
"""Of what a servo is short of: with loops that open further it is they that are in question."""


def stuck(exam: Examination) -> Iterator[Finding]:
    """A6: servos that stand short of where they are told to be."""
    if not exam.stuck or exam.pose is None:
        return
    locked = {name for one in exam.pose.mobility if one.locked for name in one.equalities}
    wrong = beyond_repair(exam) | locked
    wrong |= {name for one in exam.remarks.get("locked", []) for name in (one.element, *one.figures.get("also", ()))}
    odd = {name for one in exam.remarks.get("unit", []) for name in (one.element, *one.figures.get("also", ()))}
    for one in exam.stuck:
        names = exam.pose.loops.groups[one.group].equalities
        if wrong.isdisjoint(names) and one.late[0].servo.name not in odd and not _torn(exam, one, names):
            yield _finding(exam, one, names)


def _finding(exam: Examination, one: Stuck, equalities: tuple[str, ...]) -> Finding:
    first = one.late[0]
    effort = "N m" if first.unit == "rad" else "N"
    said = f"is told {_at(first.told, first)} and leaves {called(_sort(first), first.element)} at "
    said += f"{_at(first.reached, first)} with {abs(first.force):.3g} {effort}"
    said += ", all that it may give" if first.full else ""
    if one.obstacles:
        said += f": {few([_described(each) for each in one.obstacles], last='and')} "
        said += f"{'hold' if one.obstacles[1:] else 'holds'} it, and without that it comes to {_at(one.without, first)}"
    elif one.needed is not None:
        said += f": the weight of what it moves holds it, and with {abs(one.needed):.3g} {effort} it would bear that"
    said += _remedy(exam, one, first)
    if one.late[1:]:
        said += f"; the same of {in_words([late.servo.name for late in one.late[1:]])}"
    figures = {
        "also": [late.servo.name for late in one.late[1:]],
        "loops": list(equalities),
        "told": first.told,
        "reached": first.reached,
        "short": first.short,
        "unit": first.unit,
        "force": first.force,
        "full": first.full,
        "by": [each.name for each in one.obstacles],
        "without": one.without,
        "needed": one.needed,
        "exclude": [_names(exam, each) for each in one.exclusions],
        "radians": one.radians,
    }
    severity = _severity(one)
    return found("A6", exam.file, said, element=first.servo.name, severity=severity, **figures)


def _torn(exam: Examination, one: Stuck, equalities: tuple[str, ...]) -> bool:
    """Whether the loops stand open so far, when a jump at the start has faded, that it is they that are in question."""
    opened = max((_lasting(exam, name) for name in equalities), default=0.0)
    first = one.late[0]
    return opened > SMALL * first.short * (exam.size if first.unit == "rad" else 1.0)


def _lasting(exam: Examination, name: str) -> float:
    """The median gap of an equality over the last part of the run, m, of an angle times the size of the loops."""
    recording = exam.recording
    if recording is None:
        return 0.0
    names = [one.name for one in recording.layout.equalities]
    if name not in names:
        return 0.0
    place = names.index(name)
    rows = recording.position[-max(1, recording.steps // PARTS) :, recording.layout.of_equality(place)]
    every = gaps(recording.model, recording.layout.equalities[place], rows)
    sizes = {unit: float(np.median(values)) for unit, values in every.items()}
    return metres(exam, sizes.get("m"), sizes.get("rad"))


def _severity(one: Stuck) -> Severity | None:
    if one.radians is not None:
        return "error"
    if one.obstacles and one.meant:
        return "note"
    return "error" if one.exclusions else None


def _remedy(exam: Examination, one: Stuck, first: Late) -> str:
    if one.radians is not None:
        said = "the ranges look like radians that are taken for degrees"
        return f'; {said}: with angle="radian" in <compiler> it comes to {_at(one.radians, first)}'
    pairs = [_names(exam, each) for each in one.exclusions]
    written = [f'<exclude body1="{names[0]}" body2="{names[1]}"/>' for names in pairs]
    return f": {few(written)}" if written else ""


def _names(exam: Examination, one: Obstacle) -> list[str]:
    return [element_name(exam.model, mujoco.mjtObj.mjOBJ_BODY, body) for body in one.bodies]


def _sort(one: Late) -> str:
    return "joint" if one.servo.joint >= 0 else "tendon"


def _at(value: float, one: Late) -> str:
    return f"{value + 0.0:.3g} {one.unit}"


def _described(one: Obstacle) -> str:
    """An obstacle with its figures."""
    if one.bodies:
        deep = f", {one.depth:.2g} m deep at the start" if one.depth else ""
        return f"the {one.name} ({one.force:.3g} N{deep})"
    low, high = one.range
    over = f", overrun by {one.by:.2g}" if one.by else ""
    return f"the {one.name} ({low:.4g} to {high:.4g} {one.unit}{over}; {one.force:.3g} {one.force_unit})"


def targets(exam: Examination) -> Iterator[Finding]:
    """S8: mocap targets that a mechanism does not follow."""
    for one in exam.targets:
        at = "" if one.time_s is None else f" at t = {one.time_s:.4g} s"
        if one.speed:
            said = (
                f"mocap body {quoted(one.body)} moves at {one.speed:.3g} m/s{at}, faster than the rows follow: "
                f"{quoted(one.held)} is {one.short} behind"
            )
            if one.left is not None:
                said += f'; with solref="{one.solref}" solimp="0.9999 0.9999 0.001" it stays within {one.left}'
            else:
                said += "; move it more slowly"
        else:
            what = "place can be reached, its orientation cannot" if one.turned else "pose is out of reach"
            by = f"{quoted(one.held)} is {'turned' if one.turned else 'short'} by {one.short} where it is nearest"
            pose = f'pos="{_numbers(one.pos)}" quat="{_numbers(one.quat)}"'
            said = f"mocap body {quoted(one.body)}: its {what}{at}: {by}; with {pose} it is met"
            if one.left is not None:
                said += f", within {one.left} at the end of the run"
            if one.turned:
                said += ", and a <connect> in place of the weld holds the place alone"
        figures = {
            "body": one.body,
            "gap": one.short.largest,
            "pos": one.pos.tolist(),
            "quat": one.quat.tolist(),
            "left": None if one.left is None else one.left.largest,
            "speed": one.speed,
            "time_s": one.time_s,
        }
        severity: Severity | None = "warning" if one.speed else None
        yield found("S8", exam.file, said, element=one.equality, severity=severity, **figures)


def missed(exam: Examination) -> Iterator[Finding]:
    """A9: servos that do not come to where they are told, by what is in the way or too weak."""
    if exam.pose is None or exam.dead_point is not None:
        return
    loose = {name for one in exam.undriven for name in (one.equality, *one.others)}
    every = [one for remarks in exam.remarks.values() for one in remarks if one.severity != "note" and one.code != "A1"]
    odd = {name for one in every for name in (one.element, *one.figures.get("also", ()), *one.figures.get("loops", ()))}
    for one in exam.missed:
        names = exam.pose.loops.groups[one.group].equalities
        if not (beyond_repair(exam) | odd).isdisjoint((*names, one.servo.name)):
            continue
        if one.suspect is None and (one.kp is None or not loose.isdisjoint(names)):
            continue  # what swings by itself takes it along (A8)
        effort = "N" if one.unit == "m" else "N m"
        said = f"is told {one.told + 0.0:.3g} {one.unit} and {quoted(one.joint)} comes to {one.reached + 0.0:.3g} "
        said += one.unit
        said += f" with all of its {one.full:.3g} {effort}" if one.full is not None else f" with kp {one.given:g}"
        if one.suspect is not None:
            tried = "without that" if one.suspect.tried == "without it" else one.suspect.tried
            said += f": {one.suspect.said} holds it, and {tried} it comes to {one.without or 0.0:.3g} {one.unit}"
        if one.kp is not None:
            wide = "a wider forcerange" if one.full is not None else ""
            more = f"kp {one.kp:.3g}" if one.kp > one.given else ""
            said += f"; {' and '.join(filter(None, (wide, more)))} brings it to {one.stronger or 0.0:.3g} {one.unit}"
        figures = {
            "loops": list(names),
            "told": one.told,
            "reached": one.reached,
            "short": abs(one.told - one.reached),
            "unit": one.unit,
            "by": one.suspect.said if one.suspect is not None else None,
            "without": one.without,
            "kp": one.kp,
        }
        yield found("A9", exam.file, said, element=one.servo.name, **figures)


def throttled(exam: Examination) -> Iterator[Finding]:
    """A9: of joints whose actuatorfrcrange cuts what drives them."""
    for one in exam.throttled:
        low, high = one.range
        effort = "N" if one.unit == "m" else "N m"
        bound = high if one.asked > 0.0 else low
        said = (
            f"asks for {abs(one.asked):.4g} {effort} of {quoted(one.joint)}, and {abs(bound):.4g} {effort} arrive, for "
            f'the actuatorfrcrange="{low:g} {high:g}" of that joint cuts it: '
        )
        if one.servo:
            said += (
                f"without it {quoted(one.joint)} is {one.without:.2g} {one.unit} off as a mean in place of "
                f"{one.misses:.2g} {one.unit}"
            )
        else:
            said += f"without it {quoted(one.joint)} gets up to {one.without:.2g} {one.unit} away from where it goes"
        names = exam.pose.loops.groups[one.group].equalities if exam.pose is not None else ()
        figures = {
            "loops": list(names),
            "joint": one.joint,
            "asked": one.asked,
            "given": bound,
            "short": one.misses if one.servo else one.without,
            "without": one.without,
            "unit": one.unit,
        }
        yield found("A9", exam.file, said, element=one.actuator, **figures)


def slips(exam: Examination) -> Iterator[Finding]:
    """C6: objects that a gripper lets go."""
    for one in exam.slips:
        said = (
            f"{in_words(list(one.holders))} hold it and lose it at t = {one.time_s:.4g} s: it goes {one.way:.2g} m away"
        )
        said += f"; {one.cure} keeps it within {one.left:.2g} m" if one.cure else ""
        figures = {"loops": list(one.equalities), "way": one.way, "time_s": one.time_s, "left": one.left}
        severity: Severity | None = None if one.cure else "note"  # it may be told to open
        yield found("C6", exam.file, said, element=one.body, severity=severity, **figures)


def clipped(exam: Examination) -> Iterator[Finding]:
    """A10: controls that MuJoCo cuts to the range of their actuator."""
    for one in exam.clipped:
        low, high = one.range
        said = f'is given ctrl {one.asked:g}, and its ctrlrange="{low:g} {high:g}" cuts that to {one.used:g}'
        said += f", {one.short:.3g} {one.unit} short" if one.unit else ""
        said += f': write ctrlrange="{min(low, one.asked):g} {max(high, one.asked):g}", or ctrl within it'
        groups = exam.pose.loops.groups if exam.pose is not None else ()
        figures = {
            "asked": one.asked,
            "used": one.used,
            "short": one.short,
            "unit": one.unit,
            "loops": [name for number in one.loops for name in groups[number].equalities],
        }
        severity: Severity | None = None if one.loops else "note"
        yield found("A10", exam.file, said, element=one.actuator, severity=severity, **figures)


def leverless(exam: Examination) -> Iterator[Finding]:
    """A11: actuators that have no lever on their loops at the start."""
    for one in exam.leverless:
        unit = "m" if one.slides else "rad"
        pushes = f"{in_words(list(one.actuators))} {'push' if one.actuators[1:] else 'pushes'}"
        qpos = " ".join(f"{value + 0.0:.6g}" for value in one.qpos)
        has = "have" if one.actuators[1:] else "has"
        said = (
            f"{pushes} with up to {one.force:.3g} {one.effort} and {has} no lever on its loop at the start: the links "
            f"are in a dead point there, and no force moves {quoted(one.joint)}; "
        )
        if len(one.qpos) <= MOST_COORDINATES:
            said += f'from qpos="{qpos}", which is closed beside it, '
        else:
            said += "from a closed pose 5 degrees beside it "
        said += f"it goes {one.way:.3g} {unit} in the same run; or give it a velocity, or a force on that joint"
        figures = {
            "also": list(one.equalities[1:]),
            "actuators": list(one.actuators),
            "joint": one.joint,
            "way": one.way,
            "unit": unit,
            "qpos": one.qpos.tolist(),
        }
        yield found("A11", exam.file, said, element=one.equalities[0], **figures)


def undriven(exam: Examination) -> Iterator[Finding]:
    """A8: loops with more freedom than drives, that goes its own way."""
    for one in exam.undriven:
        names = (one.equality, *one.others)
        if not (beyond_repair(exam) | starved(exam)).isdisjoint(names):
            continue
        said = _loose(one) + _kept(exam, one)
        figures = {
            "also": list(one.others),
            "dof": one.dof,
            "driven": one.driven,
            "joints": [name for name, *_ in one.joints],
            "way": one.way,
            "falls": one.falls,
            "left": one.left,
            "turning": one.turning or None,
            "springs": [asdict(spring) for spring in one.springs],
            "couplings": [coupling.written for coupling in one.couplings],
        }
        # How what is torn moves is no linkage's motion.
        torn = max((_opened(exam, name) for name in names), default=0.0) > TORN * exam.size
        yield found("A8", exam.file, said, element=one.equality, severity="note" if torn else None, **figures)


def _opened(exam: Examination, name: str) -> float:
    """What an equality opens by at most, m, of an angle times the size of the loops."""
    own = position(exam, name)
    return 0.0 if own is None else metres(exam, own.metres, own.radians)


def _loose(one: Undriven) -> str:
    """Which freedom nothing drives, and where it goes."""
    loose = one.dof - one.driven
    ways = [f"{quoted(name)} by {way:.2g} {unit}" for name, way, unit in one.joints]
    weight = ", by its weight" if one.falls > HALF else ""
    freedom = f"{one.dof} degree{'s' if one.dof > 1 else ''} of freedom"
    others = f"{'those' if one.others[1:] else 'that'} of {in_words(list(one.others))}" if one.others else ""
    whose = f"its loop and {others} have" if one.together else "its loop has"
    if one.driven:
        drives = f"{in_words(list(one.actuators))} {'drive' if one.actuators[1:] else 'drives'} {one.driven} of them"
        drives += f", what {in_words(list(one.together))} do together" if one.together else ""
        other = f"the other {f'{loose} go their' if loose > 1 else 'goes its'} own way"
    else:
        drives, other = "no actuator drives it", "it goes its own way"
    ways = f", {few(ways, last='and')} in all," if ways else ""
    if one.turning:
        ways = f", turn {quoted(one.turning)} by {one.turned:.2g} rad in all"
    take = "take" if one.driven and loose > 1 else "takes"
    return f"{whose} {freedom} and {drives}: {other}{ways} and {take} {quoted(one.body)} {one.way:.2g} m{weight}; "


def _kept(exam: Examination, one: Undriven) -> str:
    """What would keep it."""
    loose = one.dof - one.driven
    if one.couplings:
        written = few([coupling.written for coupling in one.couplings], last="and")
        return f"with {written} in <equality> it goes {one.left:.2g} m"
    joints = [quoted(spring.joint) for spring in one.springs] or [quoted(name) for name, *_ in one.joints]
    said = "drive, or couple, "
    if one.springs:
        with_them = few([_spring(exam, spring) for spring in one.springs], last="and")
        said = f"with {with_them} it goes {one.left:.2g} m; or {said}"
    if joints:
        return f"{said}{'one of ' if not one.springs and joints[loose:] else ''}{few(joints, last='and')}"
    if one.unturned is not None:
        return (
            f"hold the rotation of {quoted(one.turning)}: slides in place of its freejoint, or a second rod beside "
            f"each; when it does not turn, {quoted(one.body)} goes {one.unturned:.2g} m"
        )
    return f"{said}what its ball and free joints leave free"


def _spring(exam: Examination, one: Spring) -> str:
    said = f'stiffness="{one.stiffness:g}" damping="{one.damping:g}"'
    if one.reference:
        degrees = not one.slides and takes_degrees(exam.path)
        said += f' springref="{np.degrees(one.reference) if degrees else one.reference:.4g}"'
    return f"{said} on joint {quoted(one.joint)}"


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{0.0 if abs(value) < 5e-7 else value:.6g}" for value in values.tolist())
