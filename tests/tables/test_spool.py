"""Long tables: what goes in chunk by chunk comes out whole, in little memory, and nothing of it is left behind."""

import errno
import gc
import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanisms import frames_of, only, setup_of
from oarlock import InputError, load_case, run
from oarlock.base.files import replacing
from oarlock.experiments.sketch import TRACE_POINTS, traced
from oarlock.report import figures
from oarlock.report.case_report import write_report
from oarlock.report.tables import Tables
from oarlock.tables import spool
from oarlock.tables.aggregate import summarise
from oarlock.tables.figures import TIMING_FIGURES
from oarlock.tables.folder import ResultFolder
from oarlock.tables.schema import SCHEMA, RunKey, RunResult
from oarlock.tables.spool import Spool, spools

SMALL = {"step": pl.Int64, "value": pl.Float64, "word": pl.String, "list": pl.List(pl.Float64)}
TIMED = ["solve_ns", "step_us"]
"""Columns that are never the same twice."""

KEY = RunKey("c", "free", "pinv", "pinv", "hard", "rk4", "default", "python", 1e-3, 3)
FLOATS = st.one_of(st.none(), st.floats(width=64))
COUNTS = st.one_of(st.none(), st.integers(0, 9))


def numbered(begin, count):
    """Rows that tell where they are, with what is not known among them."""
    steps = range(begin, begin + count)
    columns = {
        "step": list(steps),
        "value": [None if step % 7 == 3 else step / 3 for step in steps],
        "word": [None if step % 5 == 4 else f"w{step % 3}" for step in steps],
        "list": [None if step % 11 == 5 else [float(step)] * (step % 4) for step in steps],
    }
    return pl.DataFrame(columns, schema=SMALL)


def filled(sizes, **options):
    """A spool of so many chunks, and what it must give."""
    table, begin, chunks = Spool(SMALL, **options), 0, [numbered(0, 0)]
    for size in sizes:
        chunks.append(numbered(begin, size))
        table.append(chunks[-1])
        begin += size
    return table, pl.concat(chunks)


def recorded(rows, held):
    table = Spool(SCHEMA, held=held)
    for row in rows:
        table.append(pl.DataFrame([row], schema=SCHEMA, strict=False))
    return RunResult(KEY, "done", "", table)


@pytest.fixture
def tiny(monkeypatch):
    """Everything goes to disk, in small parts."""
    for name, value in (("HELD", 2000), ("PART", 1000), ("SLICE", 7), ("GROUP", 50)):
        monkeypatch.setattr(spool, name, value)


# What goes in comes out.


@settings(deadline=None)
@given(st.lists(st.integers(0, 40), max_size=12), st.sampled_from([0, 1, 500, 5000, 10**9]))
def test_chunks_in_are_the_table_out(sizes, held):
    table, expected = filled(sizes, held=held)
    assert len(table) == len(expected)
    assert table.on_disk == (expected.height > 0 and held < expected.estimated_size() and held < 10**9)
    for frame in (table.frame(), pl.concat(table.chunks()), table.lazy().collect(engine="streaming")):
        assert frame.schema == SMALL
        assert frame.equals(expected, null_equal=True)
    assert pl.concat(table.chunks(["word"])).equals(expected.select("word"))
    found = table.lazy().filter(pl.col("value") > 4).select("step", "list").head(5).collect()
    assert found.equals(expected.filter(pl.col("value") > 4).select("step", "list").head(5))
    assert table.lazy().head(9).collect().equals(expected.head(9))
    asked = (pl.col("value").max(), pl.col("step").sum(), pl.col("word").null_count())
    assert table.collect(*asked).equals(expected.select(*asked))


def test_rows_may_come_after_the_table_was_asked_for():
    table, expected = filled([30, 30, 30], held=1000)
    assert table.frame().equals(expected)
    table.append(numbered(90, 30))
    assert table.frame().equals(pl.concat([expected, numbered(90, 30)]))


