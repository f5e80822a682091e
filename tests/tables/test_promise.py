"""How runs end: what ``done`` promises, and the words for what does not keep it."""

import math
from typing import Any

import polars as pl
import pytest
from oarlock.tables.promise import ENERGY_BOUND, ERROR_BOUND, doubts, ended
from oarlock.tables.schema import SCHEMA, RunKey
from oarlock.tables.spool import Spool

KEY = {"case": "c", "mode": "free", "walker": "pinv", "solver": "pinv", "form": "hard", "integrator": "rk4"}
GOOD = {
    "solves": [4, 4],
    "unconverged": [0, 0],
    "projection": ["landed", "landed"],
    "energy": [5.0, 5.0],
    "kinetic_energy": [1.0, 2.0],
    "error_estimate": [0.0, 1e-6],
}
LOST_ENERGY = {"energy": [5.0, 5.0 - 3.0 * ENERGY_BOUND]}
FAR = {"error_estimate": [0.0, 2.0 * ERROR_BOUND]}
OPEN = {"projection": ["landed", "too-far"]}
UNSOLVED = {"unconverged": [0, 3]}


def end(message: str = "", key: dict[str, Any] | None = None, **columns: Any) -> tuple[str, str]:
    steps = Spool(SCHEMA)
    frame = pl.DataFrame({**GOOD, **columns})
    unknown = [pl.lit(None, dtype=kind).alias(name) for name, kind in SCHEMA.items() if name not in frame.columns]
    steps.append(frame.with_columns(unknown).select(*SCHEMA))
    whole = {**KEY, "settings": "default", "stepping": "native", "timestep_s": 1e-3, "steps": 2, **(key or {})}
    return ended(RunKey(**whole), steps, message)


@pytest.mark.parametrize(
    ("columns", "status", "said"),
    [
        ({}, "done", ""),
        (LOST_ENERGY, "drifted", "changes by 1.50e-03 of the largest kinetic energy, expected at most 0.001"),
        ({"energy": [5.0, 5.0 + 1.9 * ENERGY_BOUND]}, "done", ""),
        (FAR, "inaccurate", "by its own estimate it is off by 0.200 m or rad, expected at most 0.1"),
        ({"error_estimate": [0.0, math.inf]}, "inaccurate", "the walk at half the timestep was lost"),
        (OPEN, "unprojected", "1 of 2 projections did not reach the constraints"),
        (UNSOLVED, "unconverged", "3 of 8 solves did not converge"),
    ],
)
def test_each_ending_has_its_word(columns, status, said):
    word, message = end(**columns)
    assert word == status
    assert said in message
    assert bool(message) == (status != "done")


def test_the_worst_comes_first():
    all_of_it: dict[str, Any] = {**LOST_ENERGY, **FAR, **OPEN, **UNSOLVED}
    found = [end("step 1, t = 0.001 s: b is not finite", **all_of_it)[0]]
    for fault in (LOST_ENERGY, FAR, OPEN, UNSOLVED):
        found.append(end(**all_of_it)[0])
        all_of_it = {name: value for name, value in all_of_it.items() if name not in fault}
    assert found == ["diverged", "drifted", "inaccurate", "unprojected", "unconverged"]


@pytest.mark.parametrize("key", [{"integrator": "euler"}, {"form": "matched"}, {"form": None, "solver": "mujoco"}])
def test_energy_binds_exact_runs_of_higher_order(key):
    assert end(key=key, **LOST_ENERGY) == ("done", "")


def test_what_is_rounding_of_a_mechanism_at_rest_is_no_drift():
    assert end(energy=[5.0, 5.0 + 1e-15], kinetic_energy=[1e-30, 1e-30]) == ("done", "")


def test_doubts_name_the_worst_run_and_the_first_event():
    rows = [
        {"run": "a", "rank_margin_min": 1e9, "rank_rises": 0, "rank_rises_at_s": None},
        {"run": "b", "rank_margin_min": 400.0, "rank_rises": 2, "rank_rises_at_s": 0.25},
        {"run": "c", "rank_margin_min": 9e3, "rank_rises": 1, "rank_rises_at_s": 0.125},
        {"run": "mujoco", "rank_margin_min": None, "rank_rises": None, "rank_rises_at_s": None},
    ]
    near, risen = doubts(rows)
    assert near.startswith("the rank cut decides in 2 of 4 runs: in b an eigenvalue comes within a factor of 400 of it")
    assert risen.startswith("the rank of the start rises in 2 of 4 runs: in c first at t = 0.125 s")
    assert doubts([rows[0], rows[3]]) == []
