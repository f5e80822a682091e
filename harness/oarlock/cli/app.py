"""The command ``oarlock``. What its exit status means is a table in ``cli.console``."""

import ast
import gc
import platform
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from oarlock.base.errors import InputError, one_line
from oarlock.cli.console import BAD_INPUT, INTERRUPTED, STATUSES, ends, interruptible, say
from oarlock.cli.examples import EXAMPLES

COMMANDS = {
    "list": "models.list_models",
    "run": "run.run",
    "new": "new.new",
    "report": "report.report",
    "figure": "figure.figure",
    "bench": "bench.bench",
    "suite": "suite.suite",
    "check": "check.check",
    "close": "close.close",
    "view": "view.view",
    "diff": "diff.diff",
    "conform": "conform.conform",
    "versions": "versions.versions",
    "sample": "sample.sample",
    "export": "export.export",
    "explain": "explain.explain",
    "solvers": "solvers.solvers",
    "export-problems": "problems.export_problems",
}
"""Name of a command → its file in this folder and its function there, which are loaded when it is called."""

_SETTINGS: Any = {"pretty_exceptions_enable": False, "rich_markup_mode": None, "add_completion": False}


class _Commands(Mapping[str, Any]):
    """The commands, each loaded when it is asked for: none waits for what another one needs."""

    def __getitem__(self, name: str) -> Any:
        module, _, function = COMMANDS[name].partition(".")
        only = typer.Typer(**_SETTINGS)
        with ends():  # also while it is loaded
            loaded = import_module(f"oarlock.cli.{module}")
            reader = getattr(loaded, "Reader", None)  # of arguments that typer has no form for
            only.command(name, cls=reader, epilog=f"Example: {EXAMPLES[name]}")(getattr(loaded, function))
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


class _Group(TyperGroup):
    def __init__(self, **settings: Any):
        super().__init__(**{**settings, "commands": None})
        self.commands: Any = _Commands()

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Lists the commands without loading them."""
        with self._described():
            super().format_commands(ctx, formatter)

    def shell_complete(self, ctx: Any, incomplete: str) -> Any:
        """Completes the name of a command without loading any."""
        with self._described():
            return super().shell_complete(ctx, incomplete)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Says what the exit status means."""
        with formatter.section("Exit status"):
            formatter.write_dl([(str(status), meaning) for status, meaning in STATUSES.items()])

    @contextmanager
    def _described(self) -> Iterator[None]:
        whole, self.commands = self.commands, {name: _described(name) for name in COMMANDS}
        try:
            yield
        finally:
            self.commands = whole


app = typer.Typer(cls=_Group, no_args_is_help=True, suggest_commands=False, **{**_SETTINGS, "add_completion": True})


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        from oarlock.base.core import VERSION

        print(f"oarlock {VERSION}, mujoco {version('mujoco')}, python {platform.python_version()}")
        raise typer.Exit


@app.callback()
def oarlock(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print versions and exit.")
    ] = False,
) -> None:
    """Cross-validates closed-chain MuJoCo models: exact constraint multipliers against MuJoCo, step by step."""


def _called(arguments: list[str]) -> Any:
    """The context of the command that some arguments call."""
    whole: Any = typer.main.get_command(app)
    name = next((word for word in arguments if word in COMMANDS), None)
    if name is None:
        return typer.Context(whole, info_name="oarlock")
    return typer.Context(whole.commands[name], info_name=f"oarlock {name}")


def main() -> None:
    """Runs the command: a user's mistake is one line on standard error, never a traceback."""
    # An overflow on the way says nothing to a user; what comes of it is named.
    warnings.simplefilter("ignore", RuntimeWarning)
    warnings.showwarning = lambda message, *_: say(f"oarlock: {one_line(message)}")
    try:
        with interruptible():
            status = app(prog_name="oarlock", standalone_mode=False)
        sys.exit(status if isinstance(status, int) else 0)
    except _UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()
        else:
            from oarlock.cli.usage import complaint

            say(complaint(error, _called(sys.argv[1:])))
        sys.exit(BAD_INPUT)
    except typer.Abort:
        sys.exit(INTERRUPTED)
    except (InputError, OSError, Warning) as error:  # a warning is an error if Python was told so
        say(f"oarlock: {one_line(error)}")
        sys.exit(BAD_INPUT)
    except (MemoryError, RecursionError) as error:
        say(f"oarlock: too large or too deep for this machine: {type(error).__name__} {one_line(error)[:200]}".rstrip())
        sys.exit(BAD_INPUT)
