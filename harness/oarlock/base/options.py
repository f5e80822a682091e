"""Specifications ``NAME:key=value,…``, by which solvers and parametrised models are asked for."""

import math

from oarlock.base.errors import InputError

Number = int | float

_SWITCHES = {"true": True, "false": False}


def split_options(text: str, what: str, switches: bool = False) -> tuple[str, dict[str, Number]]:
    """Splits a specification into its name and its options. Numbers that are written as integers become ``int``.

    Args:
        text: ``NAME`` or ``NAME:key=value,…``.
        what: what an option is called in a message, such as ``solver option``.
        switches: whether ``true`` and ``false`` are allowed as values.

    Raises:
        InputError: an option is not of the form key=number, or is given twice.
    """
    name, colon, rest = text.rpartition(":")
    if not colon:
        return text, {}
    options: dict[str, Number] = {}
    for item in filter(None, rest.split(",")):
        key, equals, value = (part.strip() for part in item.partition("="))
        try:
            number = _SWITCHES[value] if switches and value in _SWITCHES else _number(value)
        except ValueError:
            number = None
        if number is None or not equals or not key:
            raise InputError(f"{what} '{item}' in '{text}', expected key=number")
        if key in options:
            raise InputError(f"{what} '{key}' in '{text}' is given twice")
        options[key] = number
    return name, options


def _number(text: str) -> Number:
    value = float(text)
    try:
        integer = int(text)
    except ValueError:
        return value
    if math.isinf(value):  # no float is as large
        raise ValueError(text)
    return integer


def join_options(name: str, options: dict[str, Number]) -> str:
    """Joins a name and options to the specification that ``split_options`` takes apart. Switches become 0 or 1."""
    values = {key: int(value) if isinstance(value, bool) else value for key, value in options.items()}
    joined = ",".join(f"{key}={value!r}" for key, value in values.items())
    return f"{name}:{joined}" if joined else name
