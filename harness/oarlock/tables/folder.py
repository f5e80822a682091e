"""Tables on disk: a Parquet file a run, and the summary with a row a run. Finished runs are never lost.

Every file is written under a temporary name and moved, so that an interruption leaves whole files only.
"""

import json
from pathlib import Path
from typing import Any

import polars as pl

from oarlock.base.errors import InputError
from oarlock.base.files import reading, replacing, write_text
from oarlock.tables.schema import RunResult
from oarlock.tables.spool import GROUP


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
