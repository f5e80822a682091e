"""Tolerances of figures: when a figure of a summary has changed, and which way is worse."""

from dataclasses import replace
from typing import Any

from oarlock.tables import figures, tolerances
from oarlock.tables.tolerances import Tolerance

APART = replace(tolerances.WALK, group="trajectory", better="neither", relative=0.0)
"""Largest distance between the coordinates of a run and its counterpart, by the tables of steps. Its floor decides."""

FIGURES: dict[str, Tolerance] = {
    **{figure.name: figure.tolerance for figure in figures.FIGURES if figure.tolerance is not None},
    "steps_done": tolerances.LENGTH,
    "nv": tolerances.WHOLE,
    "rows": tolerances.WHOLE,
    "rank": tolerances.WHOLE,
    "dof": tolerances.WHOLE,
    "closing_moved": tolerances.MOVED,
}
"""Figure of a run or of its model → how it is judged. Other columns identify the run or follow from these."""


def tolerance_of(figure: str, before: dict[str, Any], after: dict[str, Any], timings: float | None = None) -> Tolerance:
    """Returns how a figure of a run and its counterpart is judged.

    Args:
        figure: its name in the summary.
        before: summary row of the run.
        after: summary row of its counterpart.
        timings: factor by which timings may change; None to leave them unjudged.
    """
    found = FIGURES.get(figure, tolerances.UNKNOWN)
    matched = before["form"] == after["form"] == "matched" or before["mode"] == after["mode"] == "calibration"
    if found.group == "parity" and not matched:
        # Exact constraints differ from soft ones, and MuJoCo's solvers from each other, for good reasons.
        return tolerances.APART
    if found is tolerances.LENGTH and before["status"] == after["status"] == "diverged":
        return replace(found, better="larger", cause="steps until it diverged")
    if found is tolerances.TIME and timings is not None:
        return replace(found, relative=timings - 1.0, cause="--timings")
    return found
