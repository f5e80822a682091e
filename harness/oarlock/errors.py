"""What a user can have got wrong, in one line that names the value and what was expected."""

from oarlock._core import InputError as _CoreInputError


class InputError(_CoreInputError):
    """Bad input: a model, a case, an option or a start that cannot be used. Exit status 2."""


def one_line(text: object) -> str:
    """Collapses a message to one line, so that it stays one on a terminal and in a log."""
    return " ".join(str(text).split())


def choose(what: str, name: str, valid: "list[str] | tuple[str, ...]") -> str:
    """Gives ``name`` back if it is one of ``valid``.

    Raises:
        InputError: it is not; the message lists the valid ones.
    """
    if name not in valid:
        raise InputError(f"unknown {what} '{name}', expected one of: {', '.join(valid) or '(there are none)'}")
    return name
