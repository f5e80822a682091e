"""The columns of the tables of steps, and the figures of a summary."""

from dataclasses import fields
from typing import get_args

from oarlock.tables.figures import COLUMNS, FIGURES, Walk
from oarlock.tables.schema import RunKey
from text import code, plain, table
from text import page as written

HEAD = """\
A run leaves a Parquet file of its steps, `results/MODEL/steps/RUN.parquet`, and a row in `summary.json`. Both are
polars frames in Python: `results.steps` and `results.summary`. Where a figure does not apply it is null."""

WALKS = {
    "calibration": "calibration: MuJoCo's own force through our stepping",
    "lockstep": "lockstep: a solver that answers while another walks",
    "one-step": "one step from each recorded state",
    "free": "a solver's free run",
    "alone": "a solver's free run that is not judged",
    "mujoco": "MuJoCo's own free run",
}

BETTER = {"smaller": "smaller", "larger": "larger", "neither": ""}


def page() -> str:
    """Columns, walks, figures."""
    walks = get_args(Walk)
    names = table(["walk", "what it is"], [[code(walk), plain(WALKS[walk])] for walk in walks])
    every = [
        [
            code(column.name),
            column.kind,
            plain(column.meaning),
            "all" if set(column.walks) == set(walks) else ", ".join(column.walks),
            "may be missing" if column.optional else "",
        ]
        for column in COLUMNS
    ]
    keys = ", ".join(code(field.name) for field in fields(RunKey))
    figures = [
        [
            code(figure.name),
            "" if figure.tolerance is None else figure.tolerance.words,
            "" if figure.tolerance is None else BETTER[figure.tolerance.better],
            plain(figure.report or figure.sweep),
        ]
        for figure in FIGURES
    ]
    return written(
        "Tables and figures",
        HEAD,
        "## Columns of a table of steps",
        table(["column", "kind", "meaning, with its unit", "walks that have it", ""], every),
        f"Each row says besides which run it is of: {keys}.",
        "The walks:",
        names,
        "## Figures of a summary",
        "`…_max` and `…_min` are the largest and smallest entry of the column of that name over the steps, `…_mean` and"
        " `…_median` what they say; a change beyond the tolerance counts in `oarlock diff`.",
        table(["figure", "a change that counts", "better", "heading in reports"], figures),
    )
