"""The ledger of a case: which units a suite has finished, so that it can resume. Kept in ``units.json``."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from oarlock.base.errors import InputError
from oarlock.base.files import uninterrupted, write_bytes
from oarlock.tables import checksums
from oarlock.tables.folder import ResultFolder, Sums

NAME = "units.json"
"""Name of the file of a ledger."""

TABLE = "sweep.csv"
"""Name of the file with the table of a sweep."""

_KEYS = {"digest", "status", "message", "seconds", "point", "rows", "files", "model"}


@dataclass(frozen=True)
class Failure:
    """Why a unit was not finished.

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
    """What a unit returned.

    Attributes:
        failure: why it was not finished; None if it was.
        seconds: time that it took, s.
        rows: one summary row per run; at a point of a sweep with the point and the size of the model there.
        files: name within the folder of results → contents: the tables and, from a case's first unit, the truth.
        model: description of the model, from a case's first unit.
        sketch: drawing of the model, from a case's first unit.
    """

    failure: Failure | None = None
    seconds: float = 0.0
    rows: list[dict[str, Any]] = field(default_factory=list)
    files: dict[str, bytes] = field(default_factory=dict)
    model: dict[str, Any] | None = None
    sketch: dict[str, Any] | None = None


class Ledger:
    """The finished and failed units of one case.

    Attributes:
        folder: folder of results of the case.
        case: name of the case.
        refused: why the case cannot be run at all; empty if it can.
        entries: name of a unit → digest, status, message, seconds, point, rows, files (name → checksum), model.
    """

    def __init__(self, folder: ResultFolder, case: str, refused: str = "", entries: dict[str, Any] | None = None):
        self.folder = folder
        self.case = case
        self.refused = refused
        self.entries: dict[str, dict[str, Any]] = entries or {}

    @classmethod
    def read(cls, path: Path, case: str = "", *, strict: bool = False) -> "Ledger":
        """Reads the ledger of a folder; an empty one if there is none.

        Args:
            path: the folder.
            case: name of the case, of an empty ledger.
            strict: whether one that cannot be read, or is not what was written, is an error; otherwise as if there
                were none, so that everything is done again.

        Raises:
            InputError: as ``strict`` says.
        """
        folder = ResultFolder(path)
        try:
            content = folder.read_json(NAME)
            entries = content["units"]
            if all(set(entry) == _KEYS for entry in entries.values()):
                return cls(folder, content["case"], content["refused"], entries)
        except InputError:
            if strict and (path / NAME).exists():
                raise
        except (KeyError, TypeError, AttributeError):
            pass
        if strict and (path / NAME).exists():
            raise InputError(f"'{path / NAME}' is not a ledger, expected what 'oarlock suite --out' wrote")
        return cls(folder, case)

    def write(self) -> None:
        """Writes the ledger.

        Raises:
            InputError: the folder cannot be written.
        """
        self.folder.write_json(NAME, {"case": self.case, "refused": self.refused, "units": self.entries})

    def finished(self, unit: str, digest: str) -> bool:
        """Tells whether a unit was finished with the same digest and its tables are still there, unchanged."""
        entry = self.entries.get(unit)
        if entry is None or entry["status"] != "done" or entry["digest"] != digest:
            return False
        return all(checksums.of_file(self.folder.path / name) == mark for name, mark in entry["files"].items())

    def keep(self, unit: str, digest: str, point: dict[str, Any], outcome: Outcome) -> None:
        """Writes what a unit returned, all of it or nothing; the tables first, so that what the ledger names exists.

        Args:
            unit: name of the unit.
            digest: digest of everything that the unit depends on.
            point: key → value at a point of a sweep; empty for the case's own runs.
            outcome: what the unit returned.

        Raises:
            InputError: the folder cannot be written.
        """
        with uninterrupted():
            self._keep(unit, digest, point, outcome)

    def _keep(self, unit: str, digest: str, point: dict[str, Any], outcome: Outcome) -> None:
        files = dict(outcome.files)
        if outcome.sketch is not None:
            files["sketch.json"] = checksums.sealed(outcome.sketch, 1)
        marks = {}
        for name, content in files.items():
            path = self.folder.path / name
            write_bytes(path, content)
            marks[name] = checksums.of_bytes(content)
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
        """Drops units that are no longer planned and puts the rest in the order of the plan.

        Args:
            units: names of the planned units, in order.
        """
        entries = {name: self.entries[name] for name in units if name in self.entries}
        if list(entries) != list(self.entries):
            self.entries = entries
            self.write()

    def seconds(self, unit: str) -> float | None:
        """Returns the time (s) that a unit took when it was last finished; None if it never was."""
        entry = self.entries.get(unit)
        return entry["seconds"] if entry and entry["status"] == "done" else None

    def rows(self, *, sweep: bool = False) -> list[dict[str, Any]]:
        """Returns the summary rows of the finished units: of the case's own experiments, or of a sweep."""
        done = [entry for entry in self.entries.values() if entry["status"] == "done" and bool(entry["point"]) == sweep]
        return [row for entry in done for row in entry["rows"]]

    def sums(self) -> Sums:
        """Returns the checksums of the tables of the finished units, by their names within the folder."""
        done = [entry["files"] for entry in self.entries.values() if entry["status"] == "done"]
        return {name: mark for files in done for name, mark in files.items() if name.endswith(".parquet")}

    def model(self) -> dict[str, Any] | None:
        """Returns the description of the model; None if the unit that gives it was not finished."""
        return next((entry["model"] for entry in self.entries.values() if entry["model"]), None)

    def failures(self) -> dict[str, Failure]:
        """Returns why units were not finished, by name of the unit."""
        return {
            name: Failure(entry["status"], entry["message"])
            for name, entry in self.entries.items()
            if entry["status"] != "done"
        }
