"""Logs of controls: what a controller wrote, as laws of time.

A CSV file has a header, ``time`` and the names of actuators, and a row a time (s); an NPZ file has an array of each. A
value holds until the next one, as it does in the loop that wrote it; the first one also before its time.
"""

from collections.abc import Sequence
from pathlib import Path

from oarlock.base.core import TimeLaw
from oarlock.base.errors import InputError, choose
from oarlock.base.series import TIME, pop_time, read_series


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
        columns = read_series(path)
        self.time = pop_time(path, columns, "those of actuators")
        if not columns:
            raise InputError(f"{path}: no column besides '{TIME}', expected actuators: {', '.join(actuators)}")
        for name in columns:
            choose(f"actuator in the log {path}, column", name, actuators)
        self.columns = columns

    def laws(self) -> dict[str, TimeLaw]:
        """Actuator → its law."""
        return {name: TimeLaw.sampled(name, self.time, values) for name, values in self.columns.items()}

    def __str__(self) -> str:
        span = f"{len(self.time)} row{'s' if len(self.time) > 1 else ''}"
        if len(self.time) > 1:
            span += f" from {float(self.time[0]):g} to {float(self.time[-1]):g} s"
        return f"log '{self.path}' ({span}, each held until the next)"
