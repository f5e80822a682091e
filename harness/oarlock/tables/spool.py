"""Buffers for the rows of a run: short tables stay in memory, long ones go to disk."""

import shutil
import tempfile
import weakref
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import polars as pl
from polars.io.plugins import register_io_source

from oarlock.base.errors import DiskError
from oarlock.base.files import reason
from oarlock.base.scratch import scratch
from oarlock.tables.folder import GROUP, read_parquet

Schema = Mapping[str, pl.DataType | type[pl.DataType]]

HELD = 32 * 2**20
"""Bytes of a table that are kept in memory, some 80 000 steps of a small mechanism. Longer tables go to disk."""

HELD_TOGETHER = 4 * HELD
"""Bytes that all tables of one walk together may keep in memory."""

PART = 4 * 2**20
"""Bytes of each part on disk, once a table goes there."""

SLICE = 1000
"""Rows that a table on disk hands to polars at once. polars reads ahead one such slice per core."""


class Spool:
    """A table that is written chunk by chunk and can be read as often as needed.

    Up to ``held`` bytes stay in memory. Beyond that the rows go to Parquet files in a temporary folder, which is made
    when it is needed. It is removed when neither the spool nor a lazy table of it is left, and at the end of the
    process, also of an interrupted one.

    Args:
        schema: name → type of every column.
        folder: where the temporary folder is made; None for the system's.
        held: bytes that may stay in memory; None for ``HELD``.
    """

    def __init__(self, schema: Schema, folder: Path | None = None, held: int | None = None):
        self._schema, self._folder = dict(schema), folder
        self._limit = HELD if held is None else held
        self._held: list[pl.DataFrame] = []
        self._bytes = 0
        self._parts: list[Path] = []
        self._height = 0
        self._home: Path | None = None

    def __len__(self) -> int:
        return self._height

    @property
    def on_disk(self) -> bool:
        """Whether the table has become too long for memory."""
        return bool(self._parts)

    def append(self, chunk: pl.DataFrame) -> None:
        """Appends rows of the schema.

        Raises:
            DiskError: the rows cannot be written to disk.
        """
        if chunk.is_empty():
            return
        self._held.append(chunk)
        self._height += len(chunk)
        self._bytes += chunk.estimated_size()
        if self._bytes > (PART if self._parts else self._limit):
            self._write()

    def chunks(self, columns: Sequence[str] | None = None) -> Iterator[pl.DataFrame]:
        """Yields the rows in order, one part in memory at a time.

        Args:
            columns: names of the columns; None for all.
        """
        wanted = list(columns) if columns is not None else list(self._schema)
        for part in self._parts:
            yield read_parquet(part, wanted)
        if self._held or not self._parts:
            yield self._rest().select(wanted)

    def lazy(self) -> pl.LazyFrame:
        """Returns the rows as a lazy table, which reads long ones from disk in slices."""
        if not self._parts:
            return self._rest().lazy()
        return register_io_source(self._source, schema=pl.Schema(self._schema), is_pure=True)

    def collect(self, *expressions: pl.Expr) -> pl.DataFrame:
        """Evaluates expressions over the rows without having all of them in memory."""
        return self.lazy().select(*expressions).collect(engine="streaming" if self._parts else "auto")

    def frame(self) -> pl.DataFrame:
        """Returns all rows in memory."""
        return self.lazy().collect()

    def close(self) -> None:
        """Drops the rows and removes the temporary folder."""
        self._held, self._parts, self._bytes, self._height = [], [], 0, 0
        if self._home is not None:
            shutil.rmtree(self._home, ignore_errors=True)

    def _rest(self) -> pl.DataFrame:
        """Joins the rows in memory to one table and returns it."""
        if len(self._held) != 1:
            self._held = [pl.concat(self._held) if self._held else pl.DataFrame(schema=self._schema)]
        return self._held[0]

    def _write(self) -> None:
        part = Path()
        try:
            if self._home is None:
                self._home = self._make_home()
                weakref.finalize(self, shutil.rmtree, self._home, ignore_errors=True)
            part = self._home / f"{len(self._parts):06}.parquet"
            part = part.absolute()  # to polars a tilde is somebody's home
            self._rest().write_parquet(part, compression="zstd", compression_level=1, row_group_size=GROUP)
        except (OSError, pl.exceptions.ComputeError) as error:
            where, why = self._home or self._folder or tempfile.gettempdir(), reason(error, part)
            self.close()
            raise DiskError(f"cannot keep the steps of a run in '{where}': {why}") from None
        self._parts.append(part)
        self._held, self._bytes = [], 0

    def _make_home(self) -> Path:
        if self._folder is None:
            return scratch()
        self._folder.mkdir(parents=True, exist_ok=True)
        return scratch(".steps", self._folder)

    def _source(
        self, with_columns: list[str] | None, predicate: pl.Expr | None, n_rows: int | None, batch_size: int | None
    ) -> Iterator[pl.DataFrame]:
        """Yields the rows the way polars asks an IO source for them."""
        for chunk in self.chunks(with_columns):
            for rows in chunk.iter_slices(SLICE):
                taken = rows if n_rows is None else rows.head(n_rows)
                yield taken if predicate is None else taken.filter(predicate)
                if n_rows is not None:
                    n_rows -= len(taken)
                    if n_rows == 0:
                        return


def spools(count: int, schema: Schema, folder: Path | None = None) -> list[Spool]:
    """Makes the spools for the tables of one walk. The more there are, the less each keeps in memory.

    Args:
        count: number of tables.
        schema: name → type of every column.
        folder: where long tables go; None for the system's temporary folder.
    """
    return [Spool(schema, folder, min(HELD, HELD_TOGETHER // count)) for _ in range(count)]
