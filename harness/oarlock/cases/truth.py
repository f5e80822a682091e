"""Outside truths: trajectories that no engine of the comparison computed."""

import csv
import io
from pathlib import Path

import numpy as np

from oarlock.base.errors import InputError, one_line
from oarlock.base.files import read_bytes
from oarlock.base.hermite import QuinticHermite
from oarlock.cases.case import Case

FILE_BYTES = 2**27
"""Of a table: some million rows."""

SHORTEST_S = 1e-12
"""Between two rows: the curve between them divides by the square of it."""

JOINT_COLUMNS = ["time", "position", "velocity", "acceleration"]
SITE_COLUMNS = ["time", "x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az"]


class TruthTrajectory:
    """A joint's coordinate or a site's place over time, interpolated by quintic Hermite polynomials.

    With rows every 2.5 ms the interpolation error stays below 1e-12 rad on the boat (a test measures it).

    Attributes:
        begin: first time of the table, s.
        end: last time of the table, s.

    Args:
        path: CSV file; lines that begin with ``#`` are comments.
        columns: its header.

    Raises:
        InputError: the file cannot be read, or is not a table of finite numbers at rising times with these columns.
    """

    def __init__(self, path: Path, columns: list[str] = JOINT_COLUMNS):
        try:
            text = io.StringIO(read_bytes(path, FILE_BYTES).decode(), newline="")
            rows = list(csv.reader(line for line in text if not line.startswith("#")))
        except (OSError, ValueError, csv.Error) as error:
            raise InputError(f"{one_line(path)}: cannot read the truth: {one_line(error)}") from None
        if not rows or rows[0] != columns:
            raise InputError(f"{path}: columns {rows[0] if rows else []}, expected {columns}")
        try:
            table = np.array(rows[1:], dtype=float)
        except ValueError as error:
            raise InputError(f"{path}: {error}") from None
        if table.ndim != 2 or table.shape[1] != len(columns):
            raise InputError(f"{path}: expected at least two rows of {len(columns)} numbers")
        if len(table) < 2 or not np.isfinite(table).all() or (np.diff(table[:, 0]) < SHORTEST_S).any():
            raise InputError(f"{path}: expected at least two rows of finite numbers with rising times")
        self.begin, self.end = float(table[0, 0]), float(table[-1, 0])
        self._curve = QuinticHermite(table[:, 0], table[:, 1:].reshape(len(table), 3, -1))

    def position(self, time: np.ndarray) -> np.ndarray:
        """Evaluates the coordinate (n, 1; rad or m) or the place (n, 3; m) at n times (s); NaN outside the table."""
        # Step times are sums of rounded steps: the last one may pass the end of the table by rounding.
        inside = (time >= self.begin) & (time <= self.end * (1 + 1e-12))
        return np.where(inside[:, None], self._curve(np.clip(time, self.begin, self.end)), np.nan)


def load_truth(case: Case) -> TruthTrajectory | None:
    """Loads the outside truth of a case; None if it has none.

    Raises:
        InputError: the table is missing or malformed.
    """
    if case.file.truth is None or case.truth_path is None:
        return None
    return TruthTrajectory(case.truth_path, JOINT_COLUMNS if case.file.truth.joint else SITE_COLUMNS)
