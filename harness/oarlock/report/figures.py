"""Figures of the report of a case, as pure functions of its tables."""

import itertools
import math
from typing import Any

import altair as alt
import numpy as np
import polars as pl

from oarlock.base.shapes import Shape
from oarlock.render.charts import (
    COLOURS,
    HEIGHT,
    VIEW,
    WIDTH,
    _significant,
    _time_axis,
    colour,
    envelope,
    log_axis,
    sampled,
)
from oarlock.render.solids import Outline, outlines

STRETCHES = 20_000
"""Rows that a table longer than ``LONG`` is condensed to before figures are drawn from it."""


LONG = 100_000
"""Maximum number of rows of a table that figures are drawn from as it is."""


TRACED = 4800
"""Points of all traces of a mechanism together. With many loops each is traced more coarsely."""


NAMED = 12
"""Maximum number of bodies in a legend."""


def condensed(steps: pl.LazyFrame, height: int) -> pl.DataFrame:
    """Condenses a long table to stretches of equal length, too short to show in a curve.

    Time and coordinates are those at the beginning of a stretch, iterations its mean. Of other figures, and of each row
    of the constraints, it is the largest magnitude, or NaN if the stretch has one, so that no peak and no gap is lost.

    Args:
        steps: the table, which needs the column ``step``.
        height: its number of rows.
    """
    if height <= LONG:
        return steps.collect()
    schema, kept, lists = steps.collect_schema(), [], []
    for name, kind in schema.items():
        column = pl.col(name)
        if name in ("time_s", "qpos"):
            kept.append(column.first())
        elif name == "iterations":
            kept.append(column.mean())
        elif kind == pl.List(pl.Float64):
            width = steps.select(column.first().list.len()).collect().item() or 0
            whole = pl.when(column.list.len() == width)
            entries = [whole.then(column.list.get(entry, null_on_oob=True)) for entry in range(width)]
            names = [f"{name} {entry}" for entry in range(width)]
            kept += [
                _largest(entry.otherwise(math.nan)).alias(name) for entry, name in zip(entries, names, strict=True)
            ]
            lists.append(pl.concat_list(names).alias(name))
        elif name != "step":
            kept.append(_largest(column))
    length = math.ceil(height / STRETCHES)
    block = length * max(1, LONG // length)
    blocks = [steps.slice(begin, block) for begin in range(0, height, block)]  # polars would group all of it in memory
    stretches = [rows.group_by(pl.col("step") // length).agg(kept).sort("step").collect() for rows in blocks]
    return pl.concat(stretches).with_columns(lists).select(schema.names())


def _largest(column: pl.Expr) -> pl.Expr:
    return column.abs().nan_max()


def columns_of(steps: pl.DataFrame, name: str) -> np.ndarray:
    """Returns a list column as an array (steps, entries). Rows of another length than the first are NaN."""
    lists = steps[name].to_list()
    width = len(lists[0]) if lists and lists[0] is not None else 0
    blank = [math.nan] * width
    return np.array([entry if entry is not None and len(entry) == width else blank for entry in lists], dtype=float)


def coordinates(
    runs: dict[str, pl.DataFrame], names: list[dict[str, str]], truth: tuple[str, pl.DataFrame] | None
) -> alt.TopLevelMixin:
    """Draws coordinates over time, one panel each. Coordinates that move like an earlier one are left out.

    ``names`` has the name and unit of every entry of qpos, ``truth`` the name of one of them and its true path.
    """
    paths = {who: columns_of(steps, "qpos") for who, steps in runs.items()}
    first = next(iter(paths.values()))
    shown: list[int] = []
    for index in range(first.shape[1]):
        if not any(np.allclose(first[:, index], first[:, other], atol=1e-3) for other in shown):
            shown.append(index)
    legend = [*runs, *(["truth"] if truth else [])]
    patterns = alt.Scale(domain=legend, range=[[1, 0], [8, 8], [2, 6]][: len(legend)])
    dash = alt.StrokeDash("who:N", title=None, scale=patterns, legend=alt.Legend(orient="top"))
    panels = []
    for index in shown:
        curves = {who: sampled(runs[who]["time_s"].to_numpy(), path[:, index]) for who, path in paths.items()}
        if truth and truth[0] == names[index]["name"]:
            curves["truth"] = sampled(truth[1]["time_s"].to_numpy(), truth[1]["position"].to_numpy())
        frame = pl.concat(_significant(curve).with_columns(who=pl.lit(who)) for who, curve in curves.items())
        panels.append(
            alt.Chart(frame, title=names[index]["name"])
            .mark_line(strokeWidth=2)
            .encode(
                x=_time_axis(),
                y=alt.Y("value:Q", title=names[index]["unit"]),
                color=colour(legend),
                strokeDash=dash,
            )
            .properties(width=WIDTH, height=110)
        )
    return alt.vconcat(*panels)


def over_time(runs: dict[str, pl.DataFrame], column: str, title: str, rule: float | None = None) -> alt.TopLevelMixin:
    """Draws the envelope of a column of the steps over time on a logarithmic axis, so that no peak is lost."""
    frames = []
    for who, steps in runs.items():
        kept = steps.filter(pl.col(column).is_not_null())
        if len(kept):
            frame = envelope(kept["time_s"].to_numpy(), kept[column].to_numpy())
            frames.append(_significant(frame).filter(pl.col("value") > 0).with_columns(who=pl.lit(who)))
    frame = pl.concat(frames)
    y = log_axis([*frame["value"], rule or math.nan], title)
    chart = alt.Chart(frame).mark_line(strokeWidth=1.5).encode(x=_time_axis(), y=y, color=colour(runs))
    if rule is not None:
        line = alt.Chart(pl.DataFrame({"value": [rule]})).mark_rule(strokeDash=[4, 4], color="#777").encode(y=y)
        return (chart + line).properties(width=WIDTH, height=HEIGHT)
    return chart.properties(width=WIDTH, height=HEIGHT)


def deviations(runs: dict[str, pl.DataFrame], rows: int, name: str, unit: str) -> alt.TopLevelMixin:
    """Draws the deviations of the first ``rows`` constraint rows, one panel per engine, on one logarithmic axis."""
    frames = []
    for who, steps in runs.items():
        residual = columns_of(steps, "residual")
        for row in range(min(rows, residual.shape[1])):
            frame = _significant(envelope(steps["time_s"].to_numpy(), residual[:, row], 250))
            frames.append(frame.with_columns(who=pl.lit(who), row=pl.lit(f"row {row + 1}")))
    floor = 1e-16  # below the rounding of a length of 1 m there is nothing to see
    frame = pl.concat(frames).with_columns(pl.col("value").clip(floor))
    y = log_axis(frame["value"], f"|deviation| ({unit})")
    colour = alt.Color("row:N", title=None, scale=alt.Scale(scheme="dark2"), legend=alt.Legend(orient="top"))
    panels = [
        alt.Chart(frame.filter(pl.col("who") == who), title=f"{name}: {who}")
        .mark_line(strokeWidth=1.3)
        .encode(x=_time_axis(), y=y, color=colour)
        .properties(width=WIDTH, height=130)
        for who in runs
    ]
    return alt.vconcat(*panels)


def iterations(steps: pl.DataFrame, counted: pl.DataFrame, paper: float | None) -> alt.TopLevelMixin:
    """Draws the mean iterations of stretches of a run beside the paper's mean, and how often each count occurred.

    ``counted`` has one row per number of ``iterations``, with ``len``, the number of solves that took it.
    """
    time, counts = steps["time_s"].to_numpy(), steps["iterations"].to_numpy().astype(float)
    edges = np.linspace(0, len(time), min(120, len(time)) + 1).astype(int)
    means = [counts[a:b].mean() for a, b in itertools.pairwise(edges)]
    frame = pl.DataFrame({"time": np.round(time[edges[:-1]], 9), "value": np.round(means, 6)})
    top = max(3.0, float(np.ceil(max(means))))
    y = alt.Y("value:Q", title="iterations a solve", scale=alt.Scale(domain=[0, top]))
    line = (
        alt.Chart(frame).mark_line(interpolate="step-after", color=COLOURS["exact (sr1)"]).encode(x=_time_axis(), y=y)
    )
    if paper is not None:
        mark = pl.DataFrame({"value": [paper], "text": [f"paper: {paper}"]})
        rule = alt.Chart(mark).mark_rule(strokeDash=[5, 4], color="#d95f02").encode(y=y)
        text = (
            alt.Chart(mark)
            .mark_text(align="right", dy=-7, color="#d95f02")
            .encode(y=y, text="text:N", x=alt.value("width"))
        )
        line = line + rule + text
    bars = counted.sort("iterations").select(count=pl.col("iterations").cast(pl.String), solves="len")
    histogram = (
        alt.Chart(bars)
        .mark_bar(color=COLOURS["exact (sr1)"])
        .encode(
            x=alt.X("count:O", title="iterations", axis=alt.Axis(labelAngle=0)),
            y=alt.Y("solves:Q", title="solves"),
        )
        .properties(width=120, height=HEIGHT)
    )
    return alt.hconcat(line.properties(width=WIDTH - 180, height=HEIGHT), histogram)


def _view(sketch: dict[str, Any]) -> np.ndarray:
    """Returns the usual projection (2, 3); for a mechanism in a coordinate plane, the one to that plane."""
    points = np.array([p for body in sketch["bodies"] for p in (body["hub"], *body["points"])], dtype=float)
    extent = np.ptp(points.reshape(-1, 3), axis=0)
    flat = extent <= 1e-6 * extent.max()
    return np.eye(3)[~flat] if flat.sum() == 1 else VIEW


def _solids(given: dict[str, Any] | None, view: np.ndarray) -> list[Outline]:
    """The geoms of a sketch, back to front; of one without them none."""
    if given is None:
        return []
    shapes = [Shape(**one) for one in given["shapes"]]
    meshes = [(np.array(points, dtype=float), np.array(faces, dtype=int)) for points, faces in given["meshes"]]
    return outlines(shapes, meshes, np.array(given["poses"], dtype=float), np.array([*view, np.cross(*view)]))


def mechanism(sketch: dict[str, Any]) -> alt.TopLevelMixin:
    """Draws the mechanism at its start, with the paths of the anchors of its loops."""
    view = _view(sketch)

    def project(points: list[list[float]]) -> np.ndarray:
        return np.round(np.array(points, dtype=float).reshape(-1, 3) @ view.T, 5)

    links, hubs = [], []
    for body in sketch["bodies"]:
        hub = project([body["hub"]])[0]
        hubs.append({"u": hub[0], "v": hub[1], "what": "joint on the ground" if body["grounded"] else "joint"})
        for point in project(body["points"]):
            links.append({"u": hub[0], "v": hub[1], "u2": point[0], "v2": point[1], "body": body["name"]})
    anchors = [{"u": p[0], "v": p[1], "what": "loop closed here"} for p in project(sketch["anchors"])]
    every = math.ceil(sum(map(len, sketch["traces"])) / TRACED) or 1
    trace = [
        {"u": p[0], "v": p[1], "order": order, "trace": str(number)}
        for number, points in enumerate(sketch["traces"])
        for order, p in enumerate(project(points[::every]))
    ]
    solids = _solids(sketch.get("solids"), view)
    everything = np.array([(p["u"], p["v"]) for p in [*hubs, *anchors, *trace]] + [(k["u2"], k["v2"]) for k in links])
    everything = np.concatenate([everything, *(one.points for one in solids if one.body)])
    low, high = everything.min(axis=0), everything.max(axis=0)
    margin = 0.05 * float((high - low).max() or 1.0)
    span = high - low + 2 * margin
    width = 520.0
    height = float(np.clip(width * span[1] / span[0], 120.0, 520.0))
    x = alt.X("u:Q", axis=None, scale=alt.Scale(domain=[low[0] - margin, high[0] + margin], nice=False))
    y = alt.Y("v:Q", axis=None, scale=alt.Scale(domain=[low[1] - margin, high[1] + margin], nice=False))
    layers = []
    if solids:
        table = [
            {"u": x, "v": y, "order": order, "part": number, "fill": one.colour}
            for number, one in enumerate(solids)
            for order, (x, y) in enumerate(np.round(one.points, 5).tolist())
        ]
        parts = alt.Chart(pl.DataFrame(table)).mark_line(
            filled=True, interpolate="linear-closed", stroke="#888", strokeWidth=0.5, fillOpacity=0.45
        )
        layers.append(
            parts.encode(x=x, y=y, order="order:Q", detail="part:N", fill=alt.Fill("fill:N", scale=None, legend=None))
        )
    if trace:
        path = alt.Chart(pl.DataFrame(trace)).mark_line(color="#999", strokeDash=[3, 3], strokeWidth=1)
        layers.append(path.encode(x=x, y=y, order="order:Q", detail="trace:N"))
    if links:
        legend = alt.Legend(orient="top") if len({link["body"] for link in links}) <= NAMED else None
        bodies = alt.Color("body:N", title=None, scale=alt.Scale(scheme="dark2"), legend=legend)
        rule = alt.Chart(pl.DataFrame(links)).mark_rule(strokeWidth=5, strokeCap="round", opacity=0.85)
        layers.append(rule.encode(x=x, y=y, x2="u2:Q", y2="v2:Q", color=bodies))
    marks = alt.Chart(pl.DataFrame([*hubs, *anchors])).mark_point(filled=True, size=80, opacity=1)
    forms = {"joint on the ground": "triangle-up", "joint": "circle", "loop closed here": "diamond"}
    kinds = [kind for kind in forms if any(mark["what"] == kind for mark in [*hubs, *anchors])]
    scale = alt.Scale(domain=kinds, range=[forms[kind] for kind in kinds])
    shape = alt.Shape("what:N", title=None, scale=scale, legend=alt.Legend(orient="top"))
    layers.append(marks.encode(x=x, y=y, shape=shape, color=alt.value("#222")))
    return alt.layer(*layers).resolve_scale(color="independent").properties(width=width, height=height)
