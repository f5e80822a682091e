"""From servos that something holds to findings: what is wrong although the loops hold."""

from collections.abc import Iterator

import mujoco

from oarlock.base.errors import few
from oarlock.base.text import called
from oarlock.diagnosis.examination import Examination
from oarlock.diagnosis.runs.obstacles import Obstacle
from oarlock.diagnosis.runs.stuck import Late, Stuck
from oarlock.diagnosis.verdict.blame import beyond_repair, in_words, position
from oarlock.diagnosis.verdict.cost import metres
from oarlock.diagnosis.verdict.findings import Finding, Severity, found
from oarlock.mechanics.names import element_name

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
    """Whether the loops open so far that it is they that are in question."""
    opened = max(
        (metres(exam, drift.metres, drift.radians) for name in equalities if (drift := position(exam, name))),
        default=0.0,
    )
    first = one.late[0]
    return opened > SMALL * first.short * (exam.size if first.unit == "rad" else 1.0)


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
