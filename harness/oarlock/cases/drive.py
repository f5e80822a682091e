"""What drives a case: laws of time of its controls, of which equalities are active, and of mocap bodies."""

from typing import Annotated, Literal

from pydantic import BaseModel, Field, model_validator

from oarlock.base.core import TimeLaw
from oarlock.base.errors import InputError
from oarlock.cases.table import STRICT, Finite

MocapPart = Literal["x", "y", "z", "qw", "qx", "qy", "qz", "rx", "ry", "rz"]
"""Of a pose: its position, m; a quaternion; or a rotation vector, rad."""

UNUSABLE = (
    "not a name that an expression can use (t is the time; e, E, PI, π, TAU, τ and functions are taken), "
    "expected another"
)
"""Of a constant or parameter: its value would be ignored."""


def is_usable(name: str) -> bool:
    """Tells whether an expression sees a constant or parameter by this name, and not something of its own."""
    try:
        return name == name.strip() and all(TimeLaw(name, {name: value}).at(0.0) == value for value in (1.5, 2.5))
    except InputError:
        return False


class _Table(BaseModel):
    model_config = STRICT


class Drive(_Table):
    """The controls of a case as laws of time.

    Attributes:
        constants: name → number, or expression of earlier constants.
        ctrl: name of an actuator → expression of the time t (s) and the constants.
        active: name of an equality → expression of t and the constants; it is active while that is positive, and
            switched between steps.
        mocap: name of a mocap body → parts of its pose, as of ``MocapPart``, each an expression of t and the
            constants; it is moved before a step and held over it.
        held: whether controls are set before a step and held over it, as a program does that calls ``mj_step``; else
            they follow their laws at every stage of the integrator.
    """

    constants: dict[str, Finite | str] = {}
    ctrl: dict[str, str] = {}
    active: dict[str, str] = {}
    mocap: dict[str, dict[MocapPart, str]] = {}
    held: Annotated[bool, Field(strict=True)] = False

    def values(self) -> dict[str, float]:
        """Evaluates the constants.

        Raises:
            InputError: a name means something else in expressions, or an expression does not parse, depends on t, or
                names something unknown.
        """
        known: dict[str, float] = {}
        for name, value in self.constants.items():
            if not is_usable(name):
                raise InputError(f"constant '{name}': {UNUSABLE}")
            if isinstance(value, str):
                law = TimeLaw(value, known)
                if not law.is_constant:
                    raise InputError(f"constant {name} = '{value}' depends on t, expected a constant")
                value = law.at(0.0)
            known[name] = value
        return known

    def laws(self) -> dict[str, TimeLaw]:
        """Parses the laws, name → law as of ``sources``.

        Raises:
            InputError: a law does not parse or names something unknown.
        """
        constants = self.values()
        return {name: TimeLaw(source, constants) for name, source in self.sources().items()}

    def sources(self) -> dict[str, str]:
        """Name of an actuator, of an equality after ``active:`` or of a part of a pose after ``mocap:`` → its law."""
        return {
            **self.ctrl,
            **{f"active:{name}": law for name, law in self.active.items()},
            **{f"mocap:{name}.{part}": law for name, parts in self.mocap.items() for part, law in parts.items()},
        }

    @model_validator(mode="after")
    def _parse(self) -> "Drive":
        self.laws()  # an InputError is a ValueError, which pydantic reports with the key
        return self
