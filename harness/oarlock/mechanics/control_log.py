"""Logs of controls: what a controller wrote, as laws of time.

A CSV file has a header, ``time`` and the names of actuators, and a row a time (s); an NPZ file has an array of each. A
value holds until the next one, as it does in the loop that wrote it; the first one also before its time.
"""

import csv
import io
import math
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from oarlock.base.core import TimeLaw
from oarlock.base.errors import InputError, choose, one_line
from oarlock.base.files import read_bytes, reason
from oarlock.base.text import short_name

TIME = "time"
"""Name of the column of times, s."""

FILE_BYTES = 2**28
"""Of a log, and of the arrays of an NPZ file together."""


class ControlLog:
    """A log of controls.

    Attributes:
        path: where it was read.
        time: s, rising, (rows).
        columns: actuator → its controls, (rows).

    Args:
        path: a file whose name ends in ``.csv`` or ``.npz``.
        actuators: names that its columns may have.

    Raises:
        InputError: it cannot be read, a column is no actuator's, or a value is not as expected; it names both.
    """

    def __init__(self, path: Path, actuators: Sequence[str]):
        self.path = path
        columns = _read_npz(path) if path.suffix.lower() == ".npz" else _read_csv(path)
        if TIME not in columns:
            raise InputError(f"{path}: no column '{TIME}', expected one, in s, besides those of actuators")
        self.time = columns.pop(TIME)
        if not len(self.time):
            raise InputError(f"{path}: no rows, expected at least one")
        if not columns:
            raise InputError(f"{path}: no column besides '{TIME}', expected actuators: {', '.join(actuators)}")
        for name, values in columns.items():
            choose(f"actuator in the log {path}, column", name, actuators)
            if len(values) != len(self.time):
                raise InputError(
                    f"{path}: column '{name}' has {len(values)} values, expected {len(self.time)}, as '{TIME}'"
                )
        late = np.flatnonzero(np.diff(self.time) <= 0)
        if len(late):
            row = int(late[0]) + 1
            raise InputError(
                f"{path}: column '{TIME}', row {row + 1}: {float(self.time[row])!r} after "
                f"{float(self.time[row - 1])!r}, expected a later time"
            )
        self.columns = columns

    def laws(self) -> dict[str, TimeLaw]:
        """Actuator → its law."""
        return {name: TimeLaw.sampled(name, self.time, values) for name, values in self.columns.items()}

    def __str__(self) -> str:
        span = f"{len(self.time)} row{'s' if len(self.time) > 1 else ''}"
        if len(self.time) > 1:
            span += f" from {float(self.time[0]):g} to {float(self.time[-1]):g} s"
        return f"log '{self.path}' ({span}, each held until the next)"


def _read_csv(path: Path) -> dict[str, np.ndarray]:
    try:
        text = read_bytes(path, FILE_BYTES).decode("utf-8-sig")
        rows = [row for row in csv.reader(io.StringIO(text, newline=""), strict=True) if row]
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from None
    except (ValueError, csv.Error) as error:
        raise InputError(f"{path}: not a CSV file in UTF-8: {one_line(error)}") from None
    names = [name.strip() for name in rows[0]] if rows else []
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{path}: column '{short_name(name)}' is there twice, expected once")
    for number, row in enumerate(rows[1:], 1):
        if len(row) != len(names):
            raise InputError(f"{path}: row {number} has {len(row)} values, expected {len(names)}")
    return {
        name: np.array([_number(path, name, number, row[at]) for number, row in enumerate(rows[1:], 1)])
        for at, name in enumerate(names)
    }


def _number(path: Path, column: str, row: int, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        said = short_name(text.strip())
        raise InputError(f"{path}: column '{column}', row {row}: '{said}', expected a finite number")
    return value


def _read_npz(path: Path) -> dict[str, np.ndarray]:
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(part.file_size for part in archive.infolist()) > FILE_BYTES:
                raise InputError(f"{path}: more than {FILE_BYTES} bytes, expected at most so many")
        with np.load(path, allow_pickle=False) as arrays:
            found = {name: np.asarray(arrays[name]) for name in arrays.files}
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from None
    except (ValueError, zipfile.BadZipFile, NotImplementedError, EOFError, MemoryError) as error:
        raise InputError(f"{path}: not an NPZ file of arrays of numbers: {one_line(error)}") from None
    for name, values in found.items():
        if values.ndim != 1 or values.dtype.kind not in "iuf":
            said = f"an array of {values.dtype} of the shape {values.shape}"
            raise InputError(f"{path}: column '{short_name(name)}' is {said}, expected a vector of numbers")
        found[name] = values.astype(float)
        bad = np.flatnonzero(~np.isfinite(found[name]))
        if len(bad):
            value = float(found[name][bad[0]])
            raise InputError(
                f"{path}: column '{short_name(name)}', row {int(bad[0]) + 1}: {value}, expected a finite number"
            )
    return found
