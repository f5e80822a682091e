"""Figures over many cases, as Altair charts."""

import math
from typing import Any

import altair as alt
import polars as pl

from oarlock.cases.integrators import INTEGRATORS
from oarlock.render.charts import colour, log_scale

SOLVERS = {"sr1": "sr1", "sr1-tracked": "sr1-tracked", "MuJoCo CG": "cg", "MuJoCo PGS": "pgs"}
"""Solvers whose iterations are compared: name → settings or solver of the run."""

ENGINES = {"MuJoCo default": "default", "MuJoCo stiff": "stiff", "exact": "exact"}

FLOOR = 0.01
"""Lower bound of drawn iterations, because zero has no logarithm."""

WIDTH = 560


def _significant(rows: list[dict[str, Any]]) -> pl.DataFrame:
    """Rounds values to six digits, as in the figures of one case."""
    return pl.DataFrame(rows).with_columns(pl.col(pl.Float64).round_sig_figs(6))


def _dots(frame: pl.DataFrame, who: list[str], title: str) -> alt.Chart:
    """Draws one row per case and one dot per engine on a logarithmic axis."""
    scale, axis = log_scale(frame["value"])
    order = list(dict.fromkeys(frame["case"]))
    return (
        alt.Chart(frame)
        .mark_point(filled=True, size=70, opacity=0.9)
        .encode(
            x=alt.X("value:Q", title=title, scale=scale, axis=axis),
            y=alt.Y("case:N", title=None, sort=order, axis=alt.Axis(grid=True, labelLimit=220)),
            color=colour(who),
            shape=alt.Shape("who:N", title=None, scale=alt.Scale(domain=who), legend=alt.Legend(orient="top")),
        )
        .properties(width=WIDTH, height=alt.Step(17))
    )


def drift(cases: dict[str, dict[str, float | None]]) -> alt.TopLevelMixin:
    """Draws the largest drift of every case: MuJoCo default, MuJoCo stiff, exact."""
    rows = [
        {"case": case, "who": who, "value": value}
        for case, drifts in cases.items()
        for who, key in ENGINES.items()
        if (value := drifts[key])
    ]
    return _dots(_significant(rows), list(ENGINES), "largest drift (m or rad)")


def iterations(cases: dict[str, dict[str, tuple[float, bool]]]) -> alt.TopLevelMixin:
    """Draws the mean iterations per solve of every case. A value comes with whether to draw it pale."""
    rows = [
        {"case": case, "who": who, "value": max(float(counts[key][0]), FLOOR), "pale": counts[key][1]}
        for case, counts in cases.items()
        for who, key in SOLVERS.items()
        if key in counts
    ]
    chart = _dots(_significant(rows), list(SOLVERS), "iterations a solve (mean)")
    pale = alt.Opacity("pale:N", scale=alt.Scale(domain=[False, True], range=[0.9, 0.25]), legend=None)
    return chart.encode(opacity=pale)


def work(cases: dict[str, list[dict[str, Any]]], against: str) -> alt.TopLevelMixin:
    """Draws the distance from the truth against ``solves`` or ``time``.

    There is one panel per case and one curve per engine and integrator.
    """
    rows = []
    for case, runs in cases.items():
        for run in runs:
            spent = _work(run, against)
            if run["status"] == "diverged" or not run["truth_error_max"] or spent is None:
                continue
            who = f"MuJoCo {run['settings']}" if run["solver"] == "mujoco" else f"exact ({run['solver']})"
            rows.append(
                {"case": case, "who": who, "by": run["integrator"], "work": spent, "value": run["truth_error_max"]}
            )
    if not rows:
        return alt.layer()
    frame = _significant(rows)
    x_scale, x_axis = log_scale(frame["work"])
    y_scale, y_axis = log_scale(frame["value"])
    title = {"solves": "solves a simulated second", "time": "time a simulated second (µs)"}[against]
    engines = list(dict.fromkeys(frame["who"]))
    widths = [6.0, *[1.8] * (len(engines) - 1)]  # a curve on the first one leaves it visible
    base = alt.Chart().encode(
        x=alt.X("work:Q", title=title, scale=x_scale, axis=x_axis),
        y=alt.Y("value:Q", title="distance from the truth", scale=y_scale, axis=y_axis),
        color=colour(engines),
    )
    lines = base.mark_line().encode(
        strokeDash=alt.StrokeDash("by:N", title=None, legend=alt.Legend(orient="top")),
        strokeWidth=alt.StrokeWidth(
            "who:N", scale=alt.Scale(type="ordinal", domain=engines, range=widths), legend=None
        ),
    )
    marks = lines + base.mark_point(filled=True, size=30, opacity=1)
    panels = [
        marks.properties(data=frame.filter(pl.col("case") == case), title=case, width=210, height=230)
        for case in dict.fromkeys(frame["case"])
    ]
    return alt.hconcat(*panels)


def _work(run: dict[str, Any], against: str) -> float | None:
    """Computes the solves, or the microseconds, that a simulated second takes."""
    if against == "solves":
        return INTEGRATORS[run["integrator"]].stages / run["timestep_s"]
    step_us = run["step_us_median"]
    return None if step_us is None or not math.isfinite(step_us) else step_us / run["timestep_s"]
