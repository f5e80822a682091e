"""How numbers are written: one form each for tables, sentences, shares, files to paste and JSON."""

import math
from typing import Any

from oarlock.base.errors import one_line

NOTHING = "–"
"""Stands for a number that does not apply."""


def figure(value: Any, unit: str = "") -> str:
    """Formats a number for reports and pages.

    Args:
        value: a number; text is passed through, a truth value becomes yes or no, None a dash.
        unit: appended to a number, if given.

    Returns:
        Integers in full with spaces between thousands; other numbers with three decimals from 0.01 up to 1000, and as
        ``1.23e-04`` beyond; ``not finite`` for infinities and NaN.
    """
    if value is None:
        return NOTHING
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        text = f"{value:,}".replace(",", " ")
    elif not math.isfinite(value):
        return "not finite"
    elif value == int(value) and abs(value) < 1000:
        text = f"{value:.0f}"
    else:
        text = f"{value:.3f}" if 0.01 <= abs(value) < 1000 else f"{value:.2e}"
    return f"{text} {unit}".rstrip()


def rounded_down(value: float, digits: int) -> float:
    """To some digits, towards zero."""
    unit = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return float(f"{math.floor(value / unit + 1e-9) * unit:.{digits}g}")


def short(value: Any, digits: int = 3) -> str:
    """Formats a value for a line of text or a terminal: floats to a few significant digits, all else as it is."""
    if value is None:
        return NOTHING
    return f"{value:.{digits}g}" if isinstance(value, float) else one_line(value)


def percent(part: float) -> str:
    """Formats a share in whole percent; it may lie beyond 100 % or below 0."""
    return f"{round(100.0 * part)} %" if math.isfinite(part) else NOTHING


def exact(value: float) -> str:
    """Formats a number with all its digits, so that reading it gives the same float."""
    return repr(float(value)).removesuffix(".0")


def finite(value: Any) -> Any:
    """Returns a value as JSON may hold it: None in place of infinities and NaN."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
