"""The kinds of equalities: what is known of each before there is a model.

Whoever deals with equalities asks their kind for a property, never for its name. What a kind needs of MuJoCo's arrays
is in ``mechanics/names.py`` (what points it joins) and ``mechanics/coupled.py`` (what it couples).
"""

from dataclasses import dataclass
from typing import Literal

from oarlock.base.errors import InputError
from oarlock.base.text import quoted

TURN = "turn "
"""Begins the label of a row that holds an orientation."""

_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class EqualityKind:
    """One kind of equality.

    Attributes:
        name: in messages, tables and JSON.
        holds: ``points``: a point of one body on a point of another; ``joints`` or ``tendons``: the position of the
            first to a polynomial of the second's; ``flex``: something of a flex.
        ends: attributes of its MJCF elements that say what is held.
        labels: of its rows, in MuJoCo's order; None where their number depends on the model.
        curvature_since: version from which on MuJoCo's reference acceleration contains J̇v; None: it never does.
        own_unit: unit of the rows' deviations; None: that of what is coupled.
        elements: MJCF elements, and members of mjtEq when written in capitals after ``mjEQ_``; by default the name.
    """

    name: str
    holds: Literal["points", "joints", "tendons", "flex"]
    ends: tuple[str, ...]
    labels: tuple[str, ...] | None
    curvature_since: tuple[int, ...] | None = None
    own_unit: str | None = None
    elements: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.elements:
            object.__setattr__(self, "elements", (self.name,))

    def __str__(self) -> str:
        return self.name

    @property
    def rows(self) -> int | None:
        """Rows of one that is active; None where their number depends on the model."""
        return None if self.labels is None else len(self.labels)

    @property
    def known(self) -> bool:
        """Whether its rows and their J̇v are known: an active equality of another kind is refused."""
        return self.labels is not None

    @property
    def joins_points(self) -> bool:
        """Whether its first three rows are the distance between points of two bodies."""
        return self.holds == "points"

    @property
    def turns(self) -> bool:
        """Whether it holds an orientation too, in rows 3 to 6."""
        return any(label.startswith(TURN) for label in self.labels or ())

    def lacks_curvature(self, version: tuple[int, ...]) -> bool:
        """Whether the reference acceleration of a version of MuJoCo, (3, 17, 0), lacks a J̇v that is known."""
        return self.known and (self.curvature_since is None or version < self.curvature_since)


_BODIES = ("body1", "body2", "site1", "site2")

KINDS = (
    EqualityKind("connect", "points", _BODIES, _AXES, curvature_since=(3, 7), own_unit="m"),
    EqualityKind(
        "weld",
        "points",
        _BODIES,
        (*_AXES, *(f"{TURN}{axis}" for axis in _AXES)),
        curvature_since=(3, 7),
        own_unit="m or rad",
    ),
    EqualityKind("joint", "joints", ("joint1", "joint2"), ("",)),
    EqualityKind("tendon", "tendons", ("tendon1", "tendon2"), ("",)),
    # MuJoCo makes a row for every edge of a flex that is not rigid.
    EqualityKind("flex", "flex", ("flex",), None, own_unit="m or rad", elements=("flex", "flexvert", "flexstrain")),
)

KIND_OF = {element: kind for kind in KINDS for element in kind.elements}
"""MJCF element → kind."""

*_FIRST, _LAST = [kind.name for kind in KINDS if kind.known]
KNOWN = f"{', '.join(_FIRST)} or {_LAST}"
"""The known kinds, in words."""


def unknown(name: str, kind: EqualityKind) -> InputError:
    """Says that an equality is of a kind whose rows are not known, and which are."""
    return InputError(f"equality {quoted(name)} is a {kind}, expected {KNOWN}")
