"""A point of a sweep: where a run leaves what its case says, and with which values."""

from dataclasses import dataclass
from typing import Any

from oarlock.base.options import Number
from oarlock.cases.case import Case

DISTURBANCE = 0.05
"""Standard deviation of what a seed adds to a start: of every coordinate in rad or m, of every velocity per s."""


TIMESTEP, SOLREF, SEED = "timestep", "solref", "seed"

KEYS = {
    TIMESTEP: "timestep in s",
    SOLREF: "time constant of MuJoCo's equalities in s, with the damping ratio 1",
    SEED: "number of the disturbance of the start",
}
"""What can be swept of every model. Any other key is a parameter of the model; one of these names is out of reach."""


@dataclass(frozen=True)
class Point:
    """Key → value, in the order of the sweep; nothing: the case as it is."""

    values: tuple[tuple[str, Number], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.values)

    def __str__(self) -> str:
        return ",".join(f"{key}={value!r}" for key, value in self.values)

    def get(self, key: str) -> Any:
        """A value, or None where the case's own holds."""
        return dict(self.values).get(key)

    def of(self, case: Case) -> Case:
        """The case with the parameters that the point names. Raises InputError as ``Case.at``."""
        return case.at({key: value for key, value in self.values if key not in KEYS}) if self else case


OWN = Point()
"""The case as it is."""
