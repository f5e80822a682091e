"""The loops: which equalities close them, what is redundant, and how the rank changes along the motion."""

from oarlock.base.numbers import NOTHING, figure
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.loops.loops import Group, Loop, Loops
from oarlock.diagnosis.page.blocks import Chapter, Table
from oarlock.diagnosis.page.chapters.words import counted, lower, many, why_not, yes
from oarlock.mechanics.names import equalities

DEPENDENCIES = 20
"""So many dependencies between rows are written out at most."""


def loops(exam: Examination) -> Chapter:
    """The equalities, their groups, and how the rank changes."""
    chapter = Chapter("loops", "The loops", 1)
    if exam.pose is None:
        chapter.say(why_not(exam, "loops"))
        return chapter
    at = exam.pose.loops
    where = "At the nearest closed pose" if at.closed else "The loops do not close; at the best pose that was found"
    chapter.say(
        f"{where}, {counted(len(at.loops), 'equality', 'equalities')} in "
        f"{counted(len(at.groups), 'independent group')}: {counted(at.rows, 'row')}, rank {at.rank}, "
        f"{counted(at.redundancy, 'redundant row')}, {counted(at.dof, 'degree')} of freedom left of {at.nv}."
    )
    verdicts = {one.names[0]: one.verdict for one in exam.reactions.equalities} if exam.reactions else {}
    along = exam.history.removable if exam.history else {}
    columns = ("equality", "type", "between", "rows", "shape", "group", "zero rows", "repeated rows", "may be left out")
    rows = [_loop_row(at, loop, along.get(loop.name, loop.removable), verdicts.get(loop.name)) for loop in at.loops]
    chapter.table("loops", (*columns, "its reaction"), rows, short=_short(at))
    off = [one.name for one in equalities(exam.model) if not exam.model.eq_active0[one.index]]
    if off:
        chapter.say(f"Switched off at the start, and not looked at: {many(off)}.")
    chapter.explain("Groups share no degrees of freedom; their ranks add up.")
    chapter.table(
        "groups",
        ("group", "equalities", "joints", "rows", "zero", "rank", "redundancy", "dof", "shape", "redundancy by cause"),
        [_group_row(exam, index, group) for index, group in enumerate(at.groups)],
    )
    dependent = [one for group in at.groups for one in group.dependencies]
    if dependent:
        more = f", of which {DEPENDENCIES} are shown" if len(dependent) > DEPENDENCIES else ""
        chapter.explain(f"Rows of which each follows from the others ({len(dependent)} such sets{more}):")
    chapter.table(
        "dependencies",
        ("equalities", "rows, each with its part"),
        [
            (many(one.equalities), ", ".join(f"{row} ({part:+.3g})" for row, part in one.rows))
            for one in dependent[:DEPENDENCIES]
        ],
    )
    _ranks(exam, chapter)
    return chapter


def _short(at: Loops) -> Table:
    """What is known of the pose itself, before anything is run."""
    rows = [
        (
            loop.name,
            loop.equality.kind.name,
            " – ".join(loop.ends),
            loop.path.shape,
            str(len(loop.rows)),
            str(len(loop.zero_rows)),
            str(loop.group + 1),
            yes(loop.removable),
        )
        for loop in at.loops
    ]
    return Table("loops", ("equality", "type", "between", "shape", "rows", "zero", "group", "removable"), rows, 4)


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
        loop.equality.kind.name,
        " – ".join(loop.ends),
        str(loop.equality.rows),
        loop.path.shape,
        str(loop.group + 1),
        ", ".join(label or "its row" for label in loop.zero_rows) or NOTHING,
        ", ".join(dict.fromkeys(doubled)) or NOTHING,
        yes(removable),
        verdict or NOTHING,
    )


def _group_row(exam: Examination, index: int, group: Group) -> tuple[str, ...]:
    cause = exam.reactions.redundancy if exam.reactions else ()
    counts = (group.rows, group.zero, group.rank, group.redundancy, group.dof)
    return (
        str(index + 1),
        many(group.equalities),
        many(group.joints),
        *map(str, counts),
        group.shape,
        str(cause[index]) if index < len(cause) else NOTHING,
    )


def _ranks(exam: Examination, chapter: Chapter) -> None:
    history = exam.history
    if history is None:
        chapter.explain(f"How the rank changes along the motion: {lower(why_not(exam, 'rank'))}")
        return
    if not history.events:
        chapter.explain(f"Along the motion the rank stays {history.rank}.")
        return
    chapter.explain(f"Along the motion the rank is {history.rank}, except near singular poses:")
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
