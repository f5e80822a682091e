"""The two folders of a program: what is asked (ASK), and its answer (ANSWER), written whole or not at all."""

# pyright: reportMissingImports=false

import json
import os
import shutil
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

FORMAT = 1

NOT_EXPRESSIBLE = 3
"""Exit status: the engine has no words for the model, or for the question."""

_PERIOD = 50
"""Lines of progress of a whole answer, at most."""


@dataclass(frozen=True)
class Ask:
    """What is asked.

    Attributes:
        question: ``forward``, ``step``, ``run`` or ``time``.
        settings: the engine's own.
        arrays: every numeric array and size of the compiled model under its own name, and the names of its elements.
        states: columns of the states, arrays (n) or (n, k).
        document: all of ``ask.json``.
    """

    question: str
    settings: dict[str, Any]
    arrays: dict[str, np.ndarray]
    states: dict[str, np.ndarray]
    document: dict[str, Any]

    @classmethod
    def read(cls, folder: Path) -> "Ask":
        """Reads a folder."""
        document = json.loads((folder / "ask.json").read_text(encoding="utf-8"))
        if document.get("format") != FORMAT:
            raise SystemExit(f"format {document.get('format')} of ask.json, expected {FORMAT}")
        with np.load(folder / "model.npz", allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        table = pq.read_table(folder / "states.parquet")
        states = {name: _column(table.column(name)) for name in table.column_names}
        return cls(document["question"], document.get("settings") or {}, arrays, states, document)

    @property
    def count(self) -> int:
        """Number of states."""
        return len(self.states["time"])

    @property
    def timestep(self) -> float:
        """Of a step, s."""
        return float(self.document.get("timestep") or self.arrays["opt_timestep"])


def _column(column: Any) -> np.ndarray:
    if not pa.types.is_list(column.type) and not pa.types.is_large_list(column.type):
        return column.to_numpy()
    flat = column.combine_chunks().flatten().to_numpy(zero_copy_only=False)
    return np.asarray(flat, dtype=float).reshape(len(column), -1)


@dataclass
class Answer:
    """What is answered; ``write`` puts it in its folder.

    Attributes:
        engine: name of the engine.
        versions: package → version.
        expressed: kinds of elements that the engine was given.
        missing: elements that it has no words for, each with why.
        facts: what lets the cause of a difference be told.
        rows: columns of a row a state, or a recorded step.
    """

    engine: str
    versions: dict[str, str]
    precision: str = "float64"
    expressed: list[str] = field(default_factory=list)
    missing: list[dict[str, str]] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    rows: dict[str, list[Any]] = field(default_factory=dict)

    def add(self, **values: Any) -> None:
        """Adds a row: numbers, or arrays (k)."""
        for name, value in values.items():
            value = float(value) if np.ndim(value) == 0 else np.asarray(value, dtype=float).tolist()
            self.rows.setdefault(name, []).append(value)

    def write(self, folder: Path) -> int:
        """Writes the folder and returns the exit status of the program.

        Raises:
            ArithmeticError: a number is not finite.
        """
        for name, values in self.rows.items():
            for at, value in enumerate(values):
                if not np.isfinite(value).all():
                    raise ArithmeticError(f"{name} of row {at} is not finite")
        document = {
            "format": FORMAT,
            "engine": self.engine,
            "versions": self.versions,
            "precision": self.precision,
            "expressed": self.expressed,
            "not_expressible": self.missing,
            "facts": self.facts,
        }
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        try:
            (temporary / "answer.json").write_text(json.dumps(document, indent=1), encoding="utf-8")
            if not self.missing:
                pq.write_table(pa.table(self.rows), temporary / "answer.parquet")
            if folder.is_dir() and not any(folder.iterdir()):
                folder.rmdir()
            os.replace(temporary, folder)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
        return NOT_EXPRESSIBLE if self.missing else 0


def progress(done: int, of: int) -> None:
    """Says now and then how far the program has come."""
    if done == of or done % max(1, of // _PERIOD) == 0:
        print(json.dumps({"done": done, "of": of}), flush=True)


def folders(arguments: Sequence[str]) -> tuple[Path, Path]:
    """The folders of the question and of the answer, from the arguments of the program."""
    if len(arguments) != 3:
        raise SystemExit(f"usage: {Path(arguments[0]).name} ASK ANSWER")
    return Path(arguments[1]), Path(arguments[2])


def hide(script: str) -> None:
    """Takes the folder of a script off the path, where the script itself has the name of its engine's package."""
    here = Path(script).resolve().parent
    sys.path[:] = [entry for entry in sys.path if Path(entry or os.curdir).resolve() != here]
