"""Files that are written whole or not at all, and errors that name the file that cannot be read or written."""

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
    """Yields a temporary path beside ``path``, and moves that file to ``path`` when the block ends without an error.

    Folders are created as needed. Interruptions are held back meanwhile (see ``uninterrupted``).

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
    """Holds back an interruption (SIGINT) until the block is done; of nested blocks, until the outermost is.

    A library that is interrupted may leave half a file, and a finished run consists of several files. Only the main
    thread receives interruptions, so in any other thread this does nothing.
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
    """Writes a text file in UTF-8, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@contextmanager
def reading(path: Path) -> Iterator[Path]:
    """Yields ``path``, and turns an error of reading it into one that names the file.

    Raises:
        InputError: the file is missing or damaged.
    """
    try:
        yield path
    except (OSError, pl.exceptions.PolarsError) as error:
        raise InputError(f"'{path}' cannot be read: {one_line(error)[:120]}") from None


def reason(error: Exception) -> str:
    """Returns the system's reason for an error of a file. polars hides it in the text of its own errors."""
    if isinstance(error, OSError):
        return error.strerror or one_line(error)
    number = re.search(r"\(os error (\d+)\)", str(error))
    return os.strerror(int(number[1])) if number else one_line(error)[:120]
