"""What a finding costs: how far the loops stand open because of it.

How a loop gives way (D1 to D5, E1) is what is left of its opening when the causes behind it are taken off: two bodies
that collide push a soft loop open, and it is not its softness that has to be mended.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.runs.drifts import Drift
from oarlock.diagnosis.verdict.findings import Finding

_DRIFT = ("D1", "D2", "D3", "D4", "D5")

_CAUSES = (
    "A1",
    "A2",
    "A3",
    "A4",
    "A5",
    "A7",
    "C2",
    "C4",
    "C5",
    "D6",
    "D8",
    "L13",
    "L15",
    "S3",
    "S5",
    "S7",
    "S8",
    "T4",
    "U4",
    "U5",
)
"""What opens a loop whatever gives way; its part is measured, or it is all there is."""

HIDES = ("A2", "A5", "C3", "C4", "C5", "L9", "L10", "L13", "L15", "S2", "S5", "S7")
"""What stiffer equalities would hide, or fight, and not mend."""

REST = 0.1
"""Of a drift: how a loop gives way is a note where what is behind it leaves less."""

TORN = 0.1
"""Of the mechanism's size: a loop that opens by more is torn, and how it moves is no linkage's motion."""


def priced(exam: Examination, findings: Iterable[Finding]) -> list[Finding]:
    """The findings with their costs, in the order given."""
    every = [replace(one, cost=cost(exam, one)) for one in findings]
    causes = [one for one in every if one.code in _CAUSES and one.severity != "note"]
    return [_less(one, causes) if one.code in (*_DRIFT, "S1") else one for one in every]


def withheld(findings: Sequence[Finding]) -> str:
    """The code of what is to be mended before settings are of use; empty where nothing is.

    Args:
        findings: the worst first.
    """
    for one in findings:
        if one.severity != "note" and one.code in HIDES:
            return one.code
        if one.severity != "note" and one.code in (*_DRIFT, "D6", "D8", "T2"):
            return ""
        if one.severity != "note" and one.code == "S1" and one.figures.get("meant"):
            return one.code  # it was tried from another start than the one that is meant
    return ""


def _less(finding: Finding, causes: Sequence[Finding]) -> Finding:
    """Without what causes behind it cost the same equality; a note where hardly anything of it is left."""
    if finding.code == "S1" and finding.figures.get("meant"):
        return finding
    behind = max((one for one in causes if finding.element in named(one)), key=lambda one: one.cost, default=None)
    if behind is None:
        return finding
    less = replace(finding, cost=max(0.0, finding.cost - behind.cost))
    if finding.code == "S1" or behind.code not in HIDES or less.cost > REST * finding.cost:
        return less
    return replace(less, severity="note", line=f"{finding.line}; {behind.code} is behind it")


def cost(exam: Examination, finding: Finding) -> float:
    """The part of an opening that a finding is the cause of, m, of an angle times the size of the loops; 0: none.

    A run that does not stay finite costs more than any other.
    """
    of = _COSTS.get(finding.code)
    value = 0.0 if of is None else of(exam, finding)
    return value if math.isfinite(value) else math.inf


def named(finding: Finding) -> set[str]:
    """The elements that a finding is about, and the equalities of the loops that they move."""
    return {finding.element, *finding.figures.get("also", ()), *finding.figures.get("loops", ())}


def metres(exam: Examination, distance: float | None, angle: float | None) -> float:
    """Of a distance (m) and an angle (rad) the one that moves more at the ends of the loops, m."""
    return max(distance or 0.0, exam.size * (angle or 0.0))


def widest(exam: Examination) -> Drift | None:
    """The equality that opens furthest in MuJoCo's run, by what moves at the ends of the loops; None without a run."""
    positions = [one for one in exam.drifts if one.level == "position"]
    return max(positions, key=lambda one: np.nan_to_num(metres(exam, one.metres, one.radians)), default=None)


def _drift(exam: Examination, finding: Finding) -> float:
    figures = finding.figures
    whole = metres(exam, figures.get("drift_m"), figures.get("drift_rad"))
    return whole * float(figures.get("part") or 1.0)


