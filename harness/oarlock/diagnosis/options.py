"""What a user may ask of a check."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from oarlock.base.arguments import require_number
from oarlock.base.errors import InputError, choose
from oarlock.cases.integrators import RUNNING
from oarlock.cases.motion import Control, Motion

TARGET = 1e-4
"""Wanted drift unless it is asked for, of the size of the loops: a tenth of a millimetre of a robot of a metre, which
is what can be seen of it, and within reach of most models at their own timestep."""

TARGETS = (1e-6, 1e-3)
"""m or rad. No smaller and no larger target is taken by itself: rows of angles have it too, and do not grow with the
size."""

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
        control: actuator → control, a number or a law of the time t in s; or a controller, called with model and data
            before every step of MuJoCo's own run to write ``data.ctrl``: everybody is given what it commands there.
        seed: of random controls.
        states: log of states ``FILE.csv`` or ``FILE.npz``, as of ``mechanics.state_log``, in place of MuJoCo's own
            run: what a program really did. It has the start and the controls.
        duration: of the run, s.
        timestep: in place of the model's, s.
        integrator: ``euler``, ``implicit``, ``implicitfast`` or ``rk4``, in place of the model's.
        target: wanted drift, m or rad; None: by the size of the loops, as of ``usual_target``.
        budget: work for the runs that look for settings, in seconds of an ordinary machine; 0: none are looked for. The
            clock of this machine only cuts short what takes ten times as long.
        ignore_inequalities: without contacts, limits and friction, on both sides.
        hold: joints that stay as they are where an open start is closed; None: those that actuators act on, where the
            rest can close; empty: none.
        fail_above: bound on the drift, m or rad; beyond it there is an error among the findings.
        lint: only what can be seen without a run, in milliseconds.

    Raises:
        InputError: an unknown integrator or kind of controls, or a number out of range.
    """

    keyframe: str | None = None
    controls: str | None = None
    control: Control = field(default_factory=dict)
    seed: int = 0
    states: str | Path | None = None
    duration: float | None = None
    timestep: float | None = None
    integrator: str | None = None
    target: float | None = None
    budget: float = BUDGET_S
    ignore_inequalities: bool = False
    fail_above: float | None = None
    hold: Sequence[str] | None = None
    lint: bool = False

    def __post_init__(self):
        for name, unit in (("duration", "s"), ("timestep", "s"), ("target", "")):
            require_number(name, getattr(self, name), unit=unit, positive=True)
        for name in ("budget", "fail_above"):
            require_number(name, getattr(self, name))
        if self.integrator is not None:
            choose("integrator", self.integrator, RUNNING)
        if isinstance(self.hold, str):
            raise InputError(f"hold = {self.hold!r}, expected a list of joints")
        _ = self.motion
        if self.states is not None and self.lint:
            raise InputError("a log of states with lint, expected one of the two: a lint looks at no run")

    @property
    def motion(self) -> Motion:
        """Where the run starts and what drives it."""
        return Motion(self.keyframe, self.controls, self.control, self.seed, self.states)


def usual_target(size: float) -> float:
    """The wanted drift (m or rad) of loops of a size (m), to two digits: ``TARGET`` times that, within ``TARGETS``."""
    low, high = TARGETS
    wanted = min(max(TARGET * size, low), high)
    unit = 10.0 ** (math.floor(math.log10(wanted)) - 1)
    return float(f"{math.floor(wanted / unit + 1e-9) * unit:.1e}")
