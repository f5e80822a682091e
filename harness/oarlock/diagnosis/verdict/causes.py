"""The causes of a drift in words: what tables call them, what sentences call them, and the finding that names each."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Cause:
    """A cause in words.

    Attributes:
        title: for the head of a column and the legend of a figure.
        phrase: for a sentence, after "82 % of it is".
        code: of the finding that names it.
    """

    title: str
    phrase: str
    code: str


CAUSE = {
    "compliance": Cause("softness", "softness", "D1"),
    "curvature": Cause("missing J̇v", "missing J̇v", "D2"),
    "solver": Cause("solver", "what the solver left", "D6"),
    "start": Cause("start", "the open start", "S1"),
    "stepping": Cause("time stepping", "time stepping", "D3"),
}
"""Cause → its words, for the causes of ``row_law.CAUSES`` in their order."""

IMPLICIT = Cause("implicit damping", "implicit damping", "D4")
"""What time stepping is called where the damping of an implicit integrator is behind it."""
