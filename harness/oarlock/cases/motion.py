"""What may be asked of a motion: where it starts, and what drives it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from oarlock.base.arguments import require_number
from oarlock.base.core import TimeLaw
from oarlock.base.errors import InputError

Kind = Literal["keyframe", "constant", "random"]
"""Where controls come from, besides a log."""

KINDS: list[Kind] = list(get_args(Kind))

Control = Mapping[str, float | str] | Callable[[Any, Any], None]
"""Actuator → its control, a number or a law of the time t in s; or a controller, called with model and data before
every step of MuJoCo's run to write ``data.ctrl``."""

LOGS = (".csv", ".npz")
"""Endings of the files that a log of controls may be in."""

NO_KEYFRAME = "none"
"""Asks for the model's own pose, at rest, where there are keyframes."""


@dataclass(frozen=True)
class Motion:
    """What is asked; what is left out is chosen by the one rule of ``stepping.beginning``.

    Attributes:
        keyframe: name or number of the keyframe to start from; ``none``: the model's own pose, at rest.
        controls: ``keyframe``, ``constant``, ``random``, or the path of a log, ``FILE.csv`` or ``FILE.npz``.
        control: in place of what ``controls`` says, as of ``Control``.
        seed: of random controls.
        states: log of states ``FILE.csv`` or ``FILE.npz``, as of ``mechanics.state_log``, in place of MuJoCo's own run:
            what a program really did. It has the start and the controls.

    Raises:
        InputError: no such kind of controls, a law that does not parse, a seed that is no whole number ≥ 0, a
            controller besides other controls, or a log of states besides a start or controls.
    """

    keyframe: str | None = None
    controls: str | None = None
    control: Control = field(default_factory=dict)
    seed: int = 0
    states: str | Path | None = None

    def __post_init__(self):
        if self.states is not None and (self.drives or self.keyframe is not None):
            raise InputError("a start or controls besides a log of states, expected one of the two: the log has both")
        if self.controls is not None and self.controls not in KINDS and self.log is None:
            raise InputError(
                f"unknown kind of controls '{self.controls}', expected one of: {', '.join(KINDS)}, or a log "
                "FILE.csv or FILE.npz"
            )
        require_number("seed", self.seed)
        if not isinstance(self.seed, int):
            raise InputError(f"seed = {self.seed!r}, expected a whole number ≥ 0")
        if callable(self.control):
            if self.controls is not None:
                raise InputError(f"controls = '{self.controls}' besides a controller, expected one of the two")
            return
        if not isinstance(self.control, Mapping):
            raise InputError(f"control = {self.control!r}, expected actuator → control, or a controller")
        for law in self.control.values():
            if isinstance(law, str):
                TimeLaw(law)

    @property
    def log(self) -> Path | None:
        """The log of controls, if they come from one."""
        path = Path(self.controls or "")
        return path if path.suffix.lower() in LOGS else None

    @property
    def controller(self) -> Callable[[Any, Any], None] | None:
        """The controller, if there is one."""
        return self.control if callable(self.control) else None

    @property
    def named(self) -> Mapping[str, float | str]:
        """Actuator → its control; empty where a controller has them all."""
        return {} if callable(self.control) else self.control

    @property
    def drives(self) -> bool:
        """Whether it asks for controls."""
        return bool(self.controls or self.control)

    @property
    def given(self) -> bool:
        """Whether anything is asked for."""
        return self.drives or self.keyframe is not None or self.states is not None


RULE = Motion()
"""Nothing is asked for: the rule decides."""
