"""Tables on disk: a Parquet file a run, and the summary with a row a run. Finished runs are never lost.

Every file is written under a temporary name and moved, so that an interruption leaves whole files only.
"""

import json
import os
import re
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import polars as pl

from oarlock.errors import InputError, one_line
from oarlock.spool import GROUP, Spool, reason

SCHEMA: dict[str, pl.DataType | type[pl.DataType]] = {
    "step": pl.Int64,
    "time_s": pl.Float64,
    "status": pl.String,
    "solves": pl.Int64,
    "unconverged": pl.Int64,
    "iterations": pl.Int64,
    "iterations_worst": pl.Int64,
    "products": pl.Int64,
    "refreshes": pl.Int64,
    "refolds": pl.Int64,
    "residual_rel": pl.Float64,
    "solve_ns": pl.Int64,
    "rank": pl.Int64,
    "inconsistency": pl.Float64,
    "min_norm_error": pl.Float64,
    "qacc_rel_diff": pl.Float64,
    "qfrc_constraint_rel_diff": pl.Float64,
    "drift_pos": pl.Float64,
    "drift_vel": pl.Float64,
    "drift_acc": pl.Float64,
    "projection": pl.String,
    "projection_rounds": pl.Int64,
    "projection_solves": pl.Int64,
    "projection_iterations": pl.Int64,
    "projection_moved": pl.Float64,
    "energy": pl.Float64,
    "kinetic_energy": pl.Float64,
    "trajectory_diff": pl.Float64,
    "truth_error": pl.Float64,
    "published_position_error": pl.Float64,
    "published_velocity_error_rel": pl.Float64,
    "published_multiplier_error_rel": pl.Float64,
    "step_us": pl.Float64,
    "qpos": pl.List(pl.Float64),
    "residual": pl.List(pl.Float64),
    "multipliers": pl.List(pl.Float64),
}
"""Columns of a steps table; a figure that does not apply is null."""


@dataclass(frozen=True)
class RunKey:
    """Which run it is."""

    case: str
    mode: str
    walker: str
    solver: str
    form: str | None
    integrator: str
    settings: str
    stepping: str
    timestep_s: float
    steps: int
    stabilisation: str | None = None
    """None: nothing in the run is stabilised."""

    @property
    def slug(self) -> str:
        """A file name that tells the runs of a folder apart."""
        parts = [
            self.mode,
            self.form,
            f"along-{self.walker}" if self.mode == "lockstep" else None,
            self.solver,
        ]
        parts += [
            None if self.settings == "default" else self.settings,
            None if self.stabilisation == "baumgarte" else self.stabilisation,
            self.integrator,
        ]
        text = "-".join(part for part in parts if part)
        return re.sub(r"[^A-Za-z0-9.+-]+", "_", text)


@dataclass(frozen=True)
class RunResult:
    """A finished run: its key, how it ended, and its steps.

    It ended ``done``, ``diverged``, or complete but with solves that did not converge (``unconverged``) or projections
    that did not reach the constraints (``unprojected``).
    """

    key: RunKey
    status: str
    message: str
    steps: Spool

    def table(self) -> pl.LazyFrame:
        """The steps with the key in front of every row."""
        key = asdict(self.key)
        marks = [pl.lit(value, dtype=pl.String if value is None else None).alias(name) for name, value in key.items()]
        names = [name for name in SCHEMA if name not in key and name != "step"]
        return self.steps.lazy().select("step", *marks, *names)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Gives a temporary path beside ``path`` and moves it there when the block ends well.

    Raises:
        InputError: the file cannot be written (full disk, no permission).
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with uninterrupted():
            path.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            os.replace(temporary, path)
    except (OSError, pl.exceptions.ComputeError) as error:
        raise InputError(f"cannot write '{path}': {reason(error)}") from None
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Keeps an interruption back until the block is done, or the block around it.

    A library that is interrupted may leave half a file, and a finished run is more than one file.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    caught: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _frame: caught.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if caught and callable(before):
            before(signal.SIGINT, None)
        elif caught:
            raise KeyboardInterrupt


def write_text(path: Path, text: str) -> None:
    """Writes a text file whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@contextmanager
def reading(path: Path) -> Iterator[Path]:
    """Says which table it was that cannot be read.

    Raises:
        InputError: it is not there or not whole.
    """
    try:
        yield path
    except (OSError, pl.exceptions.PolarsError) as error:
        raise InputError(f"'{path}' cannot be read: {one_line(error)[:120]}") from None


class ResultFolder:
    """A folder of results: ``steps/*.parquet``, ``summary.json``, ``case.json``, ``sketch.json``."""

    def __init__(self, path: Path):
        self.path = path

    def write_steps(self, result: RunResult) -> None:
        """Keeps the steps of a finished run."""
        with replacing(self.steps_path(result.key.slug)) as temporary:
            result.table().sink_parquet(temporary, compression="zstd", row_group_size=GROUP)

    def write_truth(self, truth: pl.DataFrame) -> None:
        """Keeps the outside truth at times of the steps: time_s, position (rad or m)."""
        with replacing(self.path / "truth.parquet") as temporary:
            truth.write_parquet(temporary, compression="zstd")

    def read_truth(self) -> pl.DataFrame:
        """The outside truth at times of the steps."""
        with reading(self.path / "truth.parquet") as path:
            return pl.read_parquet(path)

    def forget_steps_but(self, slugs: list[str]) -> None:
        """Removes the steps of runs that an earlier summary of this folder had and this one has not."""
        for path in (self.path / "steps").glob("*.parquet"):
            if path.stem not in slugs:
                path.unlink()

    def read_steps(self, slug: str) -> pl.DataFrame:
        """The steps of a run."""
        with reading(self.steps_path(slug)) as path:
            return pl.read_parquet(path)

    def steps_path(self, slug: str) -> Path:
        """Where the steps of a run are."""
        return self.path / "steps" / f"{slug}.parquet"

    def write_json(self, name: str, content: dict[str, Any], *, indent: int | None = 1) -> None:
        """Keeps a JSON document; without indent on one line, which takes a tenth of the time."""
        write_text(self.path / name, json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False) + "\n")

    def read_json(self, name: str) -> dict[str, Any]:
        """Reads a JSON document.

        Raises:
            InputError: it is not there or not whole.
        """
        path = self.path / name
        try:
            return json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise InputError(f"no '{path}', expected a folder that 'oarlock run --out' wrote") from None
        except (OSError, ValueError) as error:
            raise InputError(f"'{path}' cannot be read: {error}") from None
