"""How a case file says what its runs are judged by: bounds of figures, and endings that are no fault."""

from typing import Literal

from pydantic import BaseModel, model_validator

from oarlock.cases.table import STRICT, Finite


class _Table(BaseModel):
    model_config = STRICT


class Gate(_Table):
    """A bound on a figure of the summary, for every run that ``where`` selects.

    Attributes:
        figure: column of the summary.
        where: column → value that a run must have to be selected.
        min: smallest value that is allowed.
        max: largest value that is allowed.
        equal: the value of a figure that is a word; other figures have ``min``, ``max`` or both.
        cause: why this is the bound.
    """

    figure: str
    where: dict[str, str] = {}
    min: Finite | None = None
    max: Finite | None = None
    equal: str | None = None
    cause: str

    @model_validator(mode="after")
    def _bounded(self) -> "Gate":
        numeric = self.min is not None or self.max is not None
        if not numeric and self.equal is None:
            raise ValueError("expected min or max, or equal: a gate without a bound cannot fail")
        if numeric and self.equal is not None:
            raise ValueError("expected min or max, or equal, not both")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError(f"min = {self.min:g} above max = {self.max:g}: a gate that cannot hold")
        return self

    def holds(self, value: float | str | None) -> bool:
        """Tells whether a figure is within the bounds; one that was not measured (None) is not."""
        if value is None or isinstance(value, str):
            return value is not None and value == self.equal
        return (
            self.equal is None and (self.min is None or value >= self.min) and (self.max is None or value <= self.max)
        )

    @property
    def limit(self) -> str:
        """The bounds for a table, such as ``≥ 1 and ≤ 2``."""
        bounds = [
            f"≥ {self.min:g}" if self.min is not None else "",
            f"≤ {self.max:g}" if self.max is not None else "",
            self.equal or "",
        ]
        return " and ".join(bound for bound in bounds if bound)


class Ending(_Table):
    """How runs may end other than ``done``: no fault of theirs, for every run that ``where`` selects.

    Attributes:
        status: how.
        where: column of the summary → value that a run must have to be selected.
        cause: why that is to be expected.
    """

    status: Literal["unconverged", "unprojected", "inaccurate", "drifted", "diverged"]
    where: dict[str, str] = {}
    cause: str


DEFAULT_ENDINGS = [
    Ending(
        status="unconverged",
        where={"mode": "lockstep", "walker": "mujoco", "solver": "sr1"},
        cause="its test is absolute: rows of open loops contradict one another by more, and a small b is below it",
    )
]
"""Endings of a case that names none."""
