"""The start: whether it is consistent, and the nearest one that is."""

from oarlock.base.numbers import figure
from oarlock.base.text import quoted
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.lint.locked import lock, without
from oarlock.diagnosis.loops.gaps import Opening
from oarlock.diagnosis.loops.poses import ClosedPose
from oarlock.diagnosis.page.blocks import Chapter, Table
from oarlock.diagnosis.page.chapters.words import many, why_not
from oarlock.poses.chart import lengths
from oarlock.poses.nearest import Outside

ROUNDING = 1e-9
"""m or rad, and per s: a smaller opening is not worth a line on a terminal."""

LESS = 0.99
"""Of the way: what is shorter by more is worth a word."""

_SAID = {
    "consistent": "consistent. Every equality is closed, and so are their rates.",
    "closed": "not consistent, but a closed pose is near.",
    "locked": "locked. The loops close, but then nothing of a group can move.",
    "cannot-close": "not consistent. The loops cannot be closed.",
}


def start(exam: Examination) -> Chapter:
    """Whether the start is consistent, and the nearest one that is."""
    chapter, pose = Chapter("start", "The start", 2), exam.pose
    if pose is None:
        chapter.say(why_not(exam, "start"))
        return chapter
    said = f"From {exam.begins}: {_SAID[pose.status]}"
    if pose.closed and not pose.consistent:
        by = f", most of them {quoted(pose.moved_joint)}" if pose.moved_joint else ""
        said += f" Coordinates move by up to {figure(pose.moved)} rad or m{by}, velocities by up to "
        said += f"{figure(pose.moved_speed)} rad/s or m/s."
        said += _way(pose, bool(lengths(exam.model).any()))
    if pose.detour:
        said += " The pose given is a dead end: the closed one was found from disturbed starts around it."
    chapter.say(said)
    if pose.rested:
        chapter.say(f"The start rests beyond {_limits(pose.rested)}.")
    if pose.outside and pose.moved:
        chapter.say(f"Inside of all ranges nothing closes: the closed pose is beyond {_limits(pose.outside)}.")
    for culprits in pose.culprits:
        chapter.say(f"What stands in the way: {culprits}.")
    for one in pose.mobility:
        if one.locked:
            why = without(one.equalities, one.frees, lock(exam.model, pose, one) == "note")
            chapter.say(f"Locked: {'; '.join([many(one.equalities), *why])}.")
        elif one.singular:
            chapter.say(f"Singular at the start: {many(one.equalities)}, dof {one.dof} there and {one.near} around it.")
    for tilt in pose.tilts:
        chapter.say(
            f"The axis of '{tilt.joint}' is {figure(tilt.radians, 'rad')} off the others' in the loop of "
            f"{quoted(tilt.equality)}."
        )
    openings = list(zip(pose.openings, pose.speeds, pose.left, strict=True))
    columns = ("equality", "open (m)", "open (rad)", "opens at (m/s)", "opens at (rad/s)")
    columns = (*columns, "left open (m)", "left open (rad)")
    rows = [(given.equality, *_opened(given), *_opened(speed), *_opened(left)) for given, speed, left in openings]
    told = [max(one.largest for one in three) > ROUNDING for three in openings]
    short = Table("start", columns, [row for row, worth in zip(rows, told, strict=True) if worth])
    chapter.table("start", columns, rows, short=short if any(told) else None)
    return chapter


def _way(pose: ClosedPose, slides: bool) -> str:
    """How far the closed pose is in all, and what was held."""
    if not pose.moved:
        return ""
    said = f" It is the nearest{'' if pose.outside else ' inside of all ranges'}, {figure(pose.norm, 'rad')} away"
    said += " (root of the sum of squares"
    said += f", {figure(pose.arm, 'm')} counted as a radian)" if slides else ")"
    if pose.held:
        said += f", with {many(map(repr, pose.held))} held"
        if pose.norm_free < LESS * pose.norm:
            said += f"; with nothing held {figure(pose.norm_free, 'rad')} suffice (--hold none)"
    if pose.released:
        said += f"; {many(map(repr, pose.released))} had to be let go, for then nothing closes"
    return f"{said}."


def _limits(beyond: tuple[Outside, ...]) -> str:
    return many(f"the {one.limit} by {figure(one.by)} rad or m" for one in beyond)


def _opened(opening: Opening) -> tuple[str, str]:
    return figure(opening.metres), figure(opening.radians)
