"""Comparison of the figures, the trajectories and the gates of runs and their counterparts."""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import polars as pl

from oarlock.base.errors import one_line
from oarlock.base.numbers import finite, short
from oarlock.compare.folders import KEYS, Run, Side
from oarlock.compare.tolerances import APART, tolerance_of

VERDICTS = ("worse", "disappeared", "changed", "better", "appeared", "same", "not judged")
"""Verdicts of a comparison, in the order in which they are shown."""

ENDINGS = {
    "done": 0,
    "unconverged": 1,
    "unprojected": 1,
    "drifted": 1,
    "inaccurate": 1,
    "diverged": 2,
    "failed": 3,
    "refused": 3,
}
"""Status of a run → how bad it is."""

_RUN = ("run", "status", "message", "point", "solves")
"""Columns of a summary, besides ``KEYS``, that are no figures or follow from others."""

CHUNK = 50_000
"""Rows of two tables of steps that are in memory at once."""


@dataclass(frozen=True)
class Comparison:
    """The comparison of one figure of a run with that of its counterpart.

    Attributes:
        verdict: one of ``VERDICTS``.
        case: name of the case.
        run: name of the run; empty for a gate that selected none.
        group: what the figure is about: drift, truth, energy, …, status, gate, run.
        figure: its name in the summary.
        before: its value in the first folder.
        after: its value in the second folder.
        factor: after over before, both raised to the floor; None if they are not numbers.
        time_s: the worst moment of ``after``, s; for trajectories the first one beyond the tolerance.
        tolerance: the tolerance in words.
        cause: the cause of the tolerance, or another remark.
    """

    verdict: str
    case: str
    run: str
    group: str
    figure: str
    before: Any = None
    after: Any = None
    factor: float | None = None
    time_s: float | None = None
    tolerance: str = ""
    cause: str = ""

    def line(self) -> str:
        """The comparison in one line with its values."""
        text = f"{self.figure}: {worded(self.before)} → {worded(self.after)}"
        more = [
            f"× {self.factor:.3g}" if self.factor is not None else "",
            f"t = {self.time_s:g} s" if self.time_s is not None else "",
            f"tolerance {self.tolerance}" if self.tolerance else "",
            self.cause,
        ]
        more = [one_line(part) for part in more if part]
        return f"{text} ({'; '.join(more)})" if more else text

    def document(self) -> dict[str, Any]:
        """Returns the comparison as a document for JSON, with infinities as null."""
        return {name: finite(value) for name, value in asdict(self).items()}


def worded(value: Any) -> str:
    """Writes a value for a message, with as many digits as a change shows in."""
    return short(value, 4)


def number(value: Any) -> float | None:
    """Returns a value as a number, or None if it is none."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


# What became of the figures.


def compare_figures(before: Run, after: Run, timings: float | None) -> Iterator[Comparison]:
    """Compares the status and every figure of a run with those of its counterpart."""
    case, name = after.case, after.name
    status, became = before.row["status"], after.row["status"]
    verdict = "same"
    if status != became:
        change = ENDINGS.get(became, 3) - ENDINGS.get(status, 3)
        verdict = "worse" if change > 0 else "better" if change < 0 else "changed"
    yield Comparison(verdict, case, name, "status", "status", status, became, cause=after.row.get("message") or "")
    for figure, value in before.row.items():
        if figure in KEYS or figure in _RUN:
            continue
        found = _figure(figure, before, after, timings)
        if found and found.verdict in ("worse", "changed") and after.steps and found.group != "structure":
            found = Comparison(**{**asdict(found), "time_s": _worst_moment(after, figure)})
        if found and not (value is None and after.row[figure] is None):
            yield found
    if before.steps and after.steps and before.row["timestep_s"] == after.row["timestep_s"]:
        yield from _trajectories(before, after)


def _figure(figure: str, before: Run, after: Run, timings: float | None) -> Comparison | None:
    was, became = before.row[figure], after.row[figure]
    tolerance = tolerance_of(figure, before.row, after.row, timings)
    place = (after.case, after.name, tolerance.group, figure, was, became)
    low, high = number(was), number(became)
    if low is not None and high is not None:
        factor = tolerance.factor(low, high)
        verdict = tolerance.verdict(low, high)
        if tolerance.group == "timing" and timings is None:
            verdict = "not judged"
        return Comparison(verdict, *place, factor=factor, tolerance=tolerance.words, cause=tolerance.cause)
    if was is None and became is None:
        return None
    if tolerance.group == "timing" and timings is None:
        return Comparison("not judged", *place)
    if was is None or became is None:
        return Comparison("appeared" if was is None else "disappeared", *place, cause="not measured on one side")
    return Comparison("same" if was == became else "changed", *place)


def _worst_moment(run: Run, figure: str) -> float | None:
    """Returns the time (s) at which the figure of the steps was largest whose maximum the summary has."""
    column = figure.removesuffix("_max")
    if column == figure or figure == "iterations_max":  # of one solve, where the table has a step's sum
        return None
    with run.folder.scanning(run.row["run"]) as table:
        if column not in table.collect_schema():
            return None
        figures = pl.col(column).cast(pl.Float64).fill_nan(None)
        found = table.select("time_s", figures).filter(pl.col(column) == pl.col(column).max()).first().collect()
    return found["time_s"].item() if len(found) else None


def _trajectories(before: Run, after: Run) -> Iterator[Comparison]:
    """Compares the coordinates of a run with those of its counterpart, as long as both last."""
    apart, since = 0.0, None
    for times, left, right in _coordinates(before, after):
        if left.shape != right.shape:
            return
        step = np.abs(right - left).max(axis=1, initial=0.0)
        step = np.where(np.isnan(step), np.inf, step)  # one of the two diverged here
        beyond = np.flatnonzero(step > APART.floor)
        since = float(times[beyond[0]]) if since is None and len(beyond) else since
        apart = max(apart, float(step.max(initial=0.0)))
    verdict = "same" if since is None else "changed"
    factor = max(apart, APART.floor) / APART.floor
    place = (after.case, after.name, APART.group, "qpos_apart_max", 0.0, apart)
    yield Comparison(verdict, *place, factor=factor, time_s=since, tolerance=APART.words, cause=APART.cause)


def _coordinates(before: Run, after: Run) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yields times and coordinates of both runs, in parts of ``CHUNK`` steps."""
    offset = 0
    while True:
        parts = []
        for run in (before, after):
            with run.folder.scanning(run.row["run"]) as table:
                parts.append(table.select("time_s", "qpos").slice(offset, CHUNK).collect())
        count = min(map(len, parts))
        if not count:
            return
        left, right = (_matrix(part["qpos"].head(count)) for part in parts)
        yield parts[1]["time_s"].head(count).to_numpy(), left, right
        offset += count


