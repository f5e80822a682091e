"""What the commands share: exit statuses, how they end, the two streams, tables and JSON."""

import json
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.text import Text

from oarlock.base.files import write_text
from oarlock.base.text import json_visible, visible

GATE_FAILED, BAD_INPUT, INTERRUPTED, READER_GONE = 1, 2, 130, 141

WIDE = 1000
"""Columns of a table that no terminal shows: wide enough for every reference and tag."""

JsonOption = Annotated[
    str | None,
    typer.Option("--json", metavar="FILE|-", help="Write the summary as JSON; - is standard output."),
]


@contextmanager
def ends() -> Iterator[None]:
    """How a command ends that is interrupted or whose reader has gone. typer would give both another status."""
    try:
        yield
        sys.stdout.flush()
    except KeyboardInterrupt:
        say("oarlock: interrupted; the runs that were finished are kept")
        raise typer.Exit(INTERRUPTED) from None
    except BrokenPipeError:
        # Nothing is left to say, not even on closing.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(READER_GONE) from None


def say(text: str) -> None:
    """A line on standard error, whatever names are in it."""
    print(visible(text), file=sys.stderr)


def emit_json(document: Any, target: str) -> None:
    """Writes a document to a file, or to standard output if the target is ``-``.

    Raises:
        InputError: the file cannot be written.
    """
    text = json_visible(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)) + "\n"
    if target == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
    else:
        write_text(Path(target), text)


def one_of(names: Iterable[str]) -> str:
    """The help of an option that takes one of these names."""
    *others, last = names
    return f"{', '.join(others)} or {last}."


def shown(text: str) -> Text:
    """As it is: no markup, and nothing that a terminal would obey."""
    return Text(visible(text))


def console() -> Console:
    """Standard output. Without a terminal a table must not be cut to the width of one."""
    return Console() if sys.stdout.isatty() else Console(width=WIDE)
