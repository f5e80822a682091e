"""What the commands share: exit statuses, how they end, the two streams, tables and JSON."""

import json
import os
import signal
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oarlock.base.errors import InputError
from oarlock.base.files import write_text
from oarlock.base.text import json_visible, visible

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

GATE_FAILED, BAD_INPUT, INTERRUPTED, READER_GONE = 1, 2, 130, 141

STATUSES = {
    0: "all that was asked for held",
    GATE_FAILED: "a gate failed, a bound was exceeded, a run ended otherwise than expected, a comparison got worse, "
    "or what was asked for cannot be had",
    BAD_INPUT: "bad input: one line on standard error names it and says what was expected",
    INTERRUPTED: "interrupted; run, suite and conform keep what was finished",
    READER_GONE: "whoever read the output has gone",
}
"""Exit status of every command → what it means."""

WIDE = 1000
"""Columns of a table that no terminal shows: wide enough for every reference and tag."""

JsonOption = Annotated[
    str | None,
    typer.Option("--json", metavar="FILE|-", help="Write the summary as JSON; - is standard output."),
]


QuietOption = Annotated[
    bool, typer.Option("--quiet", "-q", help="No progress and no notes of it; results, warnings and errors stay.")
]


def _no_code(asked: bool) -> None:
    if asked:
        from oarlock.cases.case import NO_CODE  # most commands need no cases

        os.environ[NO_CODE] = "1"


NoCodeOption = Annotated[
    bool,
    typer.Option(
        "--no-code", callback=_no_code, help="Refuse models that are code (model.py) and do not come with oarlock."
    ),
]


KEPT = "the runs that were finished are kept"
"""What is said of an interruption by a command whose results are written run by run, and which goes on from there."""


@contextmanager
def ends(kept: str = "") -> Iterator[None]:
    """How a command ends that is interrupted or whose reader has gone. typer would give both another status.

    Args:
        kept: what an interruption leaves, in words; empty: nothing.
    """
    try:
        yield
        sys.stdout.flush()
    except KeyboardInterrupt:
        say("; ".join(filter(None, ("oarlock: interrupted", kept))))
        raise typer.Exit(INTERRUPTED) from None
    except BrokenPipeError:
        # Nothing is left to say, not even on closing.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(READER_GONE) from None


@contextmanager
def interruptible() -> Iterator[None]:
    """Makes what ends a process from outside (SIGTERM, SIGHUP) an interruption as from a terminal, in the block.

    What whoever started the command wants ignored stays ignored, as under nohup.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    before = {number: handler for number, handler in before.items() if handler is not signal.SIG_IGN}
    for number in before:
        signal.signal(number, _interrupt)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)


def _interrupt(_number: int, frame: FrameType | None) -> None:
    """Hands a signal to whoever is told of interruptions now: files are written to their end first."""
    told = signal.getsignal(signal.SIGINT)
    if callable(told):
        told(signal.SIGINT, frame)
    else:  # a command in the background of a script ignores SIGINT
        raise KeyboardInterrupt


def say(text: str) -> None:
    """A line on standard error, whatever names are in it."""
    print(visible(text), file=sys.stderr)


STDOUT = "-"
"""Stands for standard output where a file is asked for."""


def emit(text: str, target: str) -> None:
    """Writes a document to a file, or to standard output if the target is ``-``.

    Raises:
        InputError: the file cannot be written.
    """
    if target == STDOUT:
        sys.stdout.write(text)
        sys.stdout.flush()
    else:
        write_text(Path(target), text, named=True)


def emit_json(document: Any, target: str) -> None:
    """Writes a document as JSON, as ``emit``."""
    emit(json_visible(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)) + "\n", target)


def prints(documents: Mapping[str, str | None]) -> bool:
    """Whether standard output is left for people: no document goes there.

    Args:
        documents: flag → where its document goes.

    Raises:
        InputError: two of them go there.
    """
    there = [flag for flag, target in documents.items() if target == STDOUT]
    if len(there) > 1:
        raise InputError(f"{there[0]} - and {there[1]} -, expected one document on standard output")
    return not there


def one_of(names: Iterable[str]) -> str:
    """The help of an option that takes one of these names."""
    *others, last = names
    return f"{', '.join(others)} or {last}."


def shown(text: str) -> "Text":
    """As it is: no markup, and nothing that a terminal would obey."""
    from rich.text import Text  # whoever prints no tables need not load it

    return Text(visible(text))


def console(*, error: bool = False) -> "Console":
    """Standard output, or standard error. Without a terminal a table must not be cut to the width of one.

    Nothing is coloured or bold where NO_COLOR is set, or on a terminal that shows only text.
    """
    from rich.console import Console

    class Plain(Console):
        def on_broken_pipe(self) -> None:
            """Leaves it to ``ends``, which knows the status of a reader that has gone."""
            raise BrokenPipeError

    colours = None if os.environ.get("NO_COLOR") or text_only() else "auto"
    wide = None if (sys.stderr if error else sys.stdout).isatty() else WIDE
    return Plain(stderr=error, color_system=colours, width=wide)


def text_only() -> bool:
    """Whether the terminal shows text and nothing that moves or has colours."""
    return os.environ.get("TERM", "") in ("dumb", "unknown")