def test_several_tables_share_the_memory():
    one, many = spools(1, SMALL), spools(40, SMALL)
    assert len(many) == 40
    rows = numbered(0, 1 + spool.HELD_TOGETHER // 40 // numbered(0, 1000).estimated_size() * 1000)
    for table in (one[0], many[0]):
        table.append(rows)
        table.append(rows)
    assert (one[0].on_disk, many[0].on_disk) == (False, True)


def test_short_runs_stay_in_memory(monkeypatch):
    def written(_self):
        raise AssertionError("went to disk")

    monkeypatch.setattr(Spool, "_write", written)
    columns = {name: [1.0] * 5 if isinstance(kind, pl.List) else 1 for name, kind in SCHEMA.items()}
    row = pl.DataFrame([{**columns, "status": "converged", "projection": "landed"}], schema=SCHEMA)
    table = Spool(SCHEMA)
    for _ in range(5):
        table.append(pl.concat([row] * 10_000))
    assert len(table) == 50_000


# The folder.


def test_the_folder_lives_as_long_as_what_needs_it(tmp_path):
    table, expected = filled([50, 50], folder=tmp_path / "out", held=100)
    lazy = table.lazy()
    del table
    gc.collect()
    assert len(list((tmp_path / "out").glob(".steps.*/*.parquet"))) > 0
    assert lazy.select("step").collect().equals(expected.select("step"))
    del lazy
    gc.collect()
    assert list((tmp_path / "out").iterdir()) == []


def test_a_closed_spool_leaves_nothing(tmp_path):
    table, _ = filled([50, 50], folder=tmp_path, held=100)
    table.close()
    assert list(tmp_path.iterdir()) == []
    assert len(table) == 0


@pytest.mark.parametrize("end", ["pass", "raise KeyboardInterrupt", "import sys; sys.exit(3)"])
def test_the_folder_ends_with_the_process(tmp_path, end):
    script = f"""
import polars as pl
from oarlock.tables.spool import Spool
kept = Spool({{"a": pl.Int64}}, held=0)
kept.append(pl.DataFrame({{"a": [1, 2]}}))
print(kept._home)
{end}
"""
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    finished = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True)
    assert finished.stdout.startswith(str(tmp_path))
    assert list(tmp_path.iterdir()) == []


# Runs.


@pytest.mark.parametrize("stepping", ["native", "python"])
def test_a_run_on_disk_is_the_run_in_memory(tmp_path, tiny, monkeypatch, stepping):
    options = {"solver": ["pinv", "sr1", "mujoco"], "duration": 0.05, "stepping": stepping}
    long, kept = run("boat", **options), run("boat", **options, out=tmp_path)
    monkeypatch.undo()
    short = run("boat", **options)
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []
    for results in (long, kept):
        for ours, theirs in zip(results.rows, short.rows, strict=True):
            assert {k: v for k, v in ours.items() if k not in TIMING_FIGURES} == {
                k: v for k, v in theirs.items() if k not in TIMING_FIGURES
            }
        for ours, theirs in zip(frames_of(results), frames_of(short), strict=True):
            assert ours.schema == theirs.schema
            assert ours.drop(TIMED).equals(theirs.drop(TIMED), null_equal=True)
        assert results.steps.drop(TIMED).equals(short.steps.drop(TIMED), null_equal=True)


def test_a_kept_run_is_read_from_where_it_is_kept(tmp_path, tiny):
    results = run("boat", mode="free", solver="mujoco", duration=0.1, out=tmp_path)
    for row, frame in zip(results.rows, frames_of(results), strict=True):
        assert ResultFolder(tmp_path).read_steps(row["run"]).equals(frame, null_equal=True)
        ResultFolder(tmp_path).steps_path(row["run"]).unlink()
    with pytest.raises(FileNotFoundError):
        _ = frames_of(results)


