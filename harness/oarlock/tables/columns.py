"""Columns of figures, as both paths collect them, and the table of steps that they become."""

from typing import Any

import numpy as np
import polars as pl

from oarlock.tables.schema import SCHEMA

_LIST = pl.List(pl.Float64)


def steps_table(columns: dict[str, Any], height: int) -> pl.DataFrame:
    """The table of so many steps; a column that is missing is null throughout.

    A column is a list or an array with an entry a row. NaN stands for nothing in one that comes as ("nullable", array),
    −1 in an array of ranks. Words can come as (the different ones, a place among them a row), lists of numbers come as
    (all numbers, numbers of each row).
    """
    series = {name: _series(name, column) for name, column in columns.items()}
    unknown = pl.Series([None]).new_from_index(0, height)
    return pl.DataFrame({name: series.get(name, unknown).cast(kind) for name, kind in SCHEMA.items()})


def _series(name: str, column: Any) -> pl.Series:
    if isinstance(column, tuple) and isinstance(column[0], str):
        return pl.Series(column[1], nan_to_null=True)
    if isinstance(column, tuple) and isinstance(column[0], list):
        words, places = column
        return pl.Series(words).gather(places)
    if isinstance(column, tuple):
        return _lists(*column)
    series = pl.Series(column, dtype=SCHEMA[name], strict=False)
    return series.set(series == -1, None) if name == "rank" and isinstance(column, np.ndarray) else series


def _lists(values: np.ndarray, lengths: np.ndarray) -> pl.Series:
    """Rows of all numbers, of the given lengths."""
    # Where the number of rows of the constraints changes, a stretch of equal lengths ends.
    starts = np.flatnonzero(np.diff(lengths, prepend=lengths[0] + 1))
    stretches, at = [], 0
    for start, stop in zip(starts, [*starts[1:], len(lengths)], strict=True):
        width, count = int(lengths[start]), int(stop - start)
        part = pl.Series(values[at : at + width * count])
        at += width * count
        if width:
            stretches.append(part.reshape((count, width)).cast(_LIST))
        else:
            stretches.append(pl.Series([[]], dtype=_LIST).extend_constant([], count - 1))
    return pl.concat(stretches)
