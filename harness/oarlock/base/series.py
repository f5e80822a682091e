"""Files of what was logged: columns of numbers over time, from CSV with a header or an NPZ file of arrays."""

import csv
import io
import math
import zipfile
from pathlib import Path

import numpy as np

from oarlock.base.errors import InputError, one_line
from oarlock.base.files import read_bytes, reason
from oarlock.base.text import short_name

TIME = "time"
"""Name of the column of times, s."""

FILE_BYTES = 2**28
"""Of a file, and of the arrays of an NPZ file together."""


def read_series(path: Path, *, tables: bool = False) -> dict[str, np.ndarray]:
    """Reads the columns of a file, name → finite numbers, (rows).

    Args:
        path: a file whose name ends in ``.npz``, or CSV in UTF-8.
        tables: whether an array of an NPZ file may have several numbers a row.

    Raises:
        InputError: it cannot be read, or a value is not a finite number; it names both.
    """
    return _read_npz(path, tables) if path.suffix.lower() == ".npz" else _read_csv(path)


def pop_time(path: Path, columns: dict[str, np.ndarray], others: str) -> np.ndarray:
    """Takes the column of times (rows) out of the columns of a file.

    Args:
        path: for messages.
        columns: of the file.
        others: what it has besides.

    Raises:
        InputError: there is none, it has no row, its times do not rise, or another column has more or fewer rows.
    """
    if TIME not in columns:
        raise InputError(f"{path}: no column '{TIME}', expected one, in s, besides {others}")
    time = columns.pop(TIME)
    if not len(time):
        raise InputError(f"{path}: no rows, expected at least one")
    for name, values in columns.items():
        if len(values) != len(time):
            raise InputError(f"{path}: column '{name}' has {len(values)} values, expected {len(time)}, as '{TIME}'")
    late = np.flatnonzero(np.diff(time) <= 0)
    if len(late):
        row = int(late[0]) + 1
        raise InputError(
            f"{path}: column '{TIME}', row {row + 1}: {float(time[row])!r} after {float(time[row - 1])!r}, expected a "
            "later time"
        )
    return time


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


def _read_npz(path: Path, tables: bool) -> dict[str, np.ndarray]:
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
        if values.ndim not in ((1, 2) if tables else (1,)) or values.dtype.kind not in "iuf":
            said = f"an array of {values.dtype} of the shape {values.shape}"
            wanted = "numbers, a row a time" if tables else "a vector of numbers"
            raise InputError(f"{path}: column '{short_name(name)}' is {said}, expected {wanted}")
        found[name] = values.astype(float)
        bad = np.argwhere(~np.isfinite(found[name]))
        if len(bad):
            value = float(found[name][tuple(bad[0])])
            raise InputError(
                f"{path}: column '{short_name(name)}', row {int(bad[0][0]) + 1}: {value}, expected a finite number"
            )
    return found
