"""What an engine answered: read back, and checked before anything is computed from it."""

import io
import json
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import polars as pl

from oarlock.base.errors import one_line
from oarlock.base.numbers import short
from oarlock.engines.running import NOT_EXPRESSIBLE, EngineError
from oarlock.mechanics.bounds import HUGE

FORMAT = 1

_WHAT = {"qacc": "nv", "qfrc_constraint": "nv", "qpos": "nq", "qvel": "nv"}
"""Column → the size of its entries."""


@dataclass(frozen=True)
class Answer:
    """An answer to one question.

    Attributes:
        engine: how it calls itself.
        versions: package → version.
        precision: that it says that it has.
        expressed: kinds of elements that it had.
        not_expressible: what of the question it could not express: ``element`` and ``why`` of each.
        facts: by which causes are told, see ``facts`` of the programs.
        time: of each row (n), s; empty of one that could not be expressed.
        qacc, qfrc_constraint, qvel: (n, nv); qpos: (n, nq).
        qacc_again: (n, nv), of the same states asked about once more, each right after itself; None where it was not.
        loop_error: of a run, the largest deviation of a row since the record before (n); None where it does not say.
        ended: why a run has no figures; empty if it has.
    """

    engine: str
    versions: dict[str, str]
    precision: str
    expressed: list[str]
    not_expressible: list[dict[str, str]]
    facts: dict[str, Any]
    time: np.ndarray = field(default_factory=lambda: np.zeros(0))
    qacc: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    qfrc_constraint: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    qpos: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    qvel: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    qacc_again: np.ndarray | None = None
    loop_error: np.ndarray | None = None
    ended: str = ""

    @property
    def expressible(self) -> bool:
        """Whether the question was answered."""
        return len(self.time) > 0


def read(files: dict[str, bytes], nq: int, nv: int, count: int, status: int = 0, *, run: bool = False) -> Answer:
    """Reads what a program left for a question.

    Args:
        files: name → contents.
        nq: positions of the model.
        nv: velocities of the model.
        count: rows that the question asks for.
        status: exit status of the program.
        run: whether it is a run, whose start may be recorded too, in front.

    Raises:
        EngineError: an answer is missing, or is no answer: a row too many or too few, a wrong size, a NaN.
    """
    document = _document(files)
    answer = Answer(
        str(document["engine"]),
        {str(name): str(version) for name, version in document["versions"].items()},
        str(document["precision"]),
        [str(one) for one in document.get("expressed", ())],
        [{"element": str(one["element"]), "why": str(one["why"])} for one in document.get("not_expressible", ())],
        dict(document.get("facts", {})),
    )
    if "answer.parquet" not in files:
        if status == NOT_EXPRESSIBLE and answer.not_expressible:
            return answer
        raise EngineError("no answer.parquet, expected a row a state, or exit status 3 and what cannot be expressed")
    try:
        table = pl.read_parquet(io.BytesIO(files["answer.parquet"]))
    except (OSError, pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
        raise EngineError(f"answer.parquet cannot be read: {one_line(error)[:120]}") from None
    if run and len(table) == count + 1:
        table = table.tail(count)
    if len(table) != count:
        raise EngineError(f"answer.parquet has {len(table)} rows, expected {count}")
    sizes = {"nv": nv, "nq": nq}
    if run and (ended := _diverged(table)):
        return replace(answer, ended=ended)
    columns: dict[str, Any] = {"time": _column(table, "time", None)}
    for name, size in _WHAT.items():
        columns[name] = _column(table, name, sizes[size])
    if "qacc_again" in table.columns:
        columns["qacc_again"] = _column(table, "qacc_again", nv)
    if "loop_error" in table.columns:
        columns["loop_error"] = _column(table, "loop_error", None)
    return Answer(**{**vars(answer), **columns})


def _diverged(table: pl.DataFrame) -> str:
    """Of a run that does not stay finite, in words: that is no fault of whoever answers."""
    for name in ("qpos", "qvel"):
        for row, values in enumerate(table[name].to_list() if name in table.columns else ()):
            numbers = np.array(values, dtype=float)
            if not (np.isfinite(numbers).all() and np.abs(numbers).max(initial=0.0) < HUGE):
                time = table["time"][row] if "time" in table.columns else None
                at = f" to t = {short(time)} s" if time is not None and np.isfinite(time) else ""
                return f"its run does not stay finite{at}"
    return ""


def _document(files: dict[str, bytes]) -> dict[str, Any]:
    if "answer.json" not in files:
        raise EngineError("no answer.json, expected one with format, engine, versions and precision")
    try:
        document = json.loads(files["answer.json"])
        known = document["format"] == FORMAT and isinstance(document["versions"], dict)
        known = known and {"engine", "precision"} <= set(document)
    except (ValueError, KeyError, TypeError) as error:
        raise EngineError(f"answer.json is not as expected: {type(error).__name__} {one_line(error)[:80]}") from None
    if not known:
        raise EngineError(f"answer.json is not of format {FORMAT}, expected engine, versions and precision")
    return document


def _column(table: pl.DataFrame, name: str, size: int | None) -> np.ndarray:
    if name not in table.columns:
        raise EngineError(f"answer.parquet has no column '{name}'")
    wanted = (len(table),) if size is None else (len(table), size)
    try:
        values = np.array(table[name].to_list(), dtype=float)
    except (ValueError, TypeError):
        raise EngineError(f"{name} has entries of several sizes, expected {size} numbers each") from None
    if size == 0:
        values = values.reshape(wanted)
    if values.shape != wanted:
        shape = values.shape[1:] or ("no list",)
        raise EngineError(f"{name} has entries of size {shape[0]}, expected {'one number' if size is None else size}")
    if not np.isfinite(values).all():
        row = int(np.argwhere(~np.isfinite(values).reshape(len(values), -1).all(axis=1))[0, 0])
        raise EngineError(f"{name} of row {row} is not finite, expected numbers")
    return values
