"""The report of a case, as a pure function of its folder of results.

The tracked part (README.md and the SVG figures) holds physical figures and what they were computed from. Timings, date
and commit go to ``timings.json``, ``provenance.json`` and the HTML page, which are not tracked, so that regenerating a
report on the same machine and versions leaves the tracked files as they were.
"""

import json
from pathlib import Path
from typing import Any

import polars as pl

from oarlock.base.files import write_text
from oarlock.render.folder import CONTENTS, require_report, write_whole
from oarlock.render.page import Figure, drawable, page
from oarlock.render.template import render
from oarlock.report import figures
from oarlock.report.costs import Costs, times_of_reference
from oarlock.report.glance import lights, sentence
from oarlock.report.statements import Compared, statements
from oarlock.report.tables import Tables
from oarlock.tables.figures import TIMING_FIGURES, shown
from oarlock.tables.folder import OCCASION, ResultFolder, believing, occasion_of

FOLDED = ("Gates", "Runs", "Solves", "What a solve costs")
"""Sections that the page shows where they are asked for."""

PUSHING = {
    "limit_force": ("largest force of a limit (N or N m)", "The largest force of a limit."),
    "friction_force": ("largest force of a friction loss (N or N m)", "The largest force of a friction loss."),
    "contact_force": (
        "sum of the normal forces (N)",
        "The normal forces of all contacts together. Limits, friction and contacts are the same for both: what differs "
        "is the softness of the loops.",
    ),
    "active": ("rows that push", "How many rows of limits, friction loss and contacts push with exact loops."),
}
"""Column of the steps → title of its axis, and what the figure shows."""


def draw(tables: Tables) -> list[Figure]:
    """Draws the figures that the runs of a folder allow."""
    drawn = [
        Figure(
            "mechanism",
            "The mechanism at its start, joints over geoms; dashed: the paths of the points where its loops close.",
            figures.mechanism(tables.sketch),
        )
    ]
    columns = ("time_s", "qpos", "truth_error", "residual", *PUSHING)
    free = {who: tables.steps(row, *columns) for who, row in tables.free_runs().items()}
    pair = {who: free[who] for who in ("MuJoCo default", "exact (pinv)") if who in free}
    if pair:
        joint = (tables.case["truth"] or {}).get("joint")
        truth = (joint, tables.folder.read_truth()) if joint else None
        chart = figures.coordinates(pair, tables.case["model"]["coordinates"], truth)
        caption = (
            "Coordinates over time; those that move as an earlier one are left out. Where the curves lie on one "
            "another, the next figure tells them apart."
        )
        drawn.append(Figure("coordinates", caption, chart))
    if free and tables.knows_truth:
        what = tables.case["truth"]["joint"] or tables.case["truth"]["site"]
        chart = figures.over_time(free, "truth_error", f"|{what} − truth|")
        drawn.append(Figure("truth", "Distance from the outside truth.", chart))
    if free:
        # Those of a flex, which is never active in a run, are not known.
        equality = next(one for one in tables.case["model"]["equalities"] if one["rows"])
        chart = figures.deviations(free, equality["rows"], equality["name"], equality["unit"])
        caption = f"Deviations of the constraint rows of '{equality['name']}': how far the loop stands open."
        drawn.append(Figure("deviations", caption, chart))
    drawn += _pushing(free)
    iterating = tables.pick(mode="lockstep", form="hard", walker="pinv", solver="sr1")
    if iterating:
        steps = tables.steps(iterating, "time_s", "iterations", "min_norm_error")
        paper = (tables.case["paper"] or {}).get("iterations_mean")
        caption = "Iterations of sr1 along the exact trajectory, one solve a step: means of stretches, and all counts."
        drawn.append(
            Figure("iterations", caption, figures.iterations(steps, tables.counted(iterating, "iterations"), paper))
        )
        caption = "Distance of sr1's multipliers from the minimum-norm ones, relative, at the same states."
        chart = figures.over_time({"exact (sr1)": steps}, "min_norm_error", "‖λ − A⁺b‖ / ‖A⁺b‖")
        drawn.append(Figure("min_norm", caption, chart))
    return drawn


def _pushing(free: dict[str, pl.DataFrame]) -> list[Figure]:
    """Forces of limits, friction loss and contacts over time, and how many rows of them push."""
    drawn = []
    for column, (title, caption) in PUSHING.items():
        acting = {who: steps for who, steps in free.items() if (steps[column].fill_null(0) > 0).any()}
        if acting:
            drawn.append(Figure(column, caption, figures.over_time(acting, column, title)))
    return drawn


def markdown(tables: Tables, drawn: list[Figure]) -> str:
    """Renders the tracked page."""
    inputs = {key: value for key, value in tables.provenance.items() if key not in OCCASION}
    compared = Compared.of(tables)
    return render(
        "report.md.j2",
        tables=tables,
        compared=compared,
        costs=Costs(tables),
        sentence=sentence(tables, compared),
        lights=lights(tables, compared),
        statements=statements(tables, compared),
        case=tables.case,
        model=tables.case["model"],
        figures={figure.name: figure for figure in drawn},
        inputs=inputs,
        shown=shown("report"),
    )


def html(tables: Tables, text: str, drawn: list[Figure]) -> str:
    """Renders the page with interactive figures, timings and the occasion, in one file without outside references."""
    occasion, timed = occasion_of(tables.provenance), timings(tables)["runs"]
    return page(tables.case["title"], text, drawn, occasion, timed, folded=FOLDED)


def timings(tables: Tables) -> dict[str, Any]:
    """Returns the timings of all runs, which change from run to run, and exact solves beside the pseudo-inverse's."""
    of_reference = times_of_reference(tables)
    runs = [
        {
            "run": row["run"],
            **{name: row[name] for name in TIMING_FIGURES},
            "solve_of_pinv": of_reference.get(row["run"]),
        }
        for row in tables.rows
    ]
    return {"runs": runs}


def write_report(results: Path, target: Path) -> Path:
    """Writes README.md, figures/*.svg, index.html, timings.json and provenance.json.

    The folder is written under a temporary name and then takes the place of the old one: an interruption leaves the
    old report or the new one, never a mixture.

    Args:
        results: folder of results of one case.
        target: folder of the report.

    Raises:
        InputError: the results are missing or damaged, or the target cannot be written or is not a report.
    """
    require_report(target, CONTENTS)
    with believing(results):
        tables = Tables(ResultFolder(results))
        drawn = drawable(draw(tables))
        text = markdown(tables, drawn)
    return write_whole(target, lambda folder: _write(folder, tables, text, drawn))


def _write(folder: Path, tables: Tables, text: str, drawn: list[Figure]) -> None:
    for figure in drawn:
        write_text(folder / "figures" / f"{figure.name}.svg", figure.svg())
    write_text(folder / "README.md", text)
    write_text(folder / "index.html", html(tables, text, drawn))
    for name, content in (("timings.json", timings(tables)), ("provenance.json", tables.provenance)):
        write_text(folder / name, json.dumps(content, indent=1) + "\n")