@settings(deadline=None, max_examples=40)
@given(
    st.lists(
        st.fixed_dictionaries(
            {
                name: COUNTS if SCHEMA[name] == pl.Int64 else FLOATS
                for name in SCHEMA
                if SCHEMA[name] in (pl.Int64, pl.Float64)
            }
            | {"projection": st.sampled_from([None, "landed", "open"])}
        ),
        max_size=30,
    ),
    st.integers(0, 2000),
)
def test_the_summary_does_not_ask_where_the_rows_are(rows, held):
    long, short = recorded(rows, held), recorded(rows, 10**9)
    assert repr(summarise(long)) == repr(summarise(short))
    frame = short.steps.frame()
    expected: dict[str, Any] = {
        "min_norm_error_median": frame["min_norm_error"].median(),
        "step_us_median": frame["step_us"].median(),
        "solve_ns_median": frame.select(pl.col("solve_ns") / pl.col("solves")).to_series().median(),
        "drift_pos_max": frame["drift_pos"].max(),
        "iterations_max": frame["iterations_worst"].max(),
    }
    for name, value in expected.items():
        assert summarise(short)[name] == (None if value is None or not math.isfinite(value) else value)


def test_energy_drift_is_relative_to_the_largest_kinetic_energy():
    rows = [{"energy": e, "kinetic_energy": k} for e, k in ((2.0, 0.0), (2.5, 4.0), (1.0, 2.0))]
    for held in (0, 10**9):
        assert summarise(recorded(rows, held))["energy_drift_rel"] == 0.25
        assert (
            summarise(recorded([*rows, {"energy": math.nan, "kinetic_energy": 1.0}], held))["energy_drift_rel"] is None
        )
        assert summarise(recorded(rows[:1], held))["energy_drift_rel"] is None


def test_a_trace_is_spread_over_the_run():
    paths = np.random.default_rng(1).random((1000, 3))
    paths[[0, 500, 999], 1] = math.nan
    finite = np.delete(paths, [0, 500, 999], axis=0)
    expected = finite[np.linspace(0, len(finite) - 1, TRACE_POINTS).astype(int)]
    for held in (0, 10**9):
        table = Spool(SCHEMA, held=held)
        for begin in range(0, 1000, 130):
            rows = {"step": range(begin, min(begin + 130, 1000)), "qpos": paths[begin : begin + 130].tolist()}
            missing = {name: [None] * len(rows["step"]) for name in SCHEMA if name not in rows}
            table.append(pl.DataFrame({**rows, **missing}, schema=dict(SCHEMA)).select(list(SCHEMA)))
        np.testing.assert_array_equal(traced(table), expected)


def test_the_table_of_the_truth_is_thinned_out(monkeypatch):
    whole = setup_of(load_case("boat"), duration_s=0.5)
    monkeypatch.setattr("oarlock.stepping.prepared.TRUTH_ROWS", 40)
    thin = setup_of(load_case("boat"), duration_s=0.5)
    assert whole.truth is not None
    assert thin.truth is not None
    np.testing.assert_array_equal(whole.truth["time_s"], np.arange(500) * 1e-3)
    assert thin.truth["time_s"].to_list()[:: len(thin.truth) - 1] == [0.0, 499 * 1e-3]
    assert len(thin.truth) == 40
    assert thin.truth.join(whole.truth, on=["time_s", "position"], how="anti").is_empty()
    steps, places = np.arange(500), np.zeros((500, 1))
    np.testing.assert_array_equal(thin.truth_errors(steps, places), whole.truth_errors(steps, places))


# Figures.


