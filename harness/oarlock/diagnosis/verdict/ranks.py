"""From ranks to findings: those that hang on a small number, and what hangs on them."""

from collections.abc import Iterable, Iterator

import numpy as np

from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.loops.rank import CUT, NEAR
from oarlock.diagnosis.verdict.findings import Finding, found


def doubtful(exam: Examination, equalities: Iterable[str]) -> bool:
    """Whether the rank of their loops hangs on a small number (L8): what they then admit is an accident of the file."""
    return not _doubtful(exam).isdisjoint(equalities)


def hanging(exam: Examination) -> set[str]:
    """Equalities and joints of loops whose rank hangs on a small number, by name: with them it hangs what is unique."""
    names = _doubtful(exam)
    groups = exam.pose.loops.groups if exam.pose is not None else ()
    return names | {joint for one in groups if not names.isdisjoint(one.equalities) for joint in one.joints}


def flips(exam: Examination) -> Iterator[Finding]:
    """L14: a rank that is another one along the motion than at the closed start, by a number that stays small."""
    history, pose = exam.history, exam.pose
    if history is None or pose is None:
        return
    others = {pose.loops.rank, *history.ranks} - {history.rank}
    if not others:
        return
    decides = history.dropped if max(others) > history.rank else history.smallest
    least, most = float(decides.min()), float(decides.max())
    if float(np.median(decides)) >= NEAR * CUT or most <= CUT / NEAR:  # it passes a singular pose, and that is all
        return
    groups = [*history.generic.groups, *pose.loops.groups]
    names = list(dict.fromkeys(name for one in groups if one.spectrum.doubtful for name in one.equalities))
    if not names:
        return
    times = [event.time_s for event in history.events if event.kind == "singular" and decides is history.smallest]
    said = (
        f"rank {pose.loops.rank} at the closed start and {_along(history.ranks)} along the motion: the singular value "
        f"that decides goes from {least:.2g} to {most:.2g} of the largest"
    )
    if times:
        more = f" and {len(times) - 1} times more" if len(times) > 1 else ""
        said += f", and through zero at t = {times[0]:.4g} s{more}"
    if exam.exact is None and (lost := exam.missing.get("exact")):
        said += f"; the exact solution: {lost.partition(', expected')[0]}"
    figures = {
        "rank": pose.loops.rank,
        "ranks_along": list(history.ranks),
        "least": least,
        "most": most,
        "times_s": times,
    }
    yield found("L14", exam.file, said, element=names[0], also=names[1:], **figures)


def _along(ranks: Iterable[int]) -> str:
    return " or ".join(map(str, sorted(set(ranks))))


def _doubtful(exam: Examination) -> set[str]:
    remarks = exam.remarks.get("doubtful", [])
    return {name for one in remarks for name in (one.element, *one.figures.get("also", ()))}
