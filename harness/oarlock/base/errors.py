"""Errors for a user's mistakes: one line each, which names the value and what was expected."""

from collections.abc import Sequence
from typing import TypeVar

from oarlock.base.core import InputError
from oarlock.base.text import one_line

__all__ = ["DiskError", "InputError", "RefusedError", "choose", "few", "one_line"]

_NAMED = 4
"""Maximum number of names listed in a message; beyond that only the count of the others is given."""


class RefusedError(InputError):
    """A model that must not be run as it was asked, which shows only on the way.

    Ends the whole comparison, whereas a run that diverges ends alone.
    """


class DiskError(InputError):
    """Results that cannot be written to disk. Ends the whole comparison, like ``RefusedError``."""


Name = TypeVar("Name", bound=str)


def choose(what: str, name: str, valid: Sequence[Name]) -> Name:
    """Returns the member of ``valid`` that equals ``name``.

    Args:
        what: what the names stand for in a message, such as ``solver``.
        name: the name that was given.
        valid: the names that exist.

    Raises:
        InputError: ``name`` is not one of them; the message lists those that are.
    """
    if name not in valid:
        raise InputError(f"unknown {what} '{name}', expected one of: {', '.join(valid) or '(there are none)'}")
    return next(one for one in valid if one == name)


def few(names: Sequence[str], last: str = "and", most: int = _NAMED) -> str:
    """Joins names for a message, ``a, b and c``. Of more than ``most``, lists the first and counts the others.

    Args:
        names: the names.
        last: word in front of the last name; if empty, a comma, as within a longer list.
        most: maximum number of names to list.
    """
    if len(names) > most:
        return f"{', '.join(names[:most])} {last or 'and'} {len(names) - most} more"
    return f" {last} ".join(filter(None, [", ".join(names[:-1]), *names[-1:]])) if last else ", ".join(names)
