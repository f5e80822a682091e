"""Files written whole or not at all, and read with the name of what cannot be."""

import os
import re
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import polars as pl

from oarlock.base.errors import InputError, one_line


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Gives a temporary path beside ``path`` and moves it there when the block ends well.

    Raises:
        InputError: the file cannot be written (full disk, no permission).
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with uninterrupted():
            path.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            os.replace(temporary, path)
    except (OSError, pl.exceptions.ComputeError) as error:
        raise InputError(f"cannot write '{path}': {reason(error)}") from None
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Keeps an interruption back until the block is done, or the block around it.

    A library that is interrupted may leave half a file, and a finished run is more than one file.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    caught: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _frame: caught.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if caught and callable(before):
            before(signal.SIGINT, None)
        elif caught:
            raise KeyboardInterrupt


def write_text(path: Path, text: str) -> None:
    """Writes a text file whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@contextmanager
def reading(path: Path) -> Iterator[Path]:
    """Says which table it was that cannot be read.

    Raises:
        InputError: it is not there or not whole.
    """
    try:
        yield path
    except (OSError, pl.exceptions.PolarsError) as error:
        raise InputError(f"'{path}' cannot be read: {one_line(error)[:120]}") from None


def reason(error: Exception) -> str:
    """What the system said. polars hides it in errors of its own."""
    if isinstance(error, OSError):
        return error.strerror or one_line(error)
    number = re.search(r"\(os error (\d+)\)", str(error))
    return os.strerror(int(number[1])) if number else one_line(error)[:120]
