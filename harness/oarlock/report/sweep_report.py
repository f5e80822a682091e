"""The page of a sweep, as a pure function of its folder. Times are in index.html only, as in the other reports."""

import json
from pathlib import Path
from typing import Any

import altair as alt
import polars as pl

from oarlock.base.errors import InputError
from oarlock.base.files import write_text
from oarlock.cases.point import DISTURBANCE
from oarlock.render.charts import WIDTH, colour, log_axis, log_scale
from oarlock.render.page import Figure, drawable, page
from oarlock.render.template import render
from oarlock.tables.figures import shown
from oarlock.tables.folder import OCCASION, ResultFolder, occasion_of
from oarlock.tables.ledger import TABLE

PANELS = {
    "drift_pos_max": "drift (m or rad)",
    "truth_error_max": "from truth (m or rad)",
    "min_norm_error_max": "min-norm error",
    "iterations_mean": "iterations a solve",
}
"""Figure of the summary → title of its panel. A panel without values is left out."""

LABELLED = 12
"""Maximum number of values that an axis labels one by one; with more it labels round numbers."""

TIME = "time"
_TIMED = {TIME: "time a simulated second (µs)"}


def who(row: dict[str, Any]) -> str:
    """Returns the name of the engine of a run, as in the other figures."""
    return "MuJoCo default" if row["solver"] == "mujoco" else f"exact ({row['solver']})"


def chart(rows: list[dict[str, Any]], axis: dict[str, Any], panels: dict[str, str]) -> alt.TopLevelMixin | None:
    """Draws figures of the summary against one swept key, one panel each; None if there is nothing to draw.

    Runs that diverged are left out. With more than one key there is a curve for every value of the others.
    """
    key, geometric = axis["key"], axis["spacing"] == "geometric"
    frame = pl.DataFrame(
        [
            {
                "x": float(row["point"][key]),
                "value": float(value),
                "who": who(row),
                "rest": ",".join(f"{k}={v}" for k, v in row["point"].items() if k != key),
                "panel": panel,
            }
            for panel in panels
            for row in rows
            if row["status"] != "diverged" and (value := row[panel])
        ]
    )
    if frame.is_empty():
        return None
    frame = frame.with_columns(pl.col("value").round_sig_figs(6))
    if geometric:
        scale, ticks = log_scale(frame["x"])
    else:
        values = sorted({float(row["point"][key]) for row in rows})
        ends = [values[0], values[-1]] if len(values) > 1 else alt.Undefined
        scale = alt.Scale(domain=ends, zero=False, nice=False, padding=10)
        ticks = alt.Axis(values=values if len(values) <= LABELLED else alt.Undefined, format="~g", grid=False)
    engines = list(dict.fromkeys(frame["who"]))
    widths = [max(1.5, 6.0 - 1.5 * index) for index in range(len(engines))]  # a curve on another leaves it visible
    drawn = []
    for panel in dict.fromkeys(frame["panel"]):
        some = frame.filter(pl.col("panel") == panel)
        title = f"{key} (s)" if geometric else key
        base = alt.Chart(some).encode(
            x=alt.X("x:Q", title=title, scale=scale, axis=ticks),
            y=log_axis(some["value"], panels[panel]),
            color=colour(engines),
            detail="rest:N",
        )
        width = alt.StrokeWidth("who:N", scale=alt.Scale(type="ordinal", domain=engines, range=widths), legend=None)
        marks = base.mark_point(filled=True, size=35, opacity=0.9)
        if key != "seed":  # there is nothing between two of them
            marks = base.mark_line(opacity=0.7).encode(strokeWidth=width) + marks
        drawn.append(marks.properties(width=WIDTH, height=150))
    return alt.vconcat(*drawn)


def _timed(row: dict[str, Any]) -> dict[str, Any]:
    step_us = row["step_us_median"]
    return {**row, TIME: None if step_us is None else step_us / row["timestep_s"]}


def write_sweep_report(results: Path, target: Path) -> Path:
    """Writes README.md, figures/*.svg and index.html of a sweep.

    Args:
        results: folder of the sweep.
        target: folder of the page.

    Raises:
        InputError: the results are damaged, or the target cannot be written.
    """
    document = ResultFolder(results).read_json("summary.json")
    try:
        rows, axes = [{"who": who(row), **row} for row in document["runs"]], document["sweep"]
        inputs = {key: value for key, value in document["provenance"].items() if key not in OCCASION}
    except (KeyError, TypeError):
        raise InputError(f"'{results / 'summary.json'}' is not the summary of a sweep") from None
    tracked, timed = [], []
    for axis in axes:
        caption = f"Largest values of each run against {axis['key']}. Runs that diverged are left out."
        more = "What a second of motion takes on this machine, everything that is recorded included."
        found = chart(rows, axis, PANELS)
        tracked += [Figure(axis["key"], caption, found)] if found else []
        found = chart([_timed(row) for row in rows], axis, _TIMED)
        timed += [Figure(f"{axis['key']}-time", more, found)] if found else []
    tracked, timed = drawable(tracked), drawable(timed)
    small = [
        row for row in rows if row["solver"] == "mujoco" and 0 < row["point"].get("solref", 0) < 2 * row["timestep_s"]
    ]
    text = render(
        "sweep.md.j2",
        document=document,
        rows=rows,
        axes=axes,
        inputs=inputs,
        figures=tracked,
        disturbance=DISTURBANCE,
        clipped=bool(small),
        table=TABLE,
        shown=shown("sweep"),
    )
    for figure in tracked:
        write_text(target / "figures" / f"{figure.name}.svg", figure.svg())
    write_text(target / "README.md", text)
    more = "".join(f"\n![{figure.name}](figures/{figure.name}.svg)\n\n*{figure.caption}*\n" for figure in timed)
    html = page(document["title"], text + more, [*tracked, *timed], occasion_of(document["provenance"]))
    write_text(target / "index.html", html)
    write_text(target / "provenance.json", json.dumps(document["provenance"], indent=1) + "\n")
    return target