def _solver(exam: Examination, finding: Finding) -> float:
    """What an answer of the solver's own question saves; of a share of the row law, that share."""
    if "drift_m" in finding.figures or "drift_rad" in finding.figures:
        return _drift(exam, finding)
    if finding.severity == "error":
        return _blown(exam, finding)
    before, after = finding.figures.get("drift_before"), finding.figures.get("drift")
    return 0.0 if before is None or after is None else max(0.0, float(before) - float(after))


def _collision(exam: Examination, finding: Finding) -> float:
    given, without = finding.figures.get("drift"), finding.figures.get("drift_without")
    if given is None or without is None:
        return float(finding.figures.get("depth") or 0.0)
    return _turned(exam, finding, max(0.0, given - without))


def _lag(exam: Examination, finding: Finding) -> float:
    figures = finding.figures
    return _turned(exam, finding, figures["given"] - figures["without"])


def _turned(exam: Examination, finding: Finding, value: float | None) -> float:
    """A figure whose unit is beside it."""
    return float(value or 0.0) * (exam.size if finding.figures.get("unit") == "rad" else 1.0)


def _blown(exam: Examination, finding: Finding) -> float:
    """What makes a run diverge costs more than what is seen of it (R1)."""
    return math.inf if exam.recording is not None and exam.recording.end.how == "diverged" else 0.0


def _opened(exam: Examination, finding: Finding) -> float:
    """What the equality that is named stands open by at the start."""
    openings = exam.pose.openings if exam.pose is not None else ()
    own = max(
        (metres(exam, one.metres, one.radians) for one in openings if one.equality == finding.element), default=0.0
    )
    return own + _whole(exam, finding) if finding.figures.get("meant") else own  # all that follows comes of it


def _floored(exam: Examination, finding: Finding) -> float:
    """What is gone of a drift with a timestep that takes the solref as it is written."""
    one = exam.behind
    if one is None or one.suspect is None or one.suspect.sort != "refsafe" or one.suspect.name not in named(finding):
        return 0.0
    return one.share * _whole(exam, finding)


def _figure(name: str) -> Callable[[Examination, Finding], float]:
    return lambda exam, finding: _turned(exam, finding, finding.figures.get(name))


def _apart(exam: Examination, finding: Finding) -> float:
    """What the sides of an equality that is switched off part by."""
    return metres(exam, finding.figures.get("apart_m"), finding.figures.get("apart_rad"))


def _loose(exam: Examination, finding: Finding) -> float:
    """How far undriven freedoms take a body; nothing where its loops are torn, for then it is no linkage that moves."""
    return 0.0 if _whole(exam, finding) > TORN * exam.size else _figure("way")(exam, finding)


def _whole(exam: Examination, finding: Finding) -> float:
    """All that the equalities that are named open by."""
    names = named(finding)
    every = [one for one in exam.drifts if one.level == "position" and one.equality in names]
    return max((metres(exam, one.metres, one.radians) for one in every), default=0.0)


_COSTS: dict[str, Callable[[Examination, Finding], float]] = {
    **dict.fromkeys(_DRIFT, _drift),
    "A1": _blown,
    "A4": _blown,
    "T2": _blown,
    "D6": _solver,
    "A2": _whole,
    "A3": _whole,
    "A7": _whole,
    "L13": _whole,
    "L15": _whole,
    "D8": _whole,
    "S3": _whole,
    "S7": _whole,
    "C2": _lag,
    "A5": _collision,
    "A6": _figure("short"),
    "A8": _loose,
    "A9": _figure("short"),
    "A10": _figure("short"),
    "A11": _figure("way"),
    "C4": _collision,
    "C5": _collision,
    "C6": _figure("way"),
    "L6": _apart,
    "S1": _opened,
    "S2": _figure("gap"),
    "S4": _figure("left"),
    "S5": _figure("gap"),
    "S8": _figure("gap"),
    "T4": _floored,
    "U4": _figure("torn"),
    "U5": _whole,
}
"""Code → its cost; of all others the figures say nothing of an opening."""
