"""Which findings a change is to mend, and which only seem to be mended, or are hidden by stiffer equalities."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from oarlock.base.errors import few
from oarlock.base.text import called, quoted
from oarlock.diagnosis.edit.changes import (
    Armature,
    Change,
    Coefficients,
    Constants,
    Exclusion,
    Keyframe,
    RelativePose,
    Settings,
    Switched,
)
from oarlock.diagnosis.fix.bench import Bench
from oarlock.diagnosis.verdict.answer import BEYOND
from oarlock.diagnosis.verdict.cost import named
from oarlock.diagnosis.verdict.findings import Finding
from oarlock.mechanics.names import equalities
from oarlock.mechanics.servos import servos

CLAIMS = {
    Keyframe: ("S1",),
    Coefficients: ("S1", "S4", "A2"),
    RelativePose: ("S1", "S2", "S4", "S7"),
    Exclusion: ("C4",),
    Armature: ("A1",),
    Switched: ("L6", "L1"),
    Settings: ("D1", "D2", "D3", "D4", "D5", "D6", "T2", "A4"),
}
"""Kind of change → codes of findings that it is to mend; constants those of their own equality."""

MENDED = {code for kind, codes in CLAIMS.items() if not issubclass(kind, Constants) for code in codes}
"""Codes that some change is to mend, whatever they are said of."""

HIDDEN = ("A5", "C4", "C5", "S7")
"""Codes that are found by how far a loop opens, or by the pose of the start: with one that opens less, or from another
pose, they are not found, and are there."""

_DRIFT = ("D1", "D2", "D3", "D4", "D5", "D6")

_UNSEEN = {"T3"}
"""Codes of what the search for settings shows: a fixed file's own check makes none. D6 may be one of them."""

ANOTHER = ("L13", "L15", "S5")
"""Codes of warnings of which it is another mechanism that stiffer equalities would hold."""

TURNED_BACK = ("U4", "U5")
"""Codes of what stiffer equalities do mend, among those that something else in the file has to mend."""


def claims(bench: Bench, change: Change, finding: Finding) -> bool:
    """Whether a change is to mend a finding."""
    if finding.code not in CLAIMS.get(type(change), ()):
        return False
    if isinstance(change, Armature):
        return finding.element in _driven(bench, change)
    if isinstance(change, Switched):
        return finding.code == "L1" or finding.element == equalities(bench.base.model)[change.equality].name
    if isinstance(change, Constants):
        return any(one.index == change.equality and one.name == finding.element for one in equalities(bench.base.model))
    return True


def _driven(bench: Bench, change: Armature) -> set[str]:
    """The servos on the joints of an armature."""
    model = bench.base.model
    return {one.name for one in servos(model) if one.joint in change.joints}


def standing(left: Sequence[Finding]) -> list[Finding]:
    """What no settings mend: beside it stiffer equalities only hide what is wrong."""
    return [
        one
        for one in left
        if (one.severity == "error" and one.code in BEYOND and one.code not in TURNED_BACK)
        or (one.severity == "warning" and one.code in ANOTHER)
    ]


def mended(findings: Sequence[Finding], changes: Sequence[Change], again: Sequence[Finding]) -> tuple[str, ...]:
    """Codes of errors and warnings that a fixed file does not have any more, not even as a note of the same element.

    Args:
        findings: of the file as it was.
        changes: what was changed.
        again: what the fixed file's own check found, with what it only does not see.
    """
    were = [one for one in findings if one.severity != "note"]
    elements = {(one.code, one.element) for one in were}
    left = {one.code for one in again if one.severity != "note" or (one.code, one.element) in elements}
    drifting = set[str]().union(*(named(one) for one in again if one.code in _DRIFT))
    if any(one.code == "S4" and one.element in drifting for one in were):
        left.add("S4")  # it is looked for behind an open start only, and what lasts behind a closed one is a drift
    if not any(isinstance(change, Settings) for change in changes):
        left.add("D6")
    return tuple(sorted({one.code for one in were} - left - _UNSEEN))


def in_words(findings: Sequence[Finding]) -> str:
    """Findings by their codes, names and elements."""
    return few([f"{one.code} {one.name}" + (f" of {quoted(one.element)}" if one.element else "") for one in findings])


def hidden(
    bench: Bench, changes: Sequence[Change], findings: Sequence[Finding], left: Sequence[Finding]
) -> Iterator[Finding]:
    """What was found before, is not found any more, and is there all the same, for no change is to mend it."""
    told = {(one.code, name, one.figures.get("joint")) for one in left for name in named(one)}
    stiffer = any(isinstance(change, Settings) for change in changes)
    for one in findings:
        if (
            one.code not in HIDDEN
            or one.severity == "note"
            or (one.code, one.element, one.figures.get("joint")) in told
        ):
            continue
        if not any(claims(bench, change, one) for change in changes):
            yield replace(one, line=_unmended(one, stiffer))


def _unmended(one: Finding, stiffer: bool) -> str:
    if one.code == "C5" and stiffer:
        joint = one.figures["joint"]
        return (
            f"stiffer equalities push the limit of {called('joint', joint)} ({one.figures['limit']:.4g}) in, and do "
            f"not mend it: widen the range of {quoted(joint)} to {one.figures['wanted']:.4g}"
        )
    why = "stiffer equalities hide it, and do not mend it" if stiffer else "it is hidden, and not mended"
    return f"{why}; as the file was: {one.line}"
