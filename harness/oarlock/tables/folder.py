"""Tables on disk: one Parquet file per run, and a summary with one row per run. Finished runs are never lost.

Every file is written under a temporary name and then moved, so that an interruption leaves whole files only.
"""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from oarlock.base.errors import InputError
from oarlock.base.files import reading, replacing, write_text

if TYPE_CHECKING:
    from oarlock.tables.schema import RunResult

GROUP = 20_000
"""Rows per group of a Parquet file, which its writer and its reader hold in memory."""

OCCASION = ("commit", "date", "cores", "kernel")
"""Keys of a provenance that differ from one occasion to the next."""


def occasion_of(provenance: dict[str, Any]) -> dict[str, Any]:
    """Returns the part of a provenance that differs from one occasion to the next; None for what it lacks."""
    return {key: provenance.get(key) for key in OCCASION}


class ResultFolder:
    """A folder of results: ``steps/*.parquet``, ``summary.json``, ``case.json`` and ``sketch.json``.

    Methods that write raise InputError if a file cannot be written, those that read if it is missing or damaged.

    Attributes:
        path: path of the folder, which need not exist yet.
    """

    def __init__(self, path: Path):
        self.path = path

    def write_steps(self, result: "RunResult") -> None:
        """Writes the steps of a finished run."""
        self.write_table(result.key.slug, result.table())

    def write_table(self, slug: str, table: pl.LazyFrame) -> None:
        """Writes the table of the steps of a run."""
        with replacing(self.steps_path(slug)) as temporary:
            table.sink_parquet(temporary, compression="zstd", row_group_size=GROUP)

    def write_truth(self, truth: pl.DataFrame) -> None:
        """Writes the outside truth at times of the steps, with the columns time_s and position (rad or m)."""
        with replacing(self.path / "truth.parquet") as temporary:
            truth.write_parquet(temporary, compression="zstd")

    def read_truth(self) -> pl.DataFrame:
        """Reads the outside truth at times of the steps."""
        with reading(self.path / "truth.parquet") as path:
            return pl.read_parquet(path)

    def forget_steps_but(self, slugs: list[str]) -> None:
        """Removes the steps of runs whose slugs are not given, which an earlier summary of this folder had."""
        for path in (self.path / "steps").glob("*.parquet"):
            if path.stem not in slugs:
                path.unlink()

    def read_steps(self, slug: str) -> pl.DataFrame:
        """Reads the steps of a run."""
        with reading(self.steps_path(slug)) as path:
            return pl.read_parquet(path)

    def steps_path(self, slug: str) -> Path:
        """Returns the path of the steps of a run."""
        return self.path / "steps" / f"{slug}.parquet"

    def write_json(self, name: str, content: dict[str, Any], *, indent: int | None = 1) -> None:
        """Writes a JSON document; with ``indent=None`` on one line, which takes a tenth of the time."""
        write_text(self.path / name, json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False) + "\n")

    def read_json(self, name: str) -> dict[str, Any]:
        """Reads a JSON document.

        Raises:
            InputError: the file is missing or damaged.
        """
        path = self.path / name
        try:
            return json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise InputError(f"no '{path}', expected a folder that 'oarlock run --out' wrote") from None
        except (OSError, ValueError) as error:
            raise InputError(f"'{path}' cannot be read: {error}") from None