def _matrix(column: pl.Series) -> np.ndarray:
    """Returns a column of lists as an array (steps, nq). Steps without a list are NaN."""
    width = int(column.list.len().max() or 0)  # pyright: ignore[reportArgumentType]
    if not width:
        return np.full((len(column), 0), np.nan)
    return column.list.to_array(width).to_numpy().astype(float) if not column.null_count() else _gappy(column, width)


def _gappy(column: pl.Series, width: int) -> np.ndarray:
    return np.array([[math.nan] * width if entry is None else entry for entry in column.to_list()], dtype=float)


def compare_unmatched(runs: list[Run], side: Side, *, gone_from_here: bool) -> Iterator[Comparison]:
    """Compares runs that have no counterpart on ``side``, with the reason if the side knows it."""
    for run in runs:
        why, status = side.failure(run), run.row["status"]
        if why is not None:
            place = (run.case, run.name, "status", "status")
            ends = (status, why.status) if gone_from_here else (why.status, status)
            yield Comparison("worse" if gone_from_here else "better", *place, *ends, cause=str(why))
        else:
            ends = (status, None) if gone_from_here else (None, status)
            verdict = "disappeared" if gone_from_here else "appeared"
            yield Comparison(verdict, run.case, run.name, "run", "run", *ends)


# Gates.


def compare_gates(one: Side, other: Side, pairs: list[tuple[Run, Run]]) -> Iterator[Comparison]:
    """Compares the gates of both sides: whether they held, and whether their bounds are the same."""
    names = {(before.case, before.row["run"]): (after.case, after.row["run"]) for before, after in pairs}
    here, there = _by_gate(one, names), _by_gate(other, {})
    for key in dict.fromkeys((*here, *there)):
        (case, run), figure, where, _ = key
        place = (case, run or "", "gate", f"gate of {figure}" + (f" where {where}" if where else ""))
        was, became = here.get(key), there.get(key)
        held, holds = _held(was), _held(became)
        cause = (became or was or {}).get("cause", "")
        unknown = held in (None, "not checked") and holds in (None, "not checked")
        if unknown or (held == holds and _bounds(was) == _bounds(became)):
            yield Comparison("same", *place, held, holds, cause=cause)
        elif held == holds:
            yield Comparison("changed", *place, _bounds(was), _bounds(became), cause="the bound is another one")
        elif holds == "failed":
            yield Comparison("worse", *place, held, holds, cause=f"{worded((became or {})['value'])}; {cause}")
        elif held == "failed" and holds == "held":
            yield Comparison("better", *place, held, holds, cause=cause)
        else:
            gone = holds in (None, "not checked") and held == "held"
            verdict = "disappeared" if gone else "appeared" if holds == "held" else "changed"
            yield Comparison(verdict, *place, held, holds, cause=cause)


def _by_gate(side: Side, names: dict[tuple[str, str], tuple[str, str]]) -> dict[tuple[Any, ...], dict[str, Any]]:
    """Indexes gates by case and run (as the other side names them), figure, condition and number among equal ones."""
    found: dict[tuple[Any, ...], dict[str, Any]] = {}
    for case, gate in side.gates:
        place = names.get((case, gate["run"]), (case, gate["run"]))
        where = ", ".join(f"{key} = {value}" for key, value in sorted(gate["where"].items()))
        index = 0
        while (place, gate["figure"], where, index) in found:
            index += 1
        found[place, gate["figure"], where, index] = gate
    return found


def _held(gate: dict[str, Any] | None) -> str | None:
    return None if gate is None else {True: "held", False: "failed", None: "not checked"}[gate["held"]]


def _bounds(gate: dict[str, Any] | None) -> str:
    bounds = {key: gate.get(key) for key in ("min", "max", "equal")} if gate else {}
    return ", ".join(f"{key} {worded(value)}" for key, value in bounds.items() if value is not None)
