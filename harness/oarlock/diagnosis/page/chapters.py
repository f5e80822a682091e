"""What was measured, in words and tables: the loops, the start, the drift."""

from collections.abc import Iterable

import numpy as np

from oarlock.base.errors import few
from oarlock.base.numbers import figure
from oarlock.diagnosis.examination import Examination
from oarlock.diagnosis.loops.gaps import Opening
from oarlock.diagnosis.loops.loops import Group, Loop, Loops
from oarlock.diagnosis.page.blocks import Chapter
from oarlock.diagnosis.runs.drifts import LEVELS
from oarlock.mechanics.names import equalities

UNITS = {"position": ("m", "rad"), "velocity": ("m/s", "rad/s"), "acceleration": ("m/s²", "rad/s²")}

DEPENDENCIES = 20
"""So many dependencies between rows are written out at most."""


def why_not(found: Examination, part: str) -> str:
    """The reason why a part of an examination is not there."""
    reason = found.missing.get(part)
    return f"Not known: {reason}." if reason else "Not looked at."


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def many(names: Iterable[str]) -> str:
    """Names for a sentence or a cell."""
    return few(list(names)) or "–"


def counted(count: int, noun: str) -> str:
    """A number of things."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def head(found: Examination) -> str:
    """What was run, in a sentence or two."""
    model = found.model
    active = int(np.count_nonzero(model.eq_active0))
    told = "1 equality" if model.neq == 1 else f"{model.neq} equalities"
    off = model.neq - active
    without = "it" if model.neq == 1 else "them"
    text = (
        f"{told}{f' ({off} switched off)' if off else ''}, {counted(model.nv, 'degree')} of freedom without {without}. "
    )
    integrator = found.recording.integrator if found.recording else ""
    text += f"The run: {found.duration_s:g} s in {found.steps} steps of {found.timestep_s:g} s"
    text += f", integrator {integrator}" if integrator else ""
    text += f", from {found.begins}; {found.driven}."
    return f"{text} Left out: {found.ignored}." if found.ignored else text


# 1


def loops(found: Examination) -> Chapter:
    """The equalities, their groups, and how the rank changes."""
    chapter = Chapter("loops", "The loops")
    if found.pose is None:
        chapter.say(why_not(found, "loops"))
        return chapter
    at = found.pose.loops
    where = "At the nearest closed pose" if at.closed else "The loops do not close; at the best pose that was found"
    chapter.say(
        f"{where}: {counted(at.rows, 'row')}, rank {at.rank}, {counted(at.redundancy, 'redundant row')}, "
        f"{counted(at.dof, 'degree')} of freedom left."
    )
    verdicts = {one.names[0]: one.verdict for one in found.reactions.equalities} if found.reactions else {}
    removable = found.history.removable if found.history else {}
    columns = ("equality", "type", "between", "rows", "shape", "group", "zero rows", "repeated rows", "may be left out")
    rows = [_loop_row(at, loop, removable.get(loop.name, loop.removable), verdicts.get(loop.name)) for loop in at.loops]
    chapter.table("loops", (*columns, "its reaction"), rows)
    off = [one.name for one in equalities(found.model) if not found.model.eq_active0[one.index]]
    if off:
        chapter.say(f"Switched off at the start, and not looked at: {many(off)}.")
    chapter.say("Groups share no degrees of freedom; their ranks add up.")
    chapter.table(
        "groups",
        ("group", "equalities", "joints", "rows", "zero", "rank", "redundancy", "dof", "shape", "redundancy by cause"),
        [_group_row(found, index, group) for index, group in enumerate(at.groups)],
    )
    dependent = [one for group in at.groups for one in group.dependencies]
    if dependent:
        more = f", of which {DEPENDENCIES} are shown" if len(dependent) > DEPENDENCIES else ""
        chapter.say(f"Rows of which each follows from the others ({len(dependent)} such sets{more}):")
    chapter.table(
        "dependencies",
        ("equalities", "rows, each with its part"),
        [
            (many(one.equalities), ", ".join(f"{row} ({part:+.3g})" for row, part in one.rows))
            for one in dependent[:DEPENDENCIES]
        ],
    )
    _ranks(found, chapter)
    return chapter


def _loop_row(at: Loops, loop: Loop, removable: bool, verdict: str | None) -> tuple[str, ...]:
    doubled = [
        row.label or "its row"
        for one in at.groups[loop.group].dependencies
        if one.proportional
        for row, _ in one.rows
        if row.equality == loop.name
    ]
    return (
        loop.name,
        loop.equality.kind,
        " – ".join(loop.ends),
        str(loop.equality.rows),
        loop.path.shape,
        str(loop.group + 1),
        ", ".join(label or "its row" for label in loop.zero_rows) or "–",
        ", ".join(dict.fromkeys(doubled)) or "–",
        _yes(removable),
        verdict or "–",
    )


def _group_row(found: Examination, index: int, group: Group) -> tuple[str, ...]:
    cause = found.reactions.redundancy if found.reactions else ()
    counts = (group.rows, group.zero, group.rank, group.redundancy, group.dof)
    return (
        str(index + 1),
        many(group.equalities),
        many(group.joints),
        *map(str, counts),
        group.shape,
        str(cause[index]) if index < len(cause) else "–",
    )


def _ranks(found: Examination, chapter: Chapter) -> None:
    history = found.history
    if history is None:
        chapter.say(f"How the rank changes along the motion: {lower(why_not(found, 'rank'))}")
        return
    if not history.events:
        chapter.say(f"Along the motion the rank stays {history.rank}.")
        return
    chapter.say(f"Along the motion the rank is {history.rank}, except near singular poses:")
    chapter.table(
        "ranks",
        ("time (s)", "from (s)", "to (s)", "what", "rank", "ranks lost", "smallest singular value", "equalities"),
        [
            (
                figure(event.time_s),
                figure(event.start_s),
                figure(event.end_s),
                "singular" if event.kind == "singular" else "near singular",
                str(event.rank),
                str(event.lost),
                f"{figure(event.smallest)} of its median",
                many(event.equalities),
            )
            for event in history.events
        ],
    )


def lower(text: str) -> str:
    """A sentence after a colon."""
    return text[0].lower() + text[1:]


# 2


def start(found: Examination) -> Chapter:
    """Whether the start is consistent, and the nearest one that is."""
    chapter, pose = Chapter("start", "The start"), found.pose
    if pose is None:
        chapter.say(why_not(found, "start"))
        return chapter
    said = {
        "consistent": "The start is consistent: every equality is closed, and so are their rates.",
        "closed": "The start is not consistent, but a closed pose is near.",
        "locked": "The loops close, but the mechanism is locked there.",
        "cannot-close": "The loops cannot be closed.",
    }[pose.status]
    if pose.closed and not pose.consistent:
        by = f", most of them '{pose.moved_joint}'" if pose.moved_joint else ""
        said += f" Coordinates move by up to {figure(pose.moved)} rad or m{by}, velocities by up to "
        said += f"{figure(pose.moved_speed)} rad/s or m/s."
    if pose.detour:
        said += " The pose given is a dead end: the closed one was found from disturbed starts around it."
    chapter.say(said)
    for culprits in pose.culprits:
        chapter.say(f"What stands in the way: {culprits}.")
    for one in pose.mobility:
        if one.locked:
            chapter.say(f"Locked: {many(one.equalities)}; without one of {many(one.frees)} it could move.")
        elif one.singular:
            chapter.say(f"Singular at the start: {many(one.equalities)}, dof {one.dof} there and {one.near} around it.")
    for tilt in pose.tilts:
        chapter.say(
            f"The axis of '{tilt.joint}' is {figure(tilt.radians, 'rad')} off the others' in the loop of "
            f"'{tilt.equality}'."
        )
    chapter.table(
        "start",
        (
            "equality",
            "open (m)",
            "open (rad)",
            "opens at (m/s)",
            "opens at (rad/s)",
            "left open (m)",
            "left open (rad)",
        ),
        [
            (given.equality, *_opened(given), *_opened(speed), *_opened(left))
            for given, speed, left in zip(pose.openings, pose.speeds, pose.left, strict=True)
        ],
    )
    return chapter


def _opened(opening: Opening) -> tuple[str, str]:
    return figure(opening.metres), figure(opening.radians)


# 3


def drift(found: Examination) -> Chapter:
    """How far every equality opens in the run."""
    chapter = Chapter("drift", "Drift")
    if found.recording is None:
        chapter.say(why_not(found, "run"))
        return chapter
    positions = [one for one in found.drifts if one.level == "position"]
    if positions:
        worst = max(positions, key=lambda one: np.nan_to_num(one.largest))
        chapter.say(
            f"The worst: '{worst.equality}' opens by {_of(worst.metres, worst.radians)} at t = {worst.time_s:.6g} s."
        )
    if found.recording.end.how != "finished":
        end = found.recording.end
        chapter.say(f"MuJoCo's run ended at t = {end.time_s:.6g} s of {found.duration_s:g} s: {end.message}.")
    _exact(found, chapter)
    chapter.say(
        "Largest values of the run. Metres are the distance of the two points, radians the angle between the two "
        "orientations; of a coupling, its deviation."
    )
    rows = [
        (
            one.equality,
            one.level,
            _with(one.metres, UNITS[one.level][0]),
            _with(one.radians, UNITS[one.level][1]),
            _with(one.exact_metres, "m"),
            _with(one.exact_radians, "rad"),
            f"{one.time_s:.6g}",
        )
        for level in LEVELS
        for one in found.drifts
        if one.level == level
    ]
    columns = ("equality", "level", "MuJoCo", "MuJoCo, angle", "exact", "exact, angle", "worst at (s)")
    chapter.table("drift", columns, rows)
    return chapter


def _with(value: float | None, unit: str) -> str:
    return "–" if value is None else figure(value, unit)


def _of(metres: float | None, radians: float | None) -> str:
    parts = [figure(value, unit) for value, unit in ((metres, "m"), (radians, "rad")) if value is not None]
    return " and ".join(parts) or "nothing"


def _exact(found: Examination, chapter: Chapter) -> None:
    exact = found.exact
    if exact is None:
        chapter.say(f"The exact solution: {lower(why_not(found, 'exact'))}")
        return
    text = f"The exact solution steps with the integrator {exact.integrator}"
    text += f" ({exact.note})" if exact.note else ""
    if len(exact.drift):
        most = exact.drift.max(axis=0)
        text += (
            f" and leaves at most {figure(most[0])} m or rad, {figure(most[1])} per s and {figure(most[2])} per s² "
            "of any row"
        )
    if exact.end.how != "finished":
        text += f". It ends at t = {exact.end.time_s:.6g} s: {exact.end.message}"
    chapter.say(f"{text}.")
