"""Tables of steps from what either path gives: columns of the compiled core, or rows as dictionaries."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import polars as pl

from oarlock.base import core
from oarlock.base.errors import InputError
from oarlock.tables.figures import COLUMNS, DTYPES, Walk
from oarlock.tables.schema import SCHEMA

_KINDS = {column.name: column.kind for column in COLUMNS}


def require_columns(walk: Walk, given: Iterable[str]) -> None:
    """Checks that the rows of a walk have the columns that the table of figures lists for it.

    Raises:
        InputError: one is missing, or one is not listed.
    """
    names = set(given)
    listed = {column.name for column in COLUMNS if walk in column.walks}
    needed = {column.name for column in COLUMNS if walk in column.walks and not column.optional}
    wrong = [f"has no column '{name}'" for name in sorted(needed - names)]
    wrong += [f"has a column '{name}'" for name in sorted(names - listed)]
    if wrong:
        raise InputError(
            f"a table of a {walk} walk {' and '.join(wrong)}, expected what tables/figures.py lists: "
            "was the core built from another version?"
        )


def table_of_rows(walk: Walk, rows: list[dict[str, Any]]) -> pl.DataFrame:
    """The table of rows, {column: entry}; what is missing in a row is null.

    Raises:
        InputError: as ``require_columns``.
    """
    if rows:
        require_columns(walk, set().union(*rows))
    return pl.DataFrame(rows, schema=SCHEMA)


def table_of_columns(walk: Walk, columns: Mapping[str, core.Column | pl.Series], height: int) -> pl.DataFrame:
    """The table of so many rows, from columns of the compiled core and others.

    Raises:
        InputError: as ``require_columns``, or a column is of another kind than listed.
    """
    if not height:
        return pl.DataFrame(schema=SCHEMA)
    require_columns(walk, columns)
    series = {
        name: column if isinstance(column, pl.Series) else _series(name, column) for name, column in columns.items()
    }
    unknown = pl.Series([None]).new_from_index(0, height)
    return pl.DataFrame({name: series.get(name, unknown).cast(kind) for name, kind in SCHEMA.items()})


def _series(name: str, column: core.Column) -> pl.Series:
    if column.kind != _KINDS[name]:
        raise InputError(f"column '{name}' of the core is of kind {column.kind}, expected {_KINDS[name]}")
    if column.kind == "text":
        return pl.Series(column.words).gather(column.values)
    if column.lengths is not None:
        return _lists(column.values, column.lengths)
    series = pl.Series(column.values)
    return series if column.missing is None else series.set(pl.Series(column.missing), None)


def _lists(values: np.ndarray, lengths: np.ndarray) -> pl.Series:
    """Rows of all numbers, of the given lengths."""
    # Where the number of rows of the constraints changes, a stretch of equal lengths ends.
    starts = np.flatnonzero(np.diff(lengths.astype(int), prepend=int(lengths[0]) + 1))
    stretches, at = [], 0
    for start, stop in zip(starts, [*starts[1:], len(lengths)], strict=True):
        width, count = int(lengths[start]), int(stop - start)
        part = pl.Series(values[at : at + width * count])
        at += width * count
        if width:
            stretches.append(part.reshape((count, width)).cast(DTYPES["list"]))
        else:
            stretches.append(pl.Series([[]], dtype=DTYPES["list"]).extend_constant([], count - 1))
    return pl.concat(stretches)
