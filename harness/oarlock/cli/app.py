"""The command ``oarlock``.

Exit status: 0 all gates held, 1 a gate failed, a run ended otherwise than expected or a comparison got worse, 2 bad
input, 130 interrupted, 141 reader gone.
"""

import ast
import gc
import sys
import warnings
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperGroup

from oarlock.base.errors import InputError, one_line
from oarlock.base.text import visible
from oarlock.cli.console import BAD_INPUT, ends, interruptible, say

COMMANDS = {
    "list": "models.list_models",
    "run": "run.run",
    "new": "new.new",
    "report": "report.report",
    "bench": "bench.bench",
    "suite": "suite.suite",
    "check": "check.check",
    "diff": "diff.diff",
    "conform": "conform.conform",
    "versions": "versions.versions",
    "sample": "sample.sample",
    "export": "export.export",
    "explain": "explain.explain",
}
"""Name of a command → its file in this folder and its function there, which are loaded when it is called."""

_SETTINGS: Any = {"pretty_exceptions_enable": False, "rich_markup_mode": None, "add_completion": False}


class _Commands(Mapping[str, Any]):
    """The commands, each loaded when it is asked for: none waits for what another one needs."""

    def __getitem__(self, name: str) -> Any:
        module, _, function = COMMANDS[name].partition(".")
        only = typer.Typer(**_SETTINGS)
        with ends():  # also while it is loaded
            only.command(name)(getattr(import_module(f"oarlock.cli.{module}"), function))
        gc.freeze()  # what was imported stays: no collection of garbage need walk through it
        return typer.main.get_command(only)

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


def _described(name: str) -> Any:
    """A command that does nothing but say what it is for, by the docstring in its file, of which nothing is run."""
    module, _, function = COMMANDS[name].partition(".")
    source = Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8")
    found = next(one for one in ast.parse(source).body if isinstance(one, ast.FunctionDef) and one.name == function)
    only = typer.Typer(**_SETTINGS)
    only.command(name, help=ast.get_docstring(found))(lambda: None)
    return typer.main.get_command(only)


_UsageError: Any = typer.BadParameter.__mro__[1]
"""What typer raises of arguments that it does not understand; it has no name for it of its own."""

_LONGEST_USAGE = 500
"""Characters of what is said of them."""


class _Group(TyperGroup):
    def __init__(self, **settings: Any):
        super().__init__(**{**settings, "commands": None})
        self.commands: Any = _Commands()

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Lists the commands without loading them."""
        whole, self.commands = self.commands, {name: _described(name) for name in COMMANDS}
        super().format_commands(ctx, formatter)
        self.commands = whole

    def invoke(self, ctx: Any) -> Any:
        """Runs the command that was asked for; what is said of its arguments is visible, whatever is in them."""
        try:
            return super().invoke(ctx)
        except _UsageError as error:
            said: Any = error
            said.message = visible(said.message, _LONGEST_USAGE)
            raise


app = typer.Typer(cls=_Group, no_args_is_help=True, **_SETTINGS)


@app.callback()
def oarlock() -> None:
    """Cross-validates closed-chain MuJoCo models: exact constraint multipliers against MuJoCo, step by step."""


def main() -> None:
    """Runs the command: a user's mistake is one line on standard error, never a traceback."""
    # An overflow on the way says nothing to a user; what comes of it is named.
    warnings.simplefilter("ignore", RuntimeWarning)
    warnings.showwarning = lambda message, *_: say(f"oarlock: {one_line(message)}")
    try:
        with interruptible():
            app(standalone_mode=True)
    except (InputError, OSError, Warning) as error:  # a warning is an error if Python was told so
        say(f"oarlock: {one_line(error)}")
        sys.exit(BAD_INPUT)
    except (MemoryError, RecursionError) as error:
        say(f"oarlock: too large or too deep for this machine: {type(error).__name__} {one_line(error)[:200]}".rstrip())
        sys.exit(BAD_INPUT)
