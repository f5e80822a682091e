"""How the steps of a run become one number of its summary. A number that does not apply is None."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from oarlock.base.numbers import finite

if TYPE_CHECKING:
    from oarlock.tables.spool import Spool

Number = float | int | None
"""A JSON number, or None."""


@dataclass(frozen=True)
class Reduction:
    """What is asked of the steps, in one pass with what all others ask, and what is made of the answers.

    Attributes:
        ask: expressions, each of one value.
        make: called with their values, in this order.
    """

    ask: tuple[pl.Expr, ...]
    make: Callable[..., Number] = finite


Alone = Callable[["Spool"], Number]
"""A reduction that goes through the steps by itself."""


def largest(column: str) -> Reduction:
    """The largest entry."""
    return Reduction((pl.col(column).max(),))


def smallest(column: str) -> Reduction:
    """The smallest entry."""
    return Reduction((pl.col(column).min(),))


def time_of_first(column: str) -> Reduction:
    """When the column was first more than zero, s."""
    return Reduction((pl.col("time_s").filter(pl.col(column) > 0).first(),))


def total(column: str) -> Reduction:
    """The sum; 0 of nothing."""
    return Reduction((pl.col(column).sum(),), int)


def total_if_any(column: str) -> Reduction:
    """The sum, where there is anything."""
    summed = pl.col(column).sum(), pl.col(column).count()
    return Reduction(summed, lambda found, count: int(found) if count else None)


def total_after_first(column: str) -> Reduction:
    """The sum, where there is anything, without one of the first step's, if it has any."""
    summed = pl.col(column).sum(), pl.col(column).first(), pl.col(column).count()
    return Reduction(summed, lambda found, first, count: int(found) - int((first or 0) > 0) if count else None)


def ratio(column: str, over: str) -> Reduction:
    """The sum over the sum of another column."""
    return Reduction((pl.col(column).sum(), pl.col(over).sum()), _over)


def slope(column: str, over: str, where: pl.Expr) -> Reduction:
    """How much more of a whole number one more of another takes, by least squares over the steps where it is so."""
    x, y = (pl.col(name).filter(where & pl.col(column).is_not_null()) for name in (over, column))
    return Reduction((x.len(), x.sum(), y.sum(), (x * x).sum(), (x * y).sum()), _slope)


def ratio_where(column: str, over: str) -> Reduction:
    """The sum over the sum of another column, both of the steps that have the first."""
    return Reduction((pl.col(column).sum(), pl.col(over).filter(pl.col(column).is_not_null()).sum()), _over)


def mean(column: str) -> Reduction:
    """The mean of the steps that have it."""
    return Reduction((pl.col(column).sum(), pl.col(column).count()), _over)


def others(column: str, word: str) -> Reduction:
    """How many steps have another word than this one, where there is any."""
    counted = (pl.col(column) != word).sum(), pl.col(column).count()
    return Reduction(counted, lambda found, count: int(found) if count else None)


def median(figure: pl.Expr) -> Alone:
    """The median of the steps that have the figure. It needs a whole column, and holds nothing else."""

    def of(steps: "Spool") -> Number:
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

    return of


def change(column: str, scale: str) -> Alone:
    """The largest change of a column since the first step, relative to the largest entry of another."""

    def of(steps: "Spool") -> Number:
        column_first = pl.col(column).first()
        start, most = steps.collect(column_first, pl.col(scale).fill_null(math.nan).nan_max()).row(0)
        if start is None or not most:
            return None
        drift = steps.collect((pl.col(column) - start).abs().fill_null(math.nan).nan_max()).item()
        return finite(drift / most)

    return of


def _over(found: float, count: float) -> float | None:
    return found / count if count else None


def _slope(count: int, x: int, y: int, xx: int, xy: int) -> float | None:
    spread = count * xx - x * x
    return (count * xy - x * y) / spread if spread else None
