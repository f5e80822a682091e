"""Options of a function that are one object and keyword arguments alike, documented once, in the object's class."""

import inspect
from collections.abc import Callable
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Options = TypeVar("Options", bound="DataclassInstance")
Function = TypeVar("Function", bound=Callable[..., Any])


def complete(kind: type[Options], options: Options | None, keywords: dict[str, Any]) -> Options:
    """Gives the options with the keywords in place of what they say; the defaults of ``kind`` where there are none.

    Raises:
        TypeError: a keyword that is no field.
        InputError: a value out of range.
    """
    return kind(**keywords) if options is None else replace(options, **keywords)


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
