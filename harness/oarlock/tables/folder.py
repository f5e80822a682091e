"""Tables on disk: one Parquet file per run, and a summary with one row per run. Finished runs are never lost.

Every file is written under a temporary name and then moved, so that an interruption leaves whole files only. Every
document has its checksum, and the summary has those of the tables; both are verified where they are read.
"""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from oarlock.base.errors import InputError, one_line
from oarlock.base.files import read_bytes, reading, replacing, write_bytes
from oarlock.tables import checksums

if TYPE_CHECKING:
    from oarlock.tables.schema import RunResult

GROUP = 20_000
"""Rows per group of a Parquet file, which its writer and its reader hold in memory."""

SUMMARY, TRUTH = "summary.json", "truth.parquet"

FILES = "files"
"""Key of the summary: name of a table → its checksum."""

Sums = dict[str, str]
"""Name of a file within its folder → checksum."""

OCCASION = ("commit", "date", "cores", "kernel")
"""Keys of a provenance that differ from one occasion to the next."""


def occasion_of(provenance: dict[str, Any]) -> dict[str, Any]:
    """Returns the part of a provenance that differs from one occasion to the next; None for what it lacks."""
    return {key: provenance.get(key) for key in OCCASION}


def scan_parquet(path: Path) -> pl.LazyFrame:
    """The table in a file, to be read when it is needed.

    To polars a path is a pattern: brackets, asterisks and question marks select files, ``key=value`` adds a column, a
    tilde is somebody's home and ``file:`` the beginning of an address. Here every path names one file.
    """
    return pl.scan_parquet(_literal(path), glob=False, hive_partitioning=False)


def read_parquet(path: Path, columns: Sequence[str] | None = None) -> pl.DataFrame:
    """Reads a table, or some of its columns."""
    wanted = None if columns is None else list(columns)
    return pl.read_parquet(_literal(path), columns=wanted, glob=False, hive_partitioning=False)


def write_parquet(table: pl.LazyFrame, path: Path, group: int) -> None:
    """Writes a table in groups of so many rows, without having all of it in memory."""
    table.sink_parquet(_literal(path), compression="zstd", row_group_size=group)


def _literal(path: Path) -> Path:
    return path.absolute()


class ResultFolder:
    """A folder of results: ``steps/*.parquet``, ``summary.json``, ``case.json`` and ``sketch.json``.

    Methods that write raise InputError if a file cannot be written, those that read if it is missing or damaged.

    Attributes:
        path: path of the folder, which need not exist yet.
    """

    def __init__(self, path: Path):
        self.path = path
        self._sums: dict[str, Any] | None = None
        self._verified: set[str] = set()

    def write_steps(self, result: "RunResult") -> Sums:
        """Writes the steps of a finished run."""
        return self.write_table(result.key.slug, result.table())

    def write_table(self, slug: str, table: pl.LazyFrame) -> Sums:
        """Writes the table of the steps of a run; gives its name and checksum."""
        return self._write(steps_name(slug), table)

    def write_truth(self, truth: pl.DataFrame) -> Sums:
        """Writes the outside truth at times of the steps, with the columns time_s and position (rad or m)."""
        return self._write(TRUTH, truth.lazy())

    def _write(self, name: str, table: pl.LazyFrame) -> Sums:
        with replacing(self.path / name) as temporary:
            write_parquet(table, temporary, GROUP)
            return {name: str(checksums.of_file(temporary))}

    def read_truth(self) -> pl.DataFrame:
        """Reads the outside truth at times of the steps."""
        with reading(self.verified(TRUTH)) as path:
            return read_parquet(path)

    def forget_steps_but(self, slugs: list[str]) -> None:
        """Removes the steps of runs whose slugs are not given, which an earlier summary of this folder had."""
        for path in (self.path / "steps").glob("*.parquet"):
            if path.stem not in slugs:
                path.unlink()

    def read_steps(self, slug: str) -> pl.DataFrame:
        """Reads the steps of a run."""
        with reading(self.steps_path(slug)) as path:
            return read_parquet(path)

    @contextmanager
    def scanning(self, slug: str) -> Iterator[pl.LazyFrame]:
        """The steps of a run as a lazy table, to be evaluated within the block.

        Raises:
            InputError: the file is missing or damaged, or is not the one that the summary names.
        """
        with reading(self.verified(steps_name(slug))) as path:
            yield scan_parquet(path)

    def verified(self, name: str) -> Path:
        """The path of a table, once its contents were found to be what the summary says.

        Raises:
            InputError: it is not the table that was written with the summary.
        """
        path = self.path / name
        if name in self._verified:
            return path
        if self._sums is None:
            found = self.read_json(SUMMARY).get(FILES)
            self._sums = found if isinstance(found, dict) else {}
        if path.exists() and self._sums.get(name) != checksums.of_file(path):
            raise InputError(f"'{path}' is not what was written with '{SUMMARY}' (checksum), expected to be run again")
        self._verified.add(name)
        return path

    def steps_path(self, slug: str) -> Path:
        """Returns the path of the steps of a run."""
        return self.path / steps_name(slug)

    def write_json(self, name: str, content: dict[str, Any], *, indent: int | None = 1) -> None:
        """Writes a JSON document; with ``indent=None`` on one line, which takes a tenth of the time."""
        write_bytes(self.path / name, checksums.sealed(content, indent))

    def read_json(self, name: str, *, bare: bool = False) -> dict[str, Any]:
        """Reads a JSON document that ``write_json`` wrote.

        Args:
            name: of the file.
            bare: whether it may be without a checksum, as published summaries are.

        Raises:
            InputError: the file is missing, damaged, or not what was written.
        """
        path = self.path / name
        try:
            content = read_bytes(path)
            if not checksums.holds(content) and (checksums.has_seal(content) or not bare):
                json.loads(content)  # says more, if it is no JSON
                lacks = "is not what was written (checksum)" if checksums.has_seal(content) else "has no checksum"
                raise InputError(f"'{path}' {lacks}, expected what this version of oarlock wrote: run it again")
            document = json.loads(content)
        except FileNotFoundError:
            raise InputError(f"no '{path}', expected a folder that 'oarlock run --out' wrote") from None
        except InputError:
            raise
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(f"'{path}' cannot be read: {one_line(error)[:120]}") from None
        if not isinstance(document, dict):
            raise InputError(f"'{path}' holds no object, expected what 'oarlock run --out' wrote")
        document.pop(checksums.KEY, None)
        return document


def steps_name(slug: str) -> str:
    """Name of the table of the steps of a run, within a folder of results."""
    return f"steps/{slug}.parquet"


@contextmanager
def believing(path: Path) -> Iterator[None]:
    """Turns whatever goes wrong with the contents of a folder of results into a line that names it.

    Of results that were not written by oarlock anything may be missing, or of another kind, even with right checksums.

    Raises:
        InputError: something went wrong.
    """
    try:
        yield
    except InputError:
        raise
    except (Exception, pl.exceptions.PanicException) as error:
        said = f"{type(error).__name__}: {one_line(error)[:120]}"
        raise InputError(f"'{path}' does not hold what 'oarlock run --out' or 'oarlock suite' wrote: {said}") from error
