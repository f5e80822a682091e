"""Reading and writing of Parquet files by paths that mean what they say.

To polars a path is a pattern: brackets, asterisks and question marks select files, ``key=value`` adds a column, a tilde
is somebody's home and ``file:`` the beginning of an address. Here every path names one file.
"""

from collections.abc import Sequence
from pathlib import Path

import polars as pl


def scan(path: Path) -> pl.LazyFrame:
    """The table in a file, to be read when it is needed."""
    return pl.scan_parquet(_literal(path), glob=False, hive_partitioning=False)


def read(path: Path, columns: Sequence[str] | None = None) -> pl.DataFrame:
    """Reads a table, or some of its columns."""
    wanted = None if columns is None else list(columns)
    return pl.read_parquet(_literal(path), columns=wanted, glob=False, hive_partitioning=False)


def write(table: pl.LazyFrame, path: Path, group: int) -> None:
    """Writes a table in groups of so many rows, without having all of it in memory."""
    table.sink_parquet(_literal(path), compression="zstd", row_group_size=group)


def _literal(path: Path) -> Path:
    return path.absolute()
