"""One line for arguments that a command does not understand: what was given, and what is expected."""

import ast
from difflib import get_close_matches
from typing import Any

from oarlock.base.text import visible

LONGEST = 500
"""Characters of what is said of them."""

_ALIKE = 0.7
"""Likeness from which on an option may be a misspelling of another: that of two letters of a short one is none."""

_KINDS = {"int": "a whole number", "integer": "a whole number", "float": "a number", "number": "a number"}
_BOUNDS = {"greater_than_equal": ("ge", "≥"), "greater_than": ("gt", ">"), "less_than_equal": ("le", "≤")}


def complaint(error: Any, called: Any) -> str:
    """The line of one of typer's usage errors.

    Args:
        error: what was raised.
        called: the context of the command that was called, for errors that know none.
    """
    context = error.ctx or called
    return visible(f"{': '.join(context.command_path.split())}: {_said(error, context)}", LONGEST)


def _said(error: Any, context: Any) -> str:
    kind, message = type(error).__name__, error.format_message()
    param = getattr(error, "param", None)
    if kind == "MissingParameter" and param is not None:
        option = param.param_type_name == "option"
        return f"no {_named(param)}, expected {f'{_named(param)} {_metavar(param)}' if option else _form(context)}"
    if kind == "NoSuchOption":
        option = error.option_name
        known = [name for one in context.command.params for name in (*one.opts, *one.secondary_opts)]
        alike = get_close_matches(option, [name for name in known if name.startswith("-")], n=3, cutoff=_ALIKE)
        return f"unknown option '{option}', expected {_one_of(alike) or f'one of {context.command_path} --help'}"
    if kind == "BadOptionUsage":
        option = next((one for one in context.command.params if error.option_name in one.opts), None)
        if option is not None and "requires" in message:
            return f"{error.option_name} without a value, expected {error.option_name} {_metavar(option)}"
        return f"{error.option_name} with a value, expected none"
    if kind == "BadParameter" and param is not None:
        return _refused(error, param)
    if message.startswith("Got unexpected extra argument"):
        extra = message.partition("(")[2].partition(") (")[-1] or message.partition("(s) (")[2]
        return f"unexpected argument '{extra.removesuffix(')')}', expected {_form(context)}"
    if message.startswith("No such command"):
        name = ast.literal_eval(message.removeprefix("No such command ").removesuffix("."))
        every = list(context.command.commands)
        return f"unknown command '{name}', expected {_one_of(get_close_matches(name, every, n=3) or every)}"
    return message


def _refused(error: Any, param: Any) -> str:
    """A value that an option does not take; the reader of numbers keeps it beside its own words."""
    causes = getattr(error.__cause__, "errors", list)()
    if not causes:
        return f"{_named(param)}: {error.message}"
    cause = causes[0]
    kind = cause["type"]
    if kind in _BOUNDS:
        name, sign = _BOUNDS[kind]
        expected = f"{sign} {cause['ctx'][name]:g}"
    else:
        expected = _KINDS.get(kind.partition("_")[0], cause["msg"])
    return f"{_named(param)} = {cause['input'] or 'nothing'}, expected {expected}"


def _named(param: Any) -> str:
    return max(param.opts, key=len) if param.param_type_name == "option" else _metavar(param)


def _metavar(param: Any) -> str:
    if param.metavar:
        return str(param.metavar)
    return "VALUE" if param.param_type_name == "option" else str(param.name).upper()


def _form(context: Any) -> str:
    return f"'{context.get_usage().partition(': ')[2].strip()}'"


def _one_of(names: list[str]) -> str:
    return "" if not names else names[0] if len(names) == 1 else f"one of: {', '.join(names)}"
