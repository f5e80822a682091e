"""Two folders of results of one small case, to be changed and held against one another."""

from pathlib import Path

import polars as pl
from oarlock.tables.folder import ResultFolder

GATED = """
title = "tiny"
[run]
duration_s = 0.5
stabilisation = "baumgarte"  # leaves a drift that can get worse
[[experiments]]
mode = "calibration"
[[experiments]]
mode = "free"
forms = ["hard"]
solvers = ["mujoco", "pinv"]
[[gates]]
figure = "drift_pos_max"
where = {solver = "pinv"}
max = 1e-6
cause = "the discretisation"
"""


def edit(folder: Path, change) -> None:
    """Changes the summary of a folder."""
    document = ResultFolder(folder).read_json("summary.json")
    change(document)
    ResultFolder(folder).write_json("summary.json", document)


def rewrite(folder: Path, run: str, table: pl.DataFrame) -> None:
    """Puts another table in the place of a run's."""
    sums = ResultFolder(folder).write_table(run, table.lazy())
    edit(folder, lambda document: document["files"].update(sums))


def exact(document) -> dict:
    """The row of the exact free run."""
    (row,) = [row for row in document["runs"] if row["form"] == "hard"]
    return row


def set_figure(folder: Path, **figures) -> None:
    edit(folder, lambda document: exact(document).update(figures))
