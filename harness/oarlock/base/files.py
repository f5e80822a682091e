"""Files that are written whole or not at all, and errors that name the file that cannot be read or written.

Everything that the package writes for a user goes through ``replacing``:

- a regular file is replaced by a rename once its new contents are complete, and keeps its permissions;
- of a file that the user names, a link is followed, and anything else (a device, a pipe, a socket, an open file such as
  ``/dev/stdout``) is written to and stays what it is;
- of a file with a name of ours in a folder of results or of a page, a link or anything else is replaced: such a folder
  may come from somebody else, and a link in it would lead anywhere.
"""

import errno
import itertools
import os
import re
import shutil
import signal
import stat
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from oarlock.base.errors import InputError, one_line

_OPEN_FILES = re.compile(r"/(?:proc/(?:self|thread-self|\d+)(?:/task/\d+)?|dev)/fd")
"""Folders whose entries are links to files that a process has open."""

_NAME_LENGTH = 64
"""So many characters of a name at most are in that of its temporary file: names of files end at 255 bytes."""

_numbers = itertools.count()


@contextmanager
def replacing(path: Path, *, named: bool = False) -> Iterator[Path]:
    """Yields a temporary path, whose file takes the place of ``path`` when the block ends without an error.

    It lies beside the file. Folders are created as needed. Interruptions are held back meanwhile (see
    ``uninterrupted``), but not while something else than a regular file is written to.

    Args:
        path: of the file.
        named: whether the user names this very file. Then links are followed, and where they lead to no regular file,
            the temporary one lies in a folder of its own, which says whose it is, and its contents are written to
            ``path`` instead.

    Raises:
        InputError: the file cannot be written (full disk, no permission, a folder is there).
    """
    temporary: Path | None = None
    target: Path | None = path
    try:
        with uninterrupted():
            target = destination(path) if named else _place(path)
            folder = _scratch() if target is None else target.parent
            folder.mkdir(parents=True, exist_ok=True)
            temporary = folder / f".{path.stem[:_NAME_LENGTH]}.{next(_numbers)}.{os.getpid()}.tmp{path.suffix[:8]}"
            yield temporary
            if target is not None:
                _keep_mode(target, temporary)
                os.replace(temporary, target)
        if target is None:
            # Whoever reads at the other end may never come: this must not hold interruptions back.
            with temporary.open("rb") as contents:
                _pour(contents, path)
    except InputError:
        raise
    except (OSError, ValueError, *_polars_errors("ComputeError")) as error:
        raise InputError(f"cannot write '{path}': {reason(error, temporary)}") from None
    finally:
        if temporary is not None:
            with suppress(OSError):
                temporary.unlink()
                if target is None:
                    temporary.parent.rmdir()


def _polars_errors(*names: str) -> tuple[Any, ...]:
    """Errors of polars by their names. Where nobody has loaded it, nobody has raised them."""
    polars = sys.modules.get("polars")
    return tuple(getattr(polars.exceptions, name) for name in names) if polars else ()


def _scratch() -> Path:
    from oarlock.base.scratch import scratch  # few write to pipes, and who only reads need not load it

    return scratch()


def destination(path: Path) -> Path | None:
    """The regular file, there or not, that a path leads to; None where it is to be written to and not replaced.

    Raises:
        OSError: a folder is there, or the links go round.
        ValueError: no file can have this name.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return Path(os.path.realpath(path))
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    return Path(os.path.realpath(path)) if stat.S_ISREG(mode) and _open_file(path) is None else None


def _place(path: Path) -> Path:
    """The place of a file of ours, whatever stands there, unless it is a folder."""
    if path.is_dir() and not path.is_symlink():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    return path


def _open_file(path: Path) -> Path | None:
    """The entry among the open files of a process that a path leads to, such as ``/proc/self/fd/1``; None: to none."""
    while True:  # os.stat has followed the links, so they come to an end
        path = Path(os.path.realpath(path.parent)) / path.name
        if _OPEN_FILES.fullmatch(str(path.parent)):
            return path
        if not path.is_symlink():
            return None
        path = path.parent / os.readlink(path)


def _pour(contents: BinaryIO, path: Path) -> None:
    """Writes to what is no regular file, or is open."""
    entry = _open_file(path)
    if entry is not None and os.path.realpath(entry.parent) in (f"/proc/{os.getpid()}/fd", "/dev/fd"):
        sys.stdout.flush()  # what was printed comes first
        sys.stderr.flush()
        # The same open file: opened anew, it would be written from its beginning.
        with os.fdopen(os.dup(int(entry.name)), "wb") as there:
            shutil.copyfileobj(contents, there)
        return
    with path.open("wb") as there:
        shutil.copyfileobj(contents, there)


def _keep_mode(target: Path, temporary: Path) -> None:
    with suppress(OSError):  # there is none yet, or it belongs to somebody else
        mode = target.lstat().st_mode
        if stat.S_ISREG(mode):
            temporary.chmod(stat.S_IMODE(mode))


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


def write_text(path: Path, text: str, *, named: bool = False) -> None:
    """Writes a text file in UTF-8, whole or not at all; see ``replacing``.

    Raises:
        InputError: the file cannot be written.
    """
    write_bytes(path, text.encode(), named=named)


def write_bytes(path: Path, content: bytes, *, named: bool = False) -> None:
    """Writes a file, whole or not at all; see ``replacing``.

    Raises:
        InputError: the file cannot be written.
    """
    with replacing(path, named=named) as temporary:
        temporary.write_bytes(content)


READABLE = 2**30
"""Bytes of a file at most that is read whole."""


def read_bytes(path: Path, most: int = READABLE) -> bytes:
    """Reads a regular file whole. A pipe, on which reading would wait for ever, or a device is none.

    Raises:
        OSError: it cannot be read, is no regular file, or is longer than ``most`` bytes.
        ValueError: no file can have this name.
    """
    # Not opened first: to open a pipe is to wait for its other end.
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "is not a regular file")
    if found.st_size > most:
        raise OSError(errno.EFBIG, f"has {found.st_size} bytes, expected {most} at most")
    return path.read_bytes()


@contextmanager
def reading(path: Path) -> Iterator[Path]:
    """Yields ``path``, and turns an error of reading it into one that names the file.

    Raises:
        InputError: the file is missing, no regular file, or damaged.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise OSError(errno.EINVAL, "is not a regular file")
        yield path
    except InputError:
        raise
    except (OSError, ValueError, *_polars_errors("PolarsError", "PanicException")) as error:
        raise InputError(f"'{path}' cannot be read: {one_line(error)[:120]}") from None


MORE = 2**16
"""Bytes that are tried to be written where a library does not say why it could not."""


def reason(error: Exception, written: Path | None = None) -> str:
    """Returns the system's reason for an error of a file.

    polars hides it in the text of its own errors, or leaves it out: then the system is asked by writing on.

    Args:
        error: what was raised.
        written: the file, half-written, which is to be removed; None where there is none.
    """
    if isinstance(error, OSError):
        return error.strerror or one_line(error)
    number = re.search(r"\(os error (\d+)\)", str(error))
    if number:
        return os.strerror(int(number[1]))
    if written is not None and written.is_file():
        try:
            with written.open("ab") as there:
                there.write(bytes(MORE))
        except OSError as told:
            return told.strerror or one_line(told)
    return one_line(error)[:120]
