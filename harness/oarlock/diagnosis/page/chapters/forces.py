"""The forces: what goes through the equalities, and how much of it is determined."""

from oarlock.base.numbers import NOTHING, figure, percent
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.loops.uniqueness import Reaction
from oarlock.diagnosis.loops.wrenches import Wrench
from oarlock.diagnosis.page.blocks import Chapter, Table
from oarlock.diagnosis.page.chapters.words import counted, lower, many, why_not
from oarlock.diagnosis.page.document import largest
from oarlock.diagnosis.verdict.ranks import hanging

_EARLY = "MuJoCo until then"


def forces(exam: Examination) -> Chapter:
    """What goes through the equalities, and how much of it is determined."""
    chapter = Chapter("forces", "Forces", 6)
    known = bool(exam.given or exam.determined)
    if known:
        _wrenches(exam, chapter)
    else:
        chapter.say(f"Wrenches: {lower(why_not(exam, 'forces'))}")
    _pushes(exam, chapter)
    if exam.reactions is None:
        chapter.say(f"Which reactions are unique: {lower(why_not(exam, 'reactions'))}")
        return chapter
    every = [*exam.reactions.equalities, *exam.reactions.together, *exam.reactions.joints]
    chapter.explain(f"Which reactions the motion determines, from {counted(exam.reactions.poses, 'closed pose')}:")
    columns = ("of", "which", "between", "force", "torque", "in all")
    short = None if known else ("of", "which", "in all")
    chapter.table("reactions", columns, [_reaction(exam, one) for one in every], words=3, short=short)
    return chapter


def _wrenches(exam: Examination, chapter: Chapter) -> None:
    chapter.explain(
        "Largest values of the run. A multiplier has a part that the motion determines, on which every solver must "
        "agree, and one that does not change the motion, which only the solver decides. Exact multipliers are of "
        "the least norm."
    )
    until = _until(exam)
    if until and exam.exact:
        chapter.say(
            f"The exact solution ends at t = {exam.exact.end.time_s:.6g} s: it compares with MuJoCo's largest values "
            "until then."
        )
    ours = {one.equality: one for one in exam.determined}
    theirs = {one.equality: one for one in exam.given}
    verdicts = {one.names[0]: _verdict(exam, one) for one in exam.reactions.equalities} if exam.reactions else {}
    rows, short = [], []
    for name in dict.fromkeys([*theirs, *ours]):
        for what, cells in _peaks(theirs.get(name), ours.get(name), until):
            rows.append((name, what, *cells))
            short.append((name, what, *cells[:-2], verdicts.get(name, NOTHING)))
    columns = ("equality", "what", "MuJoCo", *([_EARLY] if until else []), "exact")
    chapter.table(
        "forces",
        (*columns, "not determined, MuJoCo", "not determined, exact"),
        rows,
        words=2,
        short=Table("forces", (*columns, "reaction"), short, 2),
    )


def _pushes(exam: Examination, chapter: Chapter) -> None:
    """What limits, friction loss and contacts do beside the loops."""
    if exam.recording is None or not exam.recording.pushes:
        return
    chapter.explain(
        "Limits, friction loss and contacts beside the loops, in MuJoCo's run: the largest force of each, of a contact "
        "that of all its points along the normal."
    )
    rows = []
    for push in exam.recording.pushes:
        held = percent(push.stuck / push.steps) if push.kind == "friction" else NOTHING
        force = figure(push.largest, push.unit)
        acts = percent(push.steps / exam.recording.steps)
        rows.append((push.name, f"{push.first_s:.6g}", f"{push.last_s:.6g}", acts, held, force))
    columns = ("of", "from (s)", "to (s)", "of the steps", "held", "largest force")
    chapter.table("pushes", columns, rows, words=1)
    if exam.exact is not None and len(exam.exact.loads):
        units = [{push.unit for push in exam.recording.pushes if push.kind == kind} for kind in ("limit", "friction")]
        limits, friction = (unit.pop() if len(unit) == 1 else "N or N m" for unit in units)
        kinds = ("limits", limits), ("friction", friction), ("all contacts together", "N")
        most = zip(kinds, exam.exact.loads.max(axis=0).tolist(), strict=True)
        told = [f"{what} with up to {figure(force, unit)}" for (what, unit), force in most if force]
        chapter.say(f"With exact loops: {'; '.join(told) or 'none of them pushes'}.")


def _until(exam: Examination) -> int | None:
    """Steps that the exact solution made, where it made fewer than MuJoCo."""
    if exam.exact is None or exam.recording is None:
        return None
    steps = len(exam.exact.time)
    return steps if 0 < steps < exam.recording.steps else None


def _peaks(given: Wrench | None, determined: Wrench | None, until: int | None) -> list[tuple[str, tuple[str, ...]]]:
    """What acts → its largest values: MuJoCo's, until the exact run ends, the exact ones, and what is undetermined."""
    some = given or determined
    assert some is not None
    wanted: list[tuple[str, str, int | None, str]] = []
    if some.total.force is not None:
        wanted.append(("|force|", "force", None, "N"))
    if some.total.torque is not None:
        wanted.append(("|torque|", "torque", None, "N m"))
    if some.total.ends is not None:
        pairs = zip(some.ends, some.units, strict=False)
        wanted += [(f"on '{name}'", "ends", end, unit) for end, (name, unit) in enumerate(pairs)]
    found = []
    for what, name, end, unit in wanted:
        asked = [("total", given, None), *([("total", given, until)] if until else []), ("total", determined, None)]
        asked += [("free", given, None), ("free", determined, None)]
        found.append((what, tuple(_peak(wrench, part, name, end, steps, unit) for part, wrench, steps in asked)))
    return found


def _peak(wrench: Wrench | None, part: str, name: str, end: int | None, steps: int | None, unit: str) -> str:
    if wrench is None:
        return NOTHING
    values = getattr(getattr(wrench, part), name)[:steps]
    return figure(largest(values if end is None else values[:, [end]]) or 0.0, unit)


def _verdict(exam: Examination, one: Reaction) -> str:
    """Unique in the mechanism alone is not so beside what shares the load, nor where a small number decides."""
    if not hanging(exam).isdisjoint(one.names):
        return f"{one.verdict}, by a small number (L8)"
    shared = {beside.equality for beside in exam.recording.beside} if exam.recording else set()
    alone = one.verdict == "unique" and one.owner == "equality" and one.names[0] in shared
    return "unique, not beside others (U3)" if alone else one.verdict


def _reaction(exam: Examination, one: Reaction) -> tuple[str, ...]:
    of = {"equality": "equality", "together": "together", "joint": "joint of the tree"}[one.owner]
    directions = (str(part) if part is not None else NOTHING for part in (one.force, one.torque))
    return of, many(one.names), " – ".join(one.bodies) or NOTHING, *directions, _verdict(exam, one)
