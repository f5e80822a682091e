"""A point of a sweep: in which values a run departs from its case."""

from dataclasses import dataclass
from typing import Any

from oarlock.base.options import Number
from oarlock.cases.case import Case

DISTURBANCE = 0.05
"""Standard deviation of what a seed adds to every coordinate (rad or m) and velocity (rad/s or m/s) of a start."""


TIMESTEP, SOLREF, SEED = "timestep", "solref", "seed"

KEYS = {
    TIMESTEP: "timestep in s",
    SOLREF: "time constant of MuJoCo's equalities in s, with the damping ratio 1",
    SEED: "number of the disturbance of the start",
}
"""What can be swept of every model. Any other key is a parameter of the model; one of these names hides a parameter."""


@dataclass(frozen=True)
class Point:
    """Values in which a run departs from its case.

    Attributes:
        values: pairs of key and value, in the order of the sweep; empty for the case as it is.
    """

    values: tuple[tuple[str, Number], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.values)

    def __str__(self) -> str:
        return ",".join(f"{key}={value!r}" for key, value in self.values)

    def get(self, key: str) -> Any:
        """Returns the value of a key, or None where the case's own holds."""
        return dict(self.values).get(key)

    def of(self, case: Case) -> Case:
        """Returns the case with the parameters that the point names.

        Raises:
            InputError: the case has no such parameter, or expects an integer.
        """
        return case.at({key: value for key, value in self.values if key not in KEYS}) if self else case


OWN = Point()
"""The point of the case as it is."""
