"""The rows of one run on their way: kept as they were seen, with the figures computed of many steps at once.

On six numbers a call of NumPy costs as much as on six thousand.
"""

from collections.abc import Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from oarlock.columns import steps_table
from oarlock.metrics import against_mujoco, drift, solving
from oarlock.setup import Setup
from oarlock.solvers import Answer, Solution
from oarlock.spool import Spool
from oarlock.state import Seen

RECORDED = 2000
"""Rows that a recorder holds at most."""

HELD = 4 * 2**20
"""Bytes of Jacobians that it holds, about."""


class Row(NamedTuple):
    """What one run saw at the start of one step, in arrays of its own; what does not apply is left out.

    Attributes:
        place: what the outside truth speaks of, as ``Setup.place``.
        qacc: the run's acceleration, (nv).
        multipliers: and its multipliers, (ne).
        answers: of its solver, one a stage.
        reference: of the reference solver, to the first one's question.
        mujoco: MuJoCo's own qacc and qfrc_constraint there, (nv).
    """

    step: int
    time_s: float
    qpos: np.ndarray
    place: np.ndarray
    seen: Seen
    qacc: np.ndarray | None = None
    multipliers: np.ndarray | None = None
    answers: Sequence[Answer] = ()
    reference: Solution | None = None
    mujoco: tuple[np.ndarray, np.ndarray] | None = None


class Recorder:
    """Collects the rows of one run, and hands them over in blocks."""

    def __init__(self, setup: Setup, spool: Spool):
        self._setup, self._spool = setup, spool
        self._rows: list[tuple[Row, dict[str, Any]]] = []
        self._room = 0

    def append(self, row: Row, **figures: Any) -> None:
        """One step, with figures that are columns as they are; what is not given is null."""
        if not self._rows:
            self._room = min(RECORDED, 1 + HELD // (1 + row.seen.jacobian.nbytes))
        self._rows.append((row, figures))
        if len(self._rows) >= self._room:
            self._hand_over()

    def steps(self) -> Spool:
        """The rows."""
        self._hand_over()
        return self._spool

    def _hand_over(self) -> None:
        rows, self._rows = self._rows, []
        # The number of constraint rows may change on the way.
        for _, block in groupby(rows, lambda pair: len(pair[0].seen.residual)):
            seen, figures = zip(*block, strict=True)
            self._spool.append(steps_table({**self._columns(seen), **_as_given(figures)}, len(seen)))

    def _columns(self, rows: Sequence[Row]) -> dict[str, Any]:
        """The columns of rows that all have the same."""
        first = rows[0]
        step = np.array([row.step for row in rows])
        seen = Seen(*map(np.array, zip(*(row.seen for row in rows), strict=True)))
        qacc = None if first.qacc is None else np.array([row.qacc for row in rows])
        columns = {
            "step": step,
            "time_s": np.array([row.time_s for row in rows]),
            "qpos": _lists([row.qpos for row in rows]),
            **drift(seen, qacc),
        }
        if self._setup.truth is not None:
            places = np.array([row.place for row in rows])
            columns["truth_error"] = ("nullable", self._setup.truth_errors(step, places))
        if qacc is not None:
            columns["residual"] = _lists(seen.residual)
            columns["multipliers"] = _lists([row.multipliers for row in rows])
        if first.answers:
            references = [row.reference for row in rows if row.reference is not None]
            columns |= solving([row.answers for row in rows], references)
        if first.mujoco is not None:
            theirs = [row.mujoco for row in rows if row.mujoco is not None]
            columns |= against_mujoco([row.answers[0] for row in rows], theirs)
        return columns


def _as_given(figures: Sequence[dict[str, Any]]) -> dict[str, list[Any]]:
    names = dict.fromkeys(name for given in figures for name in given)
    return {name: [given.get(name) for given in figures] for name in names}


def _lists(vectors: Any) -> tuple[np.ndarray, np.ndarray]:
    """A column of lists, of vectors of one length."""
    stacked = np.array(vectors)
    return stacked.ravel(), np.full(len(stacked), stacked.shape[1])
