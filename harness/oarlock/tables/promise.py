"""What ``done`` promises of a run, and what a run is called that does not keep it."""

import math
from typing import Any

import polars as pl

from oarlock.base.errors import InputError
from oarlock.base.numbers import figure
from oarlock.cases.case import Case
from oarlock.cases.integrators import INTEGRATORS
from oarlock.tables.reductions import change
from oarlock.tables.schema import RunKey
from oarlock.tables.spool import Spool

ENERGY_BOUND = 1e-3
"""Of the largest kinetic energy. Steps that resolve a motion keep a conserved energy a hundred times better; one that
loses its branch, or is stepped too coarsely, gains or loses percents at once. It binds integrators of order two and
more: one of the first order changes energies by a step over the time of a swing, percents, with nothing lost."""

ENERGY_NOISE = 1e-9
"""Of the largest energy. Less is rounding, which is all that a mechanism at rest has."""


DOUBTFUL = 1e4
"""Factor between the rank cut and the eigenvalue next to it, below which the cut decides and not the mechanism: a
length or an axis that is off by 1e-6 moves an eigenvalue by that much."""


ERROR_BOUND = 0.1
"""rad or m, by a run's own estimate. A mechanism that is so far off is in another pose; most runs are a million times
better, and one that passes by a singular pose too coarsely ends anywhere."""


def ended(key: RunKey, steps: Spool, message: str) -> tuple[str, str]:
    """How a run ended, and why unless it is ``done``.

    It is ``diverged`` if it was lost before its last step; ``drifted`` if, freely with exact constraints, it gained or
    lost energy that is conserved; ``inaccurate`` if its own estimate of its error is too large, or there is none for
    the walk at half the timestep was lost; ``unprojected`` if projections did not reach the constraints;
    ``unconverged`` if solves did not converge.

    Args:
        key: which run it is.
        steps: its steps.
        message: when and why it was lost; empty if it was not.
    """
    if message:
        return "diverged", message
    exact = key.mode == "free" and key.form == "hard"
    judged = exact and INTEGRATORS[key.integrator].order > 1
    drift = change("energy", "kinetic_energy")(steps) if judged else None
    if drift is not None and drift > ENERGY_BOUND and _beyond_noise(steps):
        return "drifted", (
            f"its energy, which nothing drives or damps, changes by {figure(drift)} of the largest kinetic energy, "
            f"expected at most {ENERGY_BOUND:g}"
        )
    error = steps.collect(pl.col("error_estimate").max()).item()
    if error is not None and error > ERROR_BOUND:
        if error == math.inf:
            return "inaccurate", "the walk at half the timestep was lost, which would tell its error"
        return (
            "inaccurate",
            f"by its own estimate it is off by {figure(error)} m or rad, expected at most {ERROR_BOUND:g}",
        )
    counts = pl.col("unconverged").sum(), pl.col("solves").sum(), (pl.col("projection") != "landed").sum()
    unconverged, solves, unprojected = steps.collect(*counts).row(0)
    if unprojected:
        return "unprojected", f"{unprojected} of {len(steps)} projections did not reach the constraints"
    if unconverged:
        return "unconverged", f"{unconverged} of {solves} solves did not converge"
    return "done", ""


def doubts(rows: list[dict[str, Any]]) -> list[str]:
    """What the rows of a summary say of ranks that are not beyond doubt, a sentence a kind."""
    found = []
    near = [row for row in rows if (row.get("rank_margin_min") or math.inf) < DOUBTFUL]
    if near:
        worst = min(near, key=lambda row: row["rank_margin_min"])
        found.append(
            f"the rank cut decides in {len(near)} of {len(rows)} runs: in {worst['run']} an eigenvalue comes within a "
            f"factor of {figure(max(worst['rank_margin_min'], 1.0))} of it, expected {DOUBTFUL:g} and more"
        )
    risen = [row for row in rows if row.get("rank_rises")]
    if risen:
        first = min(risen, key=lambda row: row["rank_rises_at_s"])
        found.append(
            f"the rank of the start rises in {len(risen)} of {len(rows)} runs: in {first['run']} first at "
            f"t = {figure(first['rank_rises_at_s'])} s, for more stands there than open rows explain"
        )
    return found


def unexpected(case: Case, row: dict[str, Any]) -> bool:
    """Whether a run ended other than ``done``, and other than its case expects.

    Raises:
        InputError: the case selects runs by a key that no summary has.
    """
    allowed = row["status"] == "done"
    for ending in case.file.endings:
        unknown = [name for name in ending.where if name not in row]
        if unknown:
            raise InputError(f"endings of case '{case.name}' name '{unknown[0]}', expected one of: {', '.join(row)}")
        picked = all(str(row[name]) == value for name, value in ending.where.items())
        allowed |= picked and row["status"] == ending.status
    return not allowed


def _beyond_noise(steps: Spool) -> bool:
    least, most = steps.collect(pl.col("energy").min(), pl.col("energy").max().alias("most")).row(0)
    return most - least > ENERGY_NOISE * max(abs(least), abs(most))
