"""What of a case a suite has finished, in ``units.json`` beside the case's tables: the ground to resume on."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from oarlock import digest
from oarlock.errors import InputError
from oarlock.results import ResultFolder, replacing, uninterrupted
from oarlock.unit import Outcome, Unit

NAME = "units.json"
_TAIL = 65536
_KEYS = {"digest", "status", "message", "seconds", "point", "rows", "files", "model"}


def fingerprint(path: Path) -> str | None:
    """Size and end of a file: a Parquet file ends with the statistics of all its columns. None if it is not there."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(0, size - _TAIL))
            return f"{size}-{digest.of_text(file.read().hex())}"
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

    def finished(self, unit: Unit) -> bool:
        """Whether the unit was done, with all that it hangs on as it is now, and its tables are still there."""
        entry = self.entries.get(unit.name)
        if entry is None or entry["status"] != "done" or entry["digest"] != unit.digest:
            return False
        return all(fingerprint(self.folder.path / name) == mark for name, mark in entry["files"].items())

    def keep(self, unit: Unit, outcome: Outcome) -> None:
        """Keeps what a unit gave, all of it or nothing: its tables first, so that what the ledger names is there."""
        with uninterrupted():
            self._keep(unit, outcome)

    def _keep(self, unit: Unit, outcome: Outcome) -> None:
        files = dict(outcome.files)
        if outcome.sketch is not None:
            files["sketch.json"] = (json.dumps(outcome.sketch, indent=1, ensure_ascii=False) + "\n").encode()
        marks = {}
        for name, content in files.items():
            path = self.folder.path / name
            with replacing(path) as temporary:
                temporary.write_bytes(content)
            marks[name] = fingerprint(path)
        self.entries[unit.name] = {
            "digest": unit.digest,
            "status": outcome.status,
            "message": outcome.message,
            "seconds": round(outcome.seconds, 3),
            "point": dict(unit.point.values),
            "rows": outcome.rows,
            "files": marks,
            "model": outcome.model,
        }
        self.write()

    def settle(self, units: list[Unit]) -> None:
        """Forgets units that are no longer planned; the rest comes into the order of the plan."""
        entries = {unit.name: self.entries[unit.name] for unit in units if unit.name in self.entries}
        if list(entries) != list(self.entries):
            self.entries = entries
            self.write()

    def estimated(self, unit: Unit) -> Unit:
        """The unit with the time that it took before as its cost."""
        entry = self.entries.get(unit.name)
        return replace(unit, cost=entry["seconds"]) if entry and entry["status"] == "done" else unit

    def rows(self, *, sweep: bool = False) -> list[dict[str, Any]]:
        """Summary rows of the units that were done: of the case's own experiments, or of a sweep."""
        done = [entry for entry in self.entries.values() if entry["status"] == "done" and bool(entry["point"]) == sweep]
        return [row for entry in done for row in entry["rows"]]

    def model(self) -> dict[str, Any] | None:
        """The description of the model, if the unit that gives it was done."""
        return next((entry["model"] for entry in self.entries.values() if entry["model"]), None)

    def failures(self) -> dict[str, str]:
        """Name of a unit that was not done → why."""
        return {
            name: f"{entry['status']}: {entry['message']}"
            for name, entry in self.entries.items()
            if entry["status"] != "done"
        }
