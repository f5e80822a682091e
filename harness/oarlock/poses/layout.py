"""The rows of a model's equalities in one order for a whole run."""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.cases.equality_kinds import KNOWN, TURN, EqualityKind
from oarlock.mechanics.names import Equality, equalities

SINE = "τ·sin(θ/2)"
"""Unit of a weld's rotation rows: torquescale τ, angle θ."""


@dataclass(frozen=True)
class Row:
    """One row of an equality; a coupling's has no label, for it has only one.

    Attributes:
        equality: whose it is; kind: of that.
        label: an axis, or ``turn x`` for a rotation row of a weld.
        unit: of its deviation; that of a rotation row is torquescale · sin(half the angle).
    """

    equality: str
    kind: EqualityKind
    label: str
    unit: str

    @property
    def turns(self) -> bool:
        """Whether it is a rotation row of a weld."""
        return self.label.startswith(TURN)

    @property
    def measure(self) -> str:
        """The unit as it is, where the deviation is no length and no angle."""
        return SINE if self.turns else self.unit

    def __str__(self) -> str:
        return f"{self.equality} {self.label}".strip()


def _rows(equality: Equality) -> list[Row]:
    def unit(label: str) -> str:
        if not equality.kind.joins_points:
            return equality.unit
        return "rad" if label.startswith(TURN) else "m"

    return [Row(equality.name, equality.kind, label, unit(label)) for label in equality.kind.labels or ()]


@dataclass(frozen=True)
class Layout:
    """The rows of a model's equalities in a fixed order, whichever of them MuJoCo makes at a step.

    MuJoCo leaves out an equality whose rows are all zero, and one that is not active has none.

    Attributes:
        equalities: those with rows, in MuJoCo's order.
        starts: first row of each of them.
        owner: row → place of its equality in ``equalities``, (rows).
        named: the rows.
        skipped: numbers of active equalities whose rows are not known: those of flexes.
    """

    equalities: tuple[Equality, ...]
    starts: tuple[int, ...]
    owner: np.ndarray
    named: tuple[Row, ...]
    skipped: tuple[int, ...] = ()

    @classmethod
    def of(cls, model: mujoco.MjModel, active: np.ndarray | None = None) -> "Layout":
        """Of the equalities that are active (neq), or that the model starts with."""
        active = model.eq_active0 if active is None else active
        chosen = tuple(equality for equality in equalities(model) if equality.kind.known and active[equality.index])
        counts = [equality.rows for equality in chosen]
        starts = tuple(np.concatenate([[0], np.cumsum(counts)])[:-1].astype(int).tolist())
        owner = np.repeat(np.arange(len(chosen)), counts)
        skipped = tuple(one.index for one in equalities(model) if not one.kind.known and active[one.index])
        return cls(chosen, starts, owner, tuple(row for one in chosen for row in _rows(one)), skipped)

    @property
    def labels(self) -> tuple[str, ...]:
        """What the rows are called."""
        return tuple(map(str, self.named))

    @property
    def units(self) -> tuple[str, ...]:
        """Of their deviations."""
        return tuple(row.unit for row in self.named)

    @property
    def rows(self) -> int:
        """How many rows there are."""
        return len(self.owner)

    def of_equality(self, place: int) -> slice:
        """The rows of one equality, by its place in ``equalities``."""
        start = self.starts[place]
        return slice(start, start + self.equalities[place].rows)

    def activate(self, data: mujoco.MjData) -> None:
        """Switches these equalities on in a data, and all others off."""
        data.eq_active[:] = 0
        data.eq_active[[one.index for one in self.equalities]] = 1

    def columns(self, owners: np.ndarray) -> np.ndarray:
        """Where MuJoCo's equality rows belong, given the equality of each, ``efc_id[:ne]`` without ``skipped``.

        Raises:
            InputError: an equality that was not active at the start.
        """
        first = {equality.index: start for equality, start in zip(self.equalities, self.starts, strict=True)}
        taken: dict[int, int] = {}
        found = np.empty(len(owners), dtype=int)
        for row, index in enumerate(owners.tolist()):
            if index not in first:
                raise InputError(
                    f"equality number {index} has rows of its own only now, "
                    f"expected {KNOWN} equalities that are active from the start"
                )
            found[row] = first[index] + taken.get(index, 0)
            taken[index] = taken.get(index, 0) + 1
        return found


class RowColumns:
    """Which columns of a layout the rows of a step go to; found anew only where MuJoCo's rows change."""

    def __init__(self, layout: Layout):
        self._layout = layout
        self._owners = b""
        self._count = 0
        self._columns: slice | np.ndarray = slice(0, 0)
        self._rows: slice | np.ndarray = slice(0, 0)

    def of(self, data: mujoco.MjData) -> "slice | np.ndarray":
        """At a state whose position stage is done; without the rows of equalities that the layout skips."""
        ids = data.efc_id[: data.ne]
        owners = ids.tobytes()
        if owners != self._owners or self._count != len(ids):
            kept = ~np.isin(ids, self._layout.skipped)
            self._rows = slice(0, len(ids)) if kept.all() else np.flatnonzero(kept)
            self._columns, self._owners, self._count = _together(self._layout.columns(ids[kept])), owners, len(ids)
        return self._columns

    def rows(self, data: mujoco.MjData) -> "slice | np.ndarray":
        """Which of MuJoCo's rows those are."""
        self.of(data)
        return self._rows


def _together(columns: np.ndarray) -> "slice | np.ndarray":
    """The same columns, as a slice where they are the first ones in their order: that costs less to write to."""
    count = len(columns)
    return slice(0, count) if np.array_equal(columns, np.arange(count)) else columns
