"""What is asked of an examination."""

from dataclasses import dataclass, field

TARGET = 1e-6
"""Wanted drift, m or rad, unless it is asked for: a thousandth of a millimetre."""

BUDGET_S = 8.0
"""Time for the runs that look for a recipe."""


@dataclass(frozen=True)
class Wish:
    """What a user may ask for besides the file; what is left out is chosen and told.

    Attributes:
        keyframe: name or number to start from; None: the first one if there is one, else the model's own pose.
        controls: ``keyframe``, ``constant`` or ``random``.
        constant: actuator → control, for ``constant``.
        seed: of random controls.
        duration_s: of the run.
        timestep_s, integrator: in place of the model's.
        target: wanted drift, m or rad.
        budget_s: time for the runs that look for a recipe; 0: none is looked for.
        ignore_inequalities: without contacts, limits and friction, on both sides.
    """

    keyframe: str | None = None
    controls: str | None = None
    constant: dict[str, float] = field(default_factory=dict)
    seed: int = 0
    duration_s: float | None = None
    timestep_s: float | None = None
    integrator: str | None = None
    target: float = TARGET
    budget_s: float = BUDGET_S
    ignore_inequalities: bool = False
