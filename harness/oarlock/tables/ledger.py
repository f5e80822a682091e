"""What of a case a suite has finished, in ``units.json`` beside the case's tables: the ground to resume on."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from oarlock.base.errors import InputError
from oarlock.base.files import replacing, uninterrupted
from oarlock.base.hashing import of_text
from oarlock.tables.folder import ResultFolder

NAME = "units.json"
"""File of a ledger."""

TABLE = "sweep.csv"
"""File of the table of a sweep."""

_TAIL = 65536
_KEYS = {"digest", "status", "message", "seconds", "point", "rows", "files", "model"}


@dataclass(frozen=True)
class Failure:
    """Why a unit was not done.

    Attributes:
        status: ``refused`` (bad input) or ``failed`` (anything else).
        message: the reason, in one line.
    """

    status: str
    message: str

    def __str__(self) -> str:
        return f"{self.status}: {self.message}"


@dataclass(frozen=True)
class Outcome:
    """What a unit gave.

    Attributes:
        failure: why it was not done; None if it was.
        seconds: time it took.
        rows: one summary row per run; at a point of a sweep with the point, and the size of the model there.
        files: name within the folder of results → contents: the tables, and from the first unit the truth.
        model: description of the model, from the first unit.
        sketch: its drawing, from the first unit.
    """

    failure: Failure | None = None
    seconds: float = 0.0
    rows: list[dict[str, Any]] = field(default_factory=list)
    files: dict[str, bytes] = field(default_factory=dict)
    model: dict[str, Any] | None = None
    sketch: dict[str, Any] | None = None


def fingerprint(path: Path) -> str | None:
    """Size and end of a file: a Parquet file ends with the statistics of all its columns. None if it is not there."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(0, size - _TAIL))
            return f"{size}-{of_text(file.read().hex())}"
    except OSError:
        return None


class Ledger:
    """The finished and the failed units of one case.

    Attributes:
        case: name of the case.
        refused: why the case cannot be run at all; empty if it can.
        entries: name of a unit → digest, status, message, seconds, point, rows, files (name → fingerprint), model.
    """

    def __init__(self, folder: ResultFolder, case: str, refused: str = "", entries: dict[str, Any] | None = None):
        self.folder = folder
        self.case = case
        self.refused = refused
        self.entries: dict[str, dict[str, Any]] = entries or {}

    @classmethod
    def read(cls, path: Path, case: str = "") -> "Ledger":
        """The ledger of a folder; an empty one where there is none or what there is cannot be read."""
        folder = ResultFolder(path)
        try:
            content = folder.read_json(NAME)
            entries = content["units"]
            if all(set(entry) == _KEYS for entry in entries.values()):
                return cls(folder, content["case"], content["refused"], entries)
        except (InputError, KeyError, TypeError, AttributeError):
            pass
        return cls(folder, case)

    def write(self) -> None:
        """Keeps it."""
        self.folder.write_json(NAME, {"case": self.case, "refused": self.refused, "units": self.entries})

    def finished(self, unit: str, digest: str) -> bool:
        """Whether the unit was done with the same digest, and its tables are still there."""
        entry = self.entries.get(unit)
        if entry is None or entry["status"] != "done" or entry["digest"] != digest:
            return False
        return all(fingerprint(self.folder.path / name) == mark for name, mark in entry["files"].items())

    def keep(self, unit: str, digest: str, point: dict[str, Any], outcome: Outcome) -> None:
        """Keeps what a unit gave, all of it or nothing: its tables first, so that what the ledger names is there.

        Args:
            unit: its name.
            digest: of everything it depends on.
            point: key → value, of a sweep; empty for the case's own runs.
            outcome: what it gave.

        Raises:
            InputError: the folder cannot be written.
        """
        with uninterrupted():
            self._keep(unit, digest, point, outcome)

    def _keep(self, unit: str, digest: str, point: dict[str, Any], outcome: Outcome) -> None:
        files = dict(outcome.files)
        if outcome.sketch is not None:
            files["sketch.json"] = (json.dumps(outcome.sketch, indent=1, ensure_ascii=False) + "\n").encode()
        marks = {}
        for name, content in files.items():
            path = self.folder.path / name
            with replacing(path) as temporary:
                temporary.write_bytes(content)
            marks[name] = fingerprint(path)
        failure = outcome.failure
        self.entries[unit] = {
            "digest": digest,
            "status": failure.status if failure else "done",
            "message": failure.message if failure else "",
            "seconds": round(outcome.seconds, 3),
            "point": point,
            "rows": outcome.rows,
            "files": marks,
            "model": outcome.model,
        }
        self.write()

    def settle(self, units: list[str]) -> None:
        """Forgets units that are no longer planned, and puts the rest in the order of the plan."""
        entries = {name: self.entries[name] for name in units if name in self.entries}
        if list(entries) != list(self.entries):
            self.entries = entries
            self.write()

    def seconds(self, unit: str) -> float | None:
        """Time that the unit took when it was last done; None if it never was."""
        entry = self.entries.get(unit)
        return entry["seconds"] if entry and entry["status"] == "done" else None

    def rows(self, *, sweep: bool = False) -> list[dict[str, Any]]:
        """Summary rows of the units that were done: of the case's own experiments, or of a sweep."""
        done = [entry for entry in self.entries.values() if entry["status"] == "done" and bool(entry["point"]) == sweep]
        return [row for entry in done for row in entry["rows"]]

    def model(self) -> dict[str, Any] | None:
        """The description of the model, if the unit that gives it was done."""
        return next((entry["model"] for entry in self.entries.values() if entry["model"]), None)

    def failures(self) -> dict[str, Failure]:
        """Name of a unit that was not done → why."""
        return {
            name: Failure(entry["status"], entry["message"])
            for name, entry in self.entries.items()
            if entry["status"] != "done"
        }
