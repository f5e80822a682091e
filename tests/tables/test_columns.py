"""Tables of steps from what a path gives."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest
from oarlock.base.errors import InputError
from oarlock.tables.columns import require_columns, table_of_columns, table_of_rows
from oarlock.tables.figures import COLUMNS, FIGURES, TIMING_FIGURES, shown
from oarlock.tables.reductions import Reduction
from oarlock.tables.schema import SCHEMA

CALIBRATION: dict[str, Any] = {
    "step": 0,
    "time_s": 0.5,
    "status": "converged",
    "drift_pos": 1e-9,
    "drift_vel": 0.0,
    "trajectory_diff": None,
    "step_us": 1.0,
    "qpos": [1.0, 2.0],
    "qvel": [0.5, 0.0],
    "ctrl": [],
}
"""A row of the shortest table there is."""

LISTS = ["qpos", "qvel", "ctrl", "residual", "multipliers"]


def column(kind: str, values: list, **more: Any) -> Any:
    """As the compiled core gives one."""
    given = {"missing": None, "words": [], "lengths": None, **more}
    return SimpleNamespace(kind=kind, values=np.array(values), **given)


def from_the_core() -> dict[str, Any]:
    return {
        "step": column("int", [0, 1, 2]),
        "time_s": column("float", [0.0, 0.5, 1.0]),
        "status": column("text", [1, 0, 1], words=["breakdown", "converged"]),
        "drift_pos": column("float", [0.0, np.nan, 1.0]),
        "drift_vel": column("float", [0.0, 0.0, 0.0]),
        "trajectory_diff": column("float", [np.nan, 0.5, 1.0], missing=np.array([True, False, False])),
        "step_us": column("float", [1.0, 1.0, 1.0]),
        "qpos": column("list", [1.0, 2.0, 3.0], lengths=np.array([2, 0, 1], dtype=np.uint64)),
        "qvel": column("list", [0.5, 0.0], lengths=np.array([2, 0, 0], dtype=np.uint64)),
        "ctrl": column("list", [], lengths=np.zeros(3, dtype=np.uint64)),
    }


def test_columns_of_the_core_become_a_table():
    table = table_of_columns("calibration", from_the_core(), 3)
    assert table.schema == SCHEMA
    assert table["status"].to_list() == ["converged", "breakdown", "converged"]
    assert table["qpos"].to_list() == [[1.0, 2.0], [], [3.0]]
    assert table["trajectory_diff"].to_list() == [None, 0.5, 1.0]
    assert table["drift_pos"].is_nan().to_list() == [False, True, False]
    assert table["rank"].null_count() == 3


def test_rows_become_the_same_table():
    rows = [{**CALIBRATION, "qpos": qpos} for qpos in ([1.0, 2.0], [], [3.0])]
    table = table_of_rows("calibration", [*rows, {**CALIBRATION, "truth_error": 0.25}])
    assert table.schema == SCHEMA
    assert table["qpos"].to_list() == [[1.0, 2.0], [], [3.0], [1.0, 2.0]]
    assert table["truth_error"].to_list() == [None, None, None, 0.25]
    assert table["trajectory_diff"].null_count() == 4


def test_nothing_becomes_an_empty_table():
    assert table_of_rows("free", []).schema == table_of_columns("free", {}, 0).schema == SCHEMA


@pytest.mark.parametrize(
    ("walk", "change", "message"),
    [
        ("calibration", {"slip": 1.0}, "a table of a calibration walk has a column 'slip', expected what"),
        ("calibration", {"rank": 4}, "a calibration walk has a column 'rank'"),
        ("mujoco", {}, "a mujoco walk has no column 'drift_acc' and has no column 'iterations'"),
    ],
)
def test_columns_that_are_not_listed_or_missing(walk, change, message):
    with pytest.raises(InputError, match=message):
        table_of_rows(walk, [CALIBRATION, {**CALIBRATION, **change}])
    with pytest.raises(InputError, match=message):
        require_columns(walk, {**CALIBRATION, **change})


def test_a_column_of_another_kind_than_listed():
    given = from_the_core() | {"step_us": column("int", [1, 1, 1])}
    with pytest.raises(InputError, match="column 'step_us' of the core is of kind int, expected float"):
        table_of_columns("calibration", given, 3)


def test_figures_are_of_columns_that_there_are():
    for figure in FIGURES:
        if isinstance(figure.of, Reduction):
            roots = {root for expression in figure.of.ask for root in expression.meta.root_names()}
            assert roots <= set(SCHEMA), figure.name
    for listed in (COLUMNS, FIGURES):
        names = [one.name for one in listed]
        assert len(set(names)) == len(names)


def test_what_is_shown_and_what_changes_from_run_to_run():
    assert list(shown("sweep")) == [
        "iterations_mean",
        "min_norm_error_max",
        "drift_pos_max",
        "error_estimate_max",
        "truth_error_max",
        "trajectory_diff_max",
    ]
    assert shown("report")["drift_pos_max"] == "drift: position"
    assert TIMING_FIGURES == ("solve_ns_median", "step_us_median")


def test_a_column_says_what_it_is():
    assert all(one.meaning and one.walks for one in COLUMNS)
    assert [name for name, kind in SCHEMA.items() if kind == pl.List(pl.Float64)] == LISTS
