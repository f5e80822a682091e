"""Words that several chapters use."""

from collections.abc import Iterable

from oarlock.base.errors import few
from oarlock.base.numbers import NOTHING, figure
from oarlock.diagnosis.examined import Examination
from oarlock.poses.layout import SINE

SINE_NOTE = (
    f"The rows 'turn' of a weld are its rotations, {SINE} with its torquescale τ and the angle θ: for small angles and "
    "τ = 1 half the angle in rad."
)


def why_not(exam: Examination, part: str) -> str:
    """The reason why a part of an examination is not there."""
    reason = exam.missing.get(part)
    return f"Not known: {reason}." if reason else "Not looked at."


def yes(value: bool) -> str:
    """Yes or no."""
    return "yes" if value else "no"


def many(names: Iterable[str]) -> str:
    """Names for a sentence or a cell."""
    return few(list(names)) or NOTHING


def counted(count: int, noun: str, plural: str = "") -> str:
    """A number of things."""
    return f"{count} {noun if count == 1 else plural or noun + 's'}"


def lower(text: str) -> str:
    """A sentence after a colon."""
    return text[0].lower() + text[1:]


def measured(value: float | None, unit: str) -> str:
    """A figure with its unit, or a dash."""
    return NOTHING if value is None else figure(value, unit)


def spelt(values: Iterable[float]) -> str:
    """Numbers as MJCF has them."""
    return " ".join(f"{value:g}" for value in values)
