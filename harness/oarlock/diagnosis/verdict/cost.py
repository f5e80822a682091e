"""What a finding costs: how far the loops stand open because of it."""

import math
from collections.abc import Callable

from oarlock.diagnosis.examination import Examination
from oarlock.diagnosis.verdict.findings import Finding

_DRIFT = ("D1", "D2", "D3", "D4", "D5", "D6")


def cost(exam: Examination, finding: Finding) -> float:
    """The part of an opening that a finding is the cause of, m, of an angle times the size of the loops; 0: none.

    A run that does not stay finite costs more than any other.
    """
    of = _COSTS.get(finding.code)
    value = 0.0 if of is None else of(exam, finding)
    return value if math.isfinite(value) else math.inf


def metres(exam: Examination, distance: float | None, angle: float | None) -> float:
    """Of a distance (m) and an angle (rad) the one that moves more at the ends of the loops, m."""
    return max(distance or 0.0, exam.size * (angle or 0.0))


def _drift(exam: Examination, finding: Finding) -> float:
    figures = finding.figures
    whole = metres(exam, figures.get("drift_m"), figures.get("drift_rad"))
    return whole * float(figures.get("part") or 1.0)


def _collision(exam: Examination, finding: Finding) -> float:
    given, without = finding.figures.get("drift"), finding.figures.get("drift_without")
    if given is None or without is None:
        return float(finding.figures.get("depth") or 0.0)
    return _turned(exam, finding, max(0.0, given - without))


def _turned(exam: Examination, finding: Finding, value: float | None) -> float:
    """A figure whose unit is beside it."""
    return float(value or 0.0) * (exam.size if finding.figures.get("unit") == "rad" else 1.0)


def _blown(exam: Examination, finding: Finding) -> float:
    """What makes a run diverge costs more than what is seen of it (R1)."""
    return math.inf if exam.recording is not None and exam.recording.end.how == "diverged" else 0.0


def _figure(name: str) -> Callable[[Examination, Finding], float]:
    return lambda exam, finding: _turned(exam, finding, finding.figures.get(name))


def _pace(exam: Examination, finding: Finding) -> float:
    """What time stepping costs the equalities that are named."""
    named = {finding.element, *finding.figures.get("also", ())}
    every = [one for one in exam.drifts if one.level == "position" and one.equality in named]
    return max((metres(exam, one.metres, one.radians) for one in every), default=0.0)


_COSTS: dict[str, Callable[[Examination, Finding], float]] = {
    **dict.fromkeys(_DRIFT, _drift),
    "A1": _blown,
    "T2": _blown,
    "D8": _pace,
    "C2": _figure("given"),
    "C4": _collision,
    "S1": _figure("opening"),
    "S2": _figure("gap"),
    "S4": _figure("left"),
    "S5": _figure("gap"),
    "U4": _figure("torn"),
    "U5": _figure("apart"),
}
"""Code → its cost; of all others the figures say nothing of an opening."""
