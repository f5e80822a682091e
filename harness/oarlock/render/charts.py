"""Parts of Altair charts that all figures share: colours, scales, axes, sampling."""

import math
from collections.abc import Iterable

import altair as alt
import numpy as np
import polars as pl

VIEW = np.array([[0.80, 0.60, 0.0], [-0.28, 0.37, 0.886]])
"""Parallel projection with z up: the rows are the screen's right and up in world coordinates."""


WIDTH, HEIGHT = 720, 180


SAMPLES = 400
"""Number of points of a curve. More would make the files large and show nothing new at this width."""


COLOURS = {
    "MuJoCo": "#d95f02",
    "MuJoCo default": "#d95f02",
    "MuJoCo stiff": "#e6ab02",
    "exact": "#1f78b4",
    "exact (pinv)": "#1f78b4",
    "exact (sr1)": "#6a3d9a",
    "truth": "#333333",
}


_SPARE = ["#1b9e77", "#e7298a", "#66a61e", "#a6761d"]


def colour(names: Iterable[str], title: str | None = None) -> alt.Color:
    """Makes a colour encoding by the field ``who``, in which an engine has the same colour in every figure."""
    domain = list(dict.fromkeys(names))
    spare = iter(_SPARE * len(domain))
    colours = [COLOURS.get(name) or next(spare) for name in domain]
    return alt.Color(
        "who:N", title=title, scale=alt.Scale(domain=domain, range=colours), legend=alt.Legend(orient="top")
    )


def log_scale(values: Iterable[float]) -> tuple[alt.Scale, alt.Axis]:
    """Makes a logarithmic scale over the values and at least two decades, with labels at powers of ten."""
    positive = [v for v in values if v and v > 0 and math.isfinite(v)]
    low = math.floor(math.log10(min(positive))) if positive else -1
    high = math.ceil(math.log10(max(positive))) if positive else 1
    high = max(high, low + 2)
    every = max(1, math.ceil((high - low) / 7))
    ticks = [10.0**power for power in range(low, high + 1, every)]
    scale = alt.Scale(type="log", domain=[10.0**low, 10.0**high], nice=False, clamp=True)
    return scale, alt.Axis(values=ticks, format=".0e")


def log_axis(values: Iterable[float], title: str) -> alt.Y:
    """Makes a logarithmic axis for the field ``value``."""
    scale, axis = log_scale(values)
    return alt.Y("value:Q", title=title, scale=scale, axis=axis)


def _time_axis() -> alt.X:
    return alt.X("time:Q", title="time (s)", axis=alt.Axis(grid=False, tickCount=12, labelOverlap=True))


def envelope(time: np.ndarray, values: np.ndarray, samples: int = SAMPLES) -> pl.DataFrame:
    """Reduces values (n) to the largest magnitude in each of ``samples`` equal parts, so that no peak is lost."""
    edges = np.linspace(0, len(time), min(samples, len(time)) + 1).astype(int)[:-1]
    return pl.DataFrame({"time": np.round(time[edges], 9), "value": np.maximum.reduceat(np.abs(values), edges)})


def sampled(time: np.ndarray, values: np.ndarray, samples: int = SAMPLES) -> pl.DataFrame:
    """Reduces values (n) of a smooth curve to those at equally spaced steps, including the first and the last."""
    index = np.unique(np.linspace(0, len(time) - 1, min(samples, len(time))).astype(int))
    return pl.DataFrame({"time": np.round(time[index], 9), "value": values[index]})


def _significant(frame: pl.DataFrame) -> pl.DataFrame:
    """Rounds values to six digits, more than a figure shows, so that its file is stable when the last bit moves.

    NaN becomes null, a gap in the curve, because JSON has no NaN.
    """
    return frame.with_columns(pl.col("value").fill_nan(None).round_sig_figs(6))
