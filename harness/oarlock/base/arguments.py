"""Options of a function that are one object and keyword arguments alike, documented once, in the object's class."""

import inspect
import math
from collections.abc import Callable
from dataclasses import fields, replace
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, TypeVar

from oarlock.base.errors import InputError, choose

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Options = TypeVar("Options", bound="DataclassInstance")
Function = TypeVar("Function", bound=Callable[..., Any])


def complete(kind: type[Options], options: Options | None, keywords: dict[str, Any]) -> Options:
    """Gives the options with the keywords in place of what they say; the defaults of ``kind`` where there are none.

    Raises:
        InputError: a keyword that is no field, or a value out of range.
    """
    names = [one.name for one in fields(kind)]
    for keyword in keywords:
        choose("argument", keyword, names)
    return kind(**keywords) if options is None else replace(options, **keywords)


def require_number(name: str, value: Any, *, unit: str = "", positive: bool = False) -> None:
    """Checks a number that a user may give; None is no number, and is left to the default.

    Args:
        name: what a message calls it.
        value: what was given.
        unit: what it is in.
        positive: whether 0 is too small.

    Raises:
        InputError: it is no number, not finite, or negative.
    """
    if value is None:
        return
    number = isinstance(value, Real) and not isinstance(value, bool)
    size = float(value) if number else math.nan
    if not (math.isfinite(size) and (size > 0 if positive else size >= 0)):
        shown = f"{size:g}" if number else repr(value)
        least = "> 0" if positive else "≥ 0"
        raise InputError(f"{name} = {f'{shown} {unit}'.rstrip()}, expected a finite number {least}")


def require_count(name: str, value: Any) -> None:
    """Checks a whole number ≥ 1 that a user may give; None is left to the default.

    Raises:
        InputError: it is no whole number, or below 1.
    """
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    if value is not None and not (whole and int(value) >= 1):
        shown = value if isinstance(value, Real) else repr(value)
        raise InputError(f"{name} = {shown}, expected a whole number ≥ 1")


def takes(kind: type[Any]) -> Callable[[Function], Function]:
    """Shows the fields of a class of options as the keyword arguments of a function that ends in ``**keywords``.

    They appear in its signature, and with it in help texts and completion.
    """

    def shown(function: Function) -> Function:
        signature = inspect.signature(function)
        given = [one for one in signature.parameters.values() if one.kind is not inspect.Parameter.VAR_KEYWORD]
        own = inspect.signature(kind).parameters
        options = [own[one.name].replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in fields(kind)]
        function.__signature__ = signature.replace(parameters=[*given, *options])  # type: ignore[attr-defined]
        return function

    return shown