def test_condensed_tables_lose_no_peak(monkeypatch):
    monkeypatch.setattr(figures, "LONG", 100)
    monkeypatch.setattr(figures, "STRETCHES", 50)
    values = np.random.default_rng(1).normal(size=1000)
    values[321], values[555] = -9.0, math.nan
    columns = {"time_s": np.arange(1000) / 8, "qpos": [[v, 1.0] for v in values], "iterations": np.arange(1000) % 3}
    columns |= {"truth_error": [None if step < 100 else v for step, v in enumerate(values)]}
    columns |= {"residual": [[v, 2 * v] if step != 700 else [v] for step, v in enumerate(values)]}
    steps = pl.DataFrame({"step": np.arange(1000), **columns}, strict=False)
    found = figures.condensed(steps.lazy(), 1000)
    assert found.columns == steps.columns
    assert found["time_s"].to_list() == [20 * stretch / 8 for stretch in range(50)]
    assert [place[0] for place in found["qpos"].head(16)] == values[:320:20].tolist()
    assert found["truth_error"].head(5).to_list() == [None] * 5
    assert found["truth_error"][16] == 9.0
    assert found["residual"][16].to_list() == [9.0, 18.0]
    assert math.isnan(found["truth_error"][27])
    assert all(math.isnan(entry) for entry in (*found["residual"][27], *found["residual"][35]))
    assert found["iterations"].mean() == pytest.approx(steps["iterations"].mean())
    assert figures.condensed(steps.lazy(), 100).equals(steps)


def test_the_report_of_a_long_run(tmp_path, monkeypatch):
    run("boat", duration=0.3, out=tmp_path / "in")
    whole = write_report(tmp_path / "in", tmp_path / "whole")
    monkeypatch.setattr(figures, "LONG", 100)
    monkeypatch.setattr(figures, "STRETCHES", 60)
    tables = Tables(ResultFolder(tmp_path / "in"))
    row = only(tables.rows, run="free-mujoco-rk4")
    assert len(tables.steps(row, "time_s", "qpos")) == 60
    assert tables.counted(only(tables.rows, run="lockstep-hard-along-pinv-sr1-rk4"), "iterations")["len"].sum() == 300
    short = write_report(tmp_path / "in", tmp_path / "short")
    assert (short / "README.md").read_text() == (whole / "README.md").read_text()
    assert {path.name for path in (short / "figures").iterdir()} == {
        path.name for path in (whole / "figures").iterdir()
    }


# Failures.


COMMAND = """
import resource, sys
from oarlock.cli import app as cli
from oarlock.stepping import native_path, python_path
from oarlock.tables import spool
spool.HELD = spool.PART = {held}
native_path.CHUNK_ROWS = python_path.HELD_ROWS = 200
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
sys.argv = ["oarlock", "run", "boat", "--mode", "free", "--form", "hard", "--solver", "pinv", *sys.argv[1:]]
cli.main()
"""
"""Files that may not grow stand for a full disk."""


@pytest.mark.parametrize("stepping", ["native", "python"])
@pytest.mark.parametrize(
    ("held", "limit", "message", "kept"),
    [
        (400_000, 60_000, "cannot keep the steps of a run in '{out}/.steps.", []),
        (40_000, 420_000, "cannot write '{out}/steps/free-hard-pinv-rk4.parquet'", ["calibration-mujoco-rk4"]),
    ],
    ids=["on the way", "at the end"],
)
def test_a_full_disk_is_one_line(tmp_path, stepping, held, limit, message, kept):
    """3000 rows of the calibration take 290 kB, those of the free run 550 kB."""
    out = tmp_path / "out"
    options = ["--duration", "3", "--out", str(out), "--stepping", stepping]
    command = [sys.executable, "-c", COMMAND.format(held=held, limit=limit), *options]
    finished = subprocess.run(command, capture_output=True, text=True)
    assert finished.returncode == 2
    (line,) = finished.stderr.splitlines()
    assert line.startswith(f"oarlock: {message.format(out=out)}")
    assert line.endswith(f": {os.strerror(errno.EFBIG)}")
    assert [path for path in out.rglob("*") if path.name.startswith(".")] == []
    assert [path.stem for path in out.glob("steps/*")] == kept
    if kept:
        assert [row["run"] for row in ResultFolder(out).read_json("summary.json")["runs"]] == kept


