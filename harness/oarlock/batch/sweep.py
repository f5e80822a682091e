"""``--sweep key=a:b:n``: the points of a sweep, what is run at each of them, and the table that comes of it."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from oarlock.base.errors import InputError
from oarlock.base.files import write_text
from oarlock.base.options import Number
from oarlock.batch.unit import Unit, units_at
from oarlock.cases.case import Case
from oarlock.cases.point import KEYS, SEED, SOLREF, TIMESTEP, Point
from oarlock.experiments.task import Task
from oarlock.stepping.solvers import MUJOCO, SolverSpec
from oarlock.tables.ledger import Failure, Ledger

MAX_UNITS = 1000
"""Runs of a model at most."""


DIGITS = 6
"""Significant digits of the values between the first and the last: a point has a short name."""


_WHOLE = 2**53


_EXPECTED = f"expected key=a:b:n, n points from a to b, such as {TIMESTEP}=5e-4:4e-3:4"


@dataclass(frozen=True)
class Axis:
    """What is swept: ``count`` values from ``first`` to ``last``, both included."""

    key: str
    first: float
    last: float
    count: int

    @property
    def geometric(self) -> bool:
        """Whether each value is a multiple of the one before, instead of a sum."""
        return self.key in (TIMESTEP, SOLREF)

    def document(self) -> dict[str, Any]:
        """For the summary JSON."""
        return {**asdict(self), "spacing": "geometric" if self.geometric else "linear"}

    @property
    def text(self) -> str:
        """As it is asked for."""
        return f"{self.key}={self.first:g}:{self.last:g}:{self.count}"

    def values(self, *, whole: bool) -> list[Number]:
        """The values; whole numbers are rounded, and each is there once.

        Raises:
            InputError: whole numbers are wanted, and an end is none.
        """
        low, high = sorted((self.first, self.last))
        if whole:
            if not all(end.is_integer() and abs(end) <= _WHOLE for end in (low, high)):
                raise InputError(f"--sweep '{self.text}': {self.key} is a whole number, expected whole numbers")
            return list(dict.fromkeys(round(value) for value in np.linspace(self.first, self.last, self.count)))
        spaced = np.geomspace if self.geometric else np.linspace
        inner = [float(f"{value:.{DIGITS}g}") for value in spaced(self.first, self.last, self.count)[1:-1]]
        return list(dict.fromkeys([self.first, *(min(max(value, low), high) for value in inner), self.last]))


def parse_axes(texts: Sequence[str]) -> tuple[Axis, ...]:
    """What is swept, sorted by key, so that a sweep of several is the same in any order.

    Raises:
        InputError: not of the form key=a:b:n, a key that is there twice, or numbers that make no points.
    """
    axes = [_axis(text) for text in texts]
    keys = [axis.key for axis in axes]
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(f"--sweep {key} is given twice, expected one range a key")
    return tuple(sorted(axes, key=lambda axis: axis.key))


def _axis(text: str) -> Axis:
    key, equals, rest = (part.strip() for part in text.partition("="))
    parts = rest.split(":")
    if not key or not equals or len(parts) != 3:
        raise InputError(f"--sweep '{text}', {_EXPECTED}")
    try:
        first, last, count = float(parts[0]), float(parts[1]), int(parts[2])
    except ValueError:
        raise InputError(f"--sweep '{text}', {_EXPECTED}") from None
    if not math.isfinite(last - first):
        raise InputError(f"--sweep '{text}', expected finite numbers")
    if not 1 <= count <= MAX_UNITS:
        raise InputError(f"--sweep '{text}': {count} points, expected 1 to {MAX_UNITS}")
    if (first == last) != (count == 1):
        some = "1 point" if count == 1 else f"{count} points"
        raise InputError(f"--sweep '{text}': {some} from {first:g} to {last:g}, expected 1 where they are the same")
    axis = Axis(key, first, last, count)
    if axis.geometric and min(first, last) <= 0:
        raise InputError(f"--sweep '{text}': {key} in s, expected numbers > 0, which are spaced geometrically")
    if key == SEED:
        axis.values(whole=True)
        if min(first, last) < 0:
            raise InputError(f"--sweep '{text}', expected seeds ≥ 0")
    return axis


def missing(case: Case, axes: Sequence[Axis]) -> list[str]:
    """Swept parameters that a case does not have."""
    return [axis.key for axis in axes if axis.key not in (*KEYS, *case.parameters)]


def same_swept(case: Case, axes: Sequence[Axis]) -> tuple[Any, ...]:
    """What tells the sweeps of two cases apart: variants may differ in nothing but what is swept."""
    swept = [axis.key for axis in axes]
    return case.model, *(item for item in case.parameters.items() if item[0] not in swept)


def folder_name(axes: Sequence[Axis]) -> str:
    """The folder of a sweep within that of its case: one for each set of keys."""
    return "-".join(["sweep", *(axis.key for axis in axes)])


def tasks_of(case: Case) -> list[Task]:
    """What is run at every point: MuJoCo as it is and the case's own solvers on exact constraints, each freely.

    Those solvers are what the case's free runs on exact constraints name, ``auto`` if there are none.

    Raises:
        InputError: an unknown solver, or an option that it does not have.
    """
    experiments = case.file.experiments if "experiments" in case.file.model_fields_set else []
    free = [experiment for experiment in experiments if experiment.mode == "free" and "hard" in experiment.forms]
    named = dict.fromkeys(SolverSpec.parse(text) for experiment in free for text in experiment.solvers)
    ours = [solver for solver in named if solver.name != MUJOCO] or [SolverSpec("auto")]
    run = case.file.run
    return [
        Task("free", SolverSpec(MUJOCO), ("hard",), (solver,), run.integrator, "default", run.stabilisation)
        for solver in (SolverSpec(MUJOCO), *ours)
    ]


def plan_sweep(asked: str, case: Case, axes: Sequence[Axis], tasks: Sequence[Task]) -> list[Unit]:
    """The tasks at every point.

    Raises:
        InputError: too many runs, or a fraction where a parameter is a whole number.
    """
    whole = {SEED, *(key for key, value in case.parameters.items() if isinstance(value, int) and key not in KEYS)}
    ranges = [axis.values(whole=axis.key in whole) for axis in axes]
    runs = math.prod(map(len, ranges)) * len(tasks)
    if runs > MAX_UNITS:
        raise InputError(f"the sweep of '{case.name}' has {runs:,} runs, expected at most {MAX_UNITS:,}")
    keys = [axis.key for axis in axes]
    points = [Point(tuple(zip(keys, values, strict=True))) for values in itertools.product(*ranges)]
    return units_at(asked, case, points, tasks)


def sweep_document(
    ledger: Ledger, units: Sequence[Unit], case: Case, axes: Sequence[Axis], provenance: dict[str, Any]
) -> dict[str, Any]:
    """The summary JSON of a sweep: what was swept, a row a finished run with its point, and what was not done."""
    done = [unit for unit in units if ledger.finished(unit.name, unit.digest)]
    failures = ledger.failures()
    return {
        "provenance": provenance,
        "title": case.file.title,
        "run": case.file.run.model_dump(),
        "sweep": [axis.document() for axis in axes],
        "runs": [row for unit in done for row in ledger.entries[unit.name]["rows"]],
        "gates": [],
        "failures": [
            {
                "unit": unit.name,
                "run": unit.runs[0],
                "point": dict(unit.point.values),
                "message": str(failures[unit.name]),
            }
            for unit in units
            if unit.name in failures
        ],
    }


def write_table(document: dict[str, Any], failures: dict[str, Failure], path: Path) -> None:
    """Writes the summary JSON as CSV: the point in the first columns, then the run's summary; what failed comes last.

    Raises:
        InputError: it cannot be written.
    """
    rows = [flat(row["point"], row) for row in document["runs"]]
    for failure in document["failures"]:
        why = failures[failure["unit"]]
        rows.append(flat(failure["point"], {"run": failure["run"], "status": why.status, "message": why.message}))
    text = pl.DataFrame(rows, infer_schema_length=None).write_csv()
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        write_text(path, text)


def flat(point: dict[str, Number], row: dict[str, Any]) -> dict[str, Any]:
    """A row with its point in front of the summary of its run."""
    rest = {key: value for key, value in row.items() if key != "point"}
    # A parameter may have the name of a column.
    return {**{f"swept {key}" if key in rest else key: value for key, value in point.items()}, **rest}
