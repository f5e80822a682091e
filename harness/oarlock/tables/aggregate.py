"""From steps to a row a run, and from rows to a verdict: pure functions of the tables."""

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import polars as pl

from oarlock.base.errors import InputError
from oarlock.base.numbers import finite
from oarlock.cases.case import Case
from oarlock.cases.case_file import Gate
from oarlock.tables.schema import RunResult
from oarlock.tables.spool import Spool

TIMING_FIGURES = ("solve_ns_median", "step_us_median")
"""Figures that change from run to run on the same machine."""


_MAXIMA = (
    "iterations_worst",
    "rank",
    "min_norm_error",
    "residual_rel",
    "inconsistency",
    "qacc_rel_diff",
    "qfrc_constraint_rel_diff",
    "drift_pos",
    "drift_vel",
    "drift_acc",
    "projection_rounds",
    "projection_moved",
    "truth_error",
    "published_position_error",
    "published_velocity_error_rel",
    "published_multiplier_error_rel",
    "trajectory_diff",
)
_SUMS = (
    "solves",
    "unconverged",
    "iterations",
    "refreshes",
    "refolds",
    "projection_rounds",
    "projection_solves",
    "projection_iterations",
)
_COUNTS = ("refreshes", "refolds", "projection", "projection_rounds")


def _ratio(figure: int, over: int) -> float | None:
    return figure / over if over else None


def _median(steps: Spool, figure: pl.Expr) -> float | None:
    """The median of the steps that have the figure. It needs a whole column, and holds nothing else."""
    values, count = np.empty(len(steps)), 0
    for chunk in steps.chunks(figure.meta.root_names()):
        found = chunk.select(figure).to_series().drop_nulls().to_numpy()
        values[count : count + len(found)] = found
        count += len(found)
    if not count:
        return None
    low, high = (count - 1) // 2, count // 2
    values = values[:count]
    values.partition((low, high))
    return finite(pl.Series(values[low : high + 1]).median())


def _energy_drift(steps: Spool) -> float | None:
    energy, kinetic = pl.col("energy"), pl.col("kinetic_energy")
    start, largest = steps.collect(energy.first(), kinetic.fill_null(math.nan).nan_max()).row(0)
    if start is None or not largest:
        return None
    drift = steps.collect((energy - start).abs().fill_null(math.nan).nan_max()).item()
    return finite(drift / largest)


def summarise(result: RunResult) -> dict[str, Any]:
    """The summary row of a run. A figure that does not apply is None.

    iterations_mean and projection_iterations_mean are over solves (RK4 makes four a step); refreshes leave out the
    first solve of each fold, which has to start from something, and refolds count the folds after it; unprojected
    counts the steps whose projection did not land; energy_drift_rel is relative to the largest kinetic energy.
    """
    steps, key = result.steps, result.key
    col = pl.col
    found = steps.collect(
        *(col(name).max().alias(f"max {name}") for name in _MAXIMA),
        *(col(name).sum().alias(f"sum {name}") for name in _SUMS),
        *(col(name).count().alias(f"count {name}") for name in _COUNTS),
        col("rank").min().alias("min rank"),
        col("refreshes").first().alias("first refreshes"),
        (col("projection") != "landed").sum().alias("unprojected"),
    ).row(0, named=True)
    largest = {name: finite(found[f"max {name}"]) for name in _MAXIMA}
    total = {name: int(found[f"sum {name}"]) for name in _SUMS}
    count = {name: int(found[f"count {name}"]) for name in _COUNTS}
    refreshes = total["refreshes"] - int((found["first refreshes"] or 0) > 0)
    row: dict[str, Any] = {"run": key.slug, **asdict(key)}
    row.update(
        status=result.status,
        message=result.message,
        steps_done=len(steps),
        solves=total["solves"],
        unconverged=total["unconverged"],
        iterations_mean=_ratio(total["iterations"], total["solves"]),
        iterations_max=largest["iterations_worst"],
        refreshes=refreshes if count["refreshes"] else None,
        refolds=total["refolds"] if count["refolds"] else None,
        rank_min=found["min rank"],
        rank_max=largest["rank"],
        min_norm_error_max=largest["min_norm_error"],
        min_norm_error_median=_median(steps, col("min_norm_error")),
        residual_rel_max=largest["residual_rel"],
        inconsistency_max=largest["inconsistency"],
        qacc_rel_diff_max=largest["qacc_rel_diff"],
        qfrc_constraint_rel_diff_max=largest["qfrc_constraint_rel_diff"],
        drift_pos_max=largest["drift_pos"],
        drift_vel_max=largest["drift_vel"],
        drift_acc_max=largest["drift_acc"],
        unprojected=int(found["unprojected"]) if count["projection"] else None,
        projection_rounds_mean=_ratio(total["projection_rounds"], count["projection_rounds"]),
        projection_rounds_max=largest["projection_rounds"],
        projection_iterations_mean=_ratio(total["projection_iterations"], total["projection_solves"]),
        projection_moved_max=largest["projection_moved"],
        energy_drift_rel=_energy_drift(steps),
        truth_error_max=largest["truth_error"],
        published_position_error_max=largest["published_position_error"],
        published_velocity_error_rel_max=largest["published_velocity_error_rel"],
        published_multiplier_error_rel_max=largest["published_multiplier_error_rel"],
        trajectory_diff_max=largest["trajectory_diff"],
        solve_ns_median=_median(steps, col("solve_ns") / col("solves")),
        step_us_median=_median(steps, col("step_us")),
    )
    return row


@dataclass(frozen=True)
class Verdict:
    """A gate held against one run (or against nothing, if no run was picked)."""

    gate: Gate
    run: str | None
    value: float | str | None
    held: bool | None
    """None: not checked, for no run was picked."""

    def line(self) -> str:
        """One line with figure and limit."""
        value = "not measured" if self.value is None else self.value
        value = value if isinstance(value, str) else f"{value:.4g}"
        return f"{self.gate.figure} = {value} of {self.run or 'no run'}, expected {self.gate.limit} ({self.gate.cause})"


def judge(case: Case, rows: list[dict[str, Any]], *, complete: bool = False) -> list[Verdict]:
    """Holds every gate of a case against every run it picks.

    A gate that picks none is not checked; after a ``complete`` run of the case it has failed, for it can never hold.

    Raises:
        InputError: a gate names a figure or a key that no summary has.
    """
    verdicts = []
    for gate in case.file.gates:
        if rows:
            kind, wanted = (str, "in words") if gate.equal is not None else (int | float, "with a number")
            figures = {name for row in rows for name, value in row.items() if isinstance(value, kind)}
            if gate.figure in rows[0] and gate.figure not in figures and any(row[gate.figure] for row in rows):
                raise InputError(f"gate of case '{case.name}' bounds '{gate.figure}', expected a figure {wanted}")
            unknown = [name for name in (gate.figure, *gate.where) if name not in rows[0]]
            if unknown:
                raise InputError(
                    f"gate of case '{case.name}' names '{unknown[0]}', expected one of: {', '.join(rows[0])}"
                )
        picked = [row for row in rows if all(str(row[k]) == v for k, v in gate.where.items())]
        if not picked:
            verdicts.append(Verdict(gate, None, None, False if complete else None))
        for row in picked:
            value = row[gate.figure]
            whole = row["status"] != "diverged"  # what a run showed before it diverged proves nothing
            verdicts.append(Verdict(gate, row["run"], value, gate.holds(value) and whole))
    return verdicts
