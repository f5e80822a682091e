"""What a user can have got wrong, in one line that names the value and what was expected."""

from collections.abc import Sequence
from typing import TypeVar

from oarlock.base.core import InputError

__all__ = ["DiskError", "InputError", "RefusedError", "choose", "few", "one_line"]

_NAMED = 4
"""Names in a message at most; of more only their number is given."""


class RefusedError(InputError):
    """A model that must not be run like this, found out on the way; ends everything, unlike a run that diverges."""


class DiskError(InputError):
    """The disk does not take what a run gives; ends everything, as ``RefusedError``."""


def one_line(text: object) -> str:
    """Collapses a message to one line, so that it stays one on a terminal and in a log."""
    return " ".join(str(text).split())


Name = TypeVar("Name", bound=str)


def choose(what: str, name: str, valid: Sequence[Name]) -> Name:
    """Gives the one of ``valid`` that is called ``name``.

    Raises:
        InputError: it is not; the message lists the valid ones.
    """
    if name not in valid:
        raise InputError(f"unknown {what} '{name}', expected one of: {', '.join(valid) or '(there are none)'}")
    return next(one for one in valid if one == name)


def few(names: Sequence[str], last: str = "and", most: int = _NAMED) -> str:
    """Joins names for a message, ``a, b and c``; of many the first ones and how many more there are.

    Args:
        names: any number of them.
        last: stands before the last name; if empty, a comma does, as within a longer list.
        most: names to give at most.
    """
    if len(names) > most:
        return f"{', '.join(names[:most])} {last or 'and'} {len(names) - most} more"
    return f" {last} ".join(filter(None, [", ".join(names[:-1]), *names[-1:]])) if last else ", ".join(names)
