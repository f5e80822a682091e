"""How stiff a servo may be in the run that it is in: by the same run with other gains.

A step at the start tells what grows there, of small motions. A run leaves its start: in other poses a loop adds less
inertia, a fast motion tears it open, and what its rows take then is no longer linear.
"""

from collections.abc import Sequence
from typing import Literal, get_args

from oarlock.base.numbers import rounded_down
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.diagnosis.runs.walking import own_copy

STRIDE = 2.0**0.125
"""Between gains that are tried, upwards from one that should be borne: beyond the first that is not, some are again."""

DIGITS = 3
"""Of a gain that is tried, so that it can be told as it was."""

MOST_STEPS = 40_000
"""Of all these runs together."""

Gain = Literal["kp", "kv"]
GAINS: tuple[Gain, ...] = get_args(Gain)

_PLACE = {"kp": 1, "kv": 2}
"""Gain → its place in ``actuator_biasprm``."""


def largest_borne(
    recording: Recording, actuators: Sequence[int], gain: Gain, low: float, high: float, steps: int
) -> float | None:
    """The largest gain of a servo up to which a run stays finite.

    Args:
        recording: MuJoCo's run as configured, which does not.
        actuators: the servo and those that are changed with it, by number.
        gain: which of its gains.
        low: the first that is tried.
        high: where they end.
        steps: of a run that stays finite.

    Returns:
        None where the first one is not borne, or the runs would take more than ``MOST_STEPS``.
    """
    own = -float(recording.model.actuator_biasprm[actuators[0], _PLACE[gain]])
    borne, tried, left = None, low, MOST_STEPS
    while tried <= high and left >= steps:
        value, left = rounded_down(tried, DIGITS), left - steps
        if not _stays(recording, actuators, gain, value / own, steps):
            return borne
        borne, tried = value, STRIDE * tried
    return borne if tried > high else None


def _stays(recording: Recording, actuators: Sequence[int], gain: Gain, part: float, steps: int) -> bool:
    """Whether the run stays finite with a part of a gain."""
    model = own_copy(recording.model)
    for index in actuators:
        alike = model.actuator_gainprm[index, 0] == -model.actuator_biasprm[index, _PLACE[gain]]
        model.actuator_biasprm[index, _PLACE[gain]] *= part
        if alike:  # of <position> and <velocity> it is one number
            model.actuator_gainprm[index, 0] *= part
    return rerun(recording, model, steps=steps) is not None
