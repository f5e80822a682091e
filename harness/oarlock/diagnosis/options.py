"""What a user may ask of a check."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

from oarlock.base.arguments import require_number
from oarlock.base.errors import InputError, choose
from oarlock.cases.integrators import RUNNING

Controls = Literal["keyframe", "constant", "random"]
"""Where the controls of a run come from."""

TARGET = 1e-6
"""Wanted drift, m or rad, unless it is asked for: a thousandth of a millimetre."""

BUDGET_S = 8.0
"""Work for the runs that look for a recipe, as of ``runs.budget``."""


@dataclass(frozen=True)
class CheckOptions:
    """What may be asked of a check besides the file; what is left out is chosen, and told.

    Attributes:
        keyframe: name or number of the keyframe to start from; None: the first one, or the model's own pose.
        controls: ``keyframe``, ``constant`` or ``random``; chosen by what the model has if left out.
        control: actuator → constant control.
        seed: of random controls.
        duration: of the run, s.
        timestep: in place of the model's, s.
        integrator: ``euler``, ``implicit``, ``implicitfast`` or ``rk4``, in place of the model's.
        target: wanted drift, m or rad.
        budget: work for the runs that look for settings, in seconds of an ordinary machine; 0: none are looked for. The
            clock of this machine only cuts short what takes ten times as long.
        ignore_inequalities: without contacts, limits and friction, on both sides.
        hold: joints that stay as they are where an open start is closed; None: those that actuators act on, where the
            rest can close; empty: none.
        fail_above: bound on the drift, m or rad; beyond it there is an error among the findings.

    Raises:
        InputError: an unknown integrator or kind of controls, or a number out of range.
    """

    keyframe: str | None = None
    controls: str | None = None
    control: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    duration: float | None = None
    timestep: float | None = None
    integrator: str | None = None
    target: float = TARGET
    budget: float = BUDGET_S
    ignore_inequalities: bool = False
    fail_above: float | None = None
    hold: Sequence[str] | None = None

    def __post_init__(self):
        for name, unit in (("duration", "s"), ("timestep", "s"), ("target", "")):
            require_number(name, getattr(self, name), unit=unit, positive=True)
        for name in ("budget", "fail_above", "seed"):
            require_number(name, getattr(self, name))
        if not isinstance(self.seed, int):
            raise InputError(f"seed = {self.seed!r}, expected a whole number ≥ 0")
        if self.integrator is not None:
            choose("integrator", self.integrator, RUNNING)
        if isinstance(self.hold, str):
            raise InputError(f"hold = {self.hold!r}, expected a list of joints")
        if self.controls is not None:
            choose("kind of controls", self.controls, get_args(Controls))
