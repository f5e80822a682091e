"""The rows of one run on their way: kept as they were seen, with the figures computed of many steps at once.

On six numbers a call of NumPy costs as much as on six thousand.
"""

from collections.abc import Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from oarlock.base.arrays import largest, relative_difference
from oarlock.base.vectors import times
from oarlock.stepping.figures import solving
from oarlock.stepping.prepared import Prepared
from oarlock.tables.columns import steps_table
from oarlock.tables.spool import Spool

RECORDED = 2000
"""Rows that a recorder holds at most."""

HELD = 4 * 2**20
"""Bytes of them that it holds, about."""

NOTHING = np.zeros(0)
"""Stands in a row for what does not apply."""


class Row(NamedTuple):
    """The vectors of the state at the start of one step; of many steps each is an array (steps, …).

    Attributes:
        place: what the outside truth speaks of, as ``Prepared.place``.
        jacobian: J, flat, (ne nv).
        qacc: the run's acceleration, (nv).
        multipliers: and its multipliers, (ne).
        qfrc: and its constraint force, (nv), where it is held against MuJoCo's.
        minimum: the minimum-norm multipliers, (ne).
        mujoco_qacc, mujoco_qfrc: MuJoCo's own, (nv).
    """

    qpos: np.ndarray
    place: np.ndarray
    residual: np.ndarray
    rate: np.ndarray
    curvature: np.ndarray = NOTHING
    jacobian: np.ndarray = NOTHING
    qacc: np.ndarray = NOTHING
    multipliers: np.ndarray = NOTHING
    minimum: np.ndarray = NOTHING
    qfrc: np.ndarray = NOTHING
    mujoco_qacc: np.ndarray = NOTHING
    mujoco_qfrc: np.ndarray = NOTHING


class Recorder:
    """Collects the rows of one run, and hands them over in blocks.

    A step is noted while its vectors hold, and counts once it has come to its end.
    """

    def __init__(self, prepared: Prepared, spool: Spool):
        self._prepared, self._spool = prepared, spool
        self._noted: tuple[bytes, dict[str, Any]] = b"", {}
        self._vectors: list[bytes] = []
        self._figures: list[dict[str, Any]] = []
        self._length, self._room = -1, RECORDED
        self._ends: list[int] = []

    def note(self, row: Row, **figures: Any) -> None:
        """The start of a step: its vectors (contiguous), which are copied, and figures that are columns as they are."""
        buffers: Any = row
        vectors = b"".join(buffers)  # an array would take seven times as long
        if len(vectors) != self._length:  # the number of constraint rows has changed
            self._hand_over()
            self._length = len(vectors)
            self._room = min(RECORDED, 1 + HELD // len(vectors))
            self._ends = np.cumsum([len(vector) for vector in row])[:-1].tolist()
        self._noted = vectors, figures

    def end(self, **figures: Any) -> None:
        """Its end, with more figures.

        Besides columns these are the ``infos`` of its solves, the first one's before the others', and the
        ``reference`` solver's.
        """
        vectors, noted = self._noted
        self._vectors.append(vectors)
        self._figures.append(noted | figures)
        if len(self._vectors) >= self._room:
            self._hand_over()

    def steps(self) -> Spool:
        """The rows."""
        self._hand_over()
        return self._spool

    def _hand_over(self) -> None:
        height = len(self._vectors)
        if not height:
            return
        whole = np.frombuffer(b"".join(self._vectors)).reshape(height, -1)
        rows = Row(*np.split(whole, self._ends, axis=1))
        names = dict.fromkeys(chain.from_iterable(self._figures))
        figures: dict[str, list[Any]] = {name: [figures.get(name) for figures in self._figures] for name in names}
        self._vectors, self._figures = [], []
        infos, references = figures.pop("infos", []), figures.pop("reference", None)
        columns = {**self._columns(rows, figures["step"]), **figures}
        if infos:
            columns |= solving(infos, references)
        self._spool.append(steps_table(columns, height))

    def _columns(self, rows: Row, steps: Sequence[int]) -> dict[str, Any]:
        """What follows of the vectors."""
        columns = {
            "qpos": _lists(rows.qpos),
            "drift_pos": largest(rows.residual),
            "drift_vel": largest(rows.rate),
        }
        if rows.place.size:
            columns["truth_error"] = "nullable", self._prepared.truth_errors(np.array(steps), rows.place)
        if rows.qacc.size:
            jacobian = rows.jacobian.reshape(*rows.residual.shape, rows.qacc.shape[1])
            columns["drift_acc"] = largest(times(jacobian, rows.qacc) + rows.curvature)
            columns["residual"] = _lists(rows.residual)
            columns["multipliers"] = _lists(rows.multipliers)
        if rows.minimum.size:
            columns["min_norm_error"] = relative_difference(rows.multipliers, rows.minimum)
        if rows.mujoco_qacc.size:
            columns["qacc_rel_diff"] = relative_difference(rows.qacc, rows.mujoco_qacc)
            columns["qfrc_constraint_rel_diff"] = relative_difference(rows.qfrc, rows.mujoco_qfrc)
        return columns


def _lists(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A column of lists, of vectors (steps, n)."""
    return vectors.ravel(), np.full(len(vectors), vectors.shape[1])