def test_what_polars_could_not_write_is_named(tmp_path):
    def write():
        with replacing(tmp_path / "a.parquet"):
            raise pl.exceptions.ComputeError(
                f"parquet: underlying IO error: No space left on device (os error {errno.ENOSPC})"
            )

    with pytest.raises(InputError, match=rf"^cannot write '.*a\.parquet': {os.strerror(errno.ENOSPC)}$"):
        write()


def test_an_interrupted_long_run_leaves_the_finished_ones(tmp_path):
    out = tmp_path / "out"
    script = COMMAND.format(held=40_000, limit=10**9)
    command = [sys.executable, "-c", script, "--duration", "30", "--out", str(out)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120
    while not ((out / "summary.json").exists() and any(out.glob(".steps.*/*"))):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (130, "oarlock: interrupted; the runs that were finished are kept\n")
    assert [path.name for path in out.iterdir() if path.name.startswith(".")] == []
    assert [path.stem for path in (out / "steps").iterdir()] == ["calibration-mujoco-rk4"]
    assert len(ResultFolder(out).read_steps("calibration-mujoco-rk4")) == 30_000


# Memory.

PEAK = """
import json, sys
from oarlock.tables import spool
spool.HELD, spool.HELD_TOGETHER = int(sys.argv[1]), 4 * int(sys.argv[1])
from pathlib import Path
{imports}
def peak(): return 1024 * int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
{prepare}
before = peak()
{work}
print(json.dumps([peak() - before, rows]))
"""

MADE_UP = {
    "imports": """
import numpy as np, polars as pl
from oarlock.tables.aggregate import summarise
from oarlock.tables.folder import ResultFolder
from oarlock.tables.schema import SCHEMA, RunKey, RunResult
from oarlock.experiments.sketch import traced
from oarlock.tables.spool import Spool
""",
    "prepare": """
key = RunKey("c", "free", "pinv", "pinv", "hard", "rk4", "default", "python", 1e-3, 3)
def chunk(begin, rows):
    draw = np.random.default_rng(begin)
    kinds = {pl.Float64: draw.random, pl.Int64: lambda n: draw.integers(0, 9, n), pl.String: lambda n: ["landed"] * n}
    numbers = {name: kinds.get(kind, lambda n: pl.Series(draw.random((n, 6))).cast(pl.List(pl.Float64)))(rows)
               for name, kind in SCHEMA.items()}
    return pl.DataFrame(numbers).cast(dict(SCHEMA))
def work(count, folder):
    table = Spool(SCHEMA)
    for number in range(count):
        table.append(chunk(number, 10_000))
    result = RunResult(key, "done", "", table)
    summarise(result)
    traced(table)
    ResultFolder(Path(folder)).write_steps(result)
    return len(table)
work(3, sys.argv[2])
""",
    "work": "rows = work(120, sys.argv[2])",
}

WALKED = {
    "imports": "import oarlock",
    "prepare": "oarlock.run('boat', mode='free', solver='auto', form='hard', timestep=1e-5, duration=0.2)",
    "work": """
out = Path(sys.argv[2])
rows = oarlock.run('boat', mode='free', solver='auto', form='hard', timestep=1e-6, duration=0.6, out=out).rows
rows = sum(row['steps_done'] for row in rows)
""",
}


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="getrusage gives a child its parent's peak")
@pytest.mark.parametrize(
    ("parts", "rows"),
    [
        pytest.param(MADE_UP, 1_200_000, id="made up"),
        pytest.param(WALKED, 1_200_000, id="walked", marks=pytest.mark.slow),
    ],
)
def test_memory_is_bounded(tmp_path, parts, rows):
    """A million rows are 400 MB. The same with the rows kept in memory shows that the measurement would see them."""

    def peak(held):
        command = [sys.executable, "-c", PEAK.format(**parts), str(held), str(tmp_path)]
        finished = subprocess.run(command, capture_output=True, text=True, check=True)
        peak, found = json.loads(finished.stdout)
        assert found == rows
        return peak

    assert peak(8 * 2**20) < 150 * 2**20 < 350 * 2**20 < peak(2**40)
