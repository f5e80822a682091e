"""What a user may ask of a check."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from oarlock.base.arguments import require_number
from oarlock.base.errors import choose
from oarlock.cases.integrators import RUNNING
from oarlock.cases.motion import Motion

TARGET = 1e-6
"""Wanted drift, m or rad, unless it is asked for: a thousandth of a millimetre."""

BUDGET_S = 8.0
"""Work for the runs that look for a recipe, as of ``runs.budget``."""


@dataclass(frozen=True)
class CheckOptions:
    """What may be asked of a check besides the file; what is left out is chosen, and told.

    Attributes:
        keyframe: name or number of the keyframe to start from, ``none`` for the model's own pose; left out: the first
            one, or the model's own pose where there is none.
        controls: ``keyframe``, ``constant``, ``random``, or a log ``FILE.csv`` or ``FILE.npz``; left out: those of the
            keyframe where the run starts from one, else random.
        control: actuator → control, a number or a law of the time t in s.
        seed: of random controls.
        duration: of the run, s.
        timestep: in place of the model's, s.
        integrator: ``euler``, ``implicit``, ``implicitfast`` or ``rk4``, in place of the model's.
        target: wanted drift, m or rad.
        budget: work for the runs that look for settings, in seconds of an ordinary machine; 0: none are looked for. The
            clock of this machine only cuts short what takes ten times as long.
        ignore_inequalities: without contacts, limits and friction, on both sides.
        fail_above: bound on the drift, m or rad; beyond it there is an error among the findings.

    Raises:
        InputError: an unknown integrator or kind of controls, or a number out of range.
    """

    keyframe: str | None = None
    controls: str | None = None
    control: Mapping[str, float | str] = field(default_factory=dict)
    seed: int = 0
    duration: float | None = None
    timestep: float | None = None
    integrator: str | None = None
    target: float = TARGET
    budget: float = BUDGET_S
    ignore_inequalities: bool = False
    fail_above: float | None = None

    def __post_init__(self):
        for name, unit in (("duration", "s"), ("timestep", "s"), ("target", "")):
            require_number(name, getattr(self, name), unit=unit, positive=True)
        for name in ("budget", "fail_above"):
            require_number(name, getattr(self, name))
        if self.integrator is not None:
            choose("integrator", self.integrator, RUNNING)
        _ = self.motion

    @property
    def motion(self) -> Motion:
        """Where the run starts and what drives it."""
        return Motion(self.keyframe, self.controls, self.control, self.seed)
