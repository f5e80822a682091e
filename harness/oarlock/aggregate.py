"""From steps to a row a run, and from rows to a verdict: pure functions of the tables."""

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import polars as pl

from oarlock.case_file import Gate
from oarlock.cases import Case
from oarlock.errors import InputError
from oarlock.results import RunResult

TIMING_FIGURES = ("solve_ns_median", "step_us_median")
"""Figures that change from run to run on the same machine."""


def _number(value: Any) -> float | int | None:
    """A JSON number, or None for what does not apply or is not finite."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return None
    return value


def _maximum(steps: pl.DataFrame, column: str) -> float | None:
    return _number(steps[column].max())


def _ratio(steps: pl.DataFrame, column: str, over: str) -> float | None:
    total = int(steps[over].sum())
    return int(steps[column].sum()) / total if total else None


def summarise(result: RunResult) -> dict[str, Any]:
    """The summary row of a run. A figure that does not apply is None.

    iterations_mean and projection_iterations_mean are over solves (RK4 makes four a step); refreshes leave out the
    first solve of each fold, which has to start from something, and refolds count the folds after it; unprojected
    counts the steps whose projection did not land; energy_drift_rel is relative to the largest kinetic energy.
    """
    steps, key = result.steps, result.key
    row: dict[str, Any] = {"run": key.slug, **asdict(key)}
    solves = int(steps["solves"].sum() or 0)
    iterates = int(steps["iterations"].sum() or 0)
    refreshes = None
    if steps["refreshes"].null_count() < len(steps):
        refreshes = int(steps["refreshes"].sum()) - int((steps["refreshes"][0] or 0) > 0)
    energy_drift = None
    kinetic = steps["kinetic_energy"].max()
    if kinetic:
        energy = steps["energy"].to_numpy()
        energy_drift = float(np.abs(energy - energy[0]).max() / steps["kinetic_energy"].to_numpy().max())
    landings = steps["projection"].drop_nulls()
    solve_ns = steps.select(pl.col("solve_ns") / pl.col("solves")).to_series().median()
    row.update(
        status=result.status,
        message=result.message,
        steps_done=len(steps),
        solves=solves,
        unconverged=int(steps["unconverged"].sum() or 0),
        iterations_mean=_number(iterates / solves if solves else None),
        iterations_max=steps["iterations_worst"].max(),
        refreshes=refreshes,
        refolds=steps["refolds"].sum() if steps["refolds"].null_count() < len(steps) else None,
        rank_min=steps["rank"].min(),
        rank_max=steps["rank"].max(),
        min_norm_error_max=_maximum(steps, "min_norm_error"),
        min_norm_error_median=_number(steps["min_norm_error"].median()),
        residual_rel_max=_maximum(steps, "residual_rel"),
        inconsistency_max=_maximum(steps, "inconsistency"),
        qacc_rel_diff_max=_maximum(steps, "qacc_rel_diff"),
        qfrc_constraint_rel_diff_max=_maximum(steps, "qfrc_constraint_rel_diff"),
        drift_pos_max=_maximum(steps, "drift_pos"),
        drift_vel_max=_maximum(steps, "drift_vel"),
        drift_acc_max=_maximum(steps, "drift_acc"),
        unprojected=int((landings != "landed").sum()) if len(landings) else None,
        projection_rounds_mean=_number(steps["projection_rounds"].mean()),
        projection_rounds_max=steps["projection_rounds"].max(),
        projection_iterations_mean=_ratio(steps, "projection_iterations", "projection_solves"),
        projection_moved_max=_maximum(steps, "projection_moved"),
        energy_drift_rel=_number(energy_drift),
        truth_error_max=_maximum(steps, "truth_error"),
        published_position_error_max=_maximum(steps, "published_position_error"),
        published_velocity_error_rel_max=_maximum(steps, "published_velocity_error_rel"),
        published_multiplier_error_rel_max=_maximum(steps, "published_multiplier_error_rel"),
        trajectory_diff_max=_maximum(steps, "trajectory_diff"),
        solve_ns_median=_number(solve_ns),
        step_us_median=_number(steps["step_us"].median()),
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
