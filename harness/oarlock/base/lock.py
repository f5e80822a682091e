"""Folders that belong to one process at a time."""

import datetime
import errno
import json
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:  # Windows has none
    fcntl = None

from oarlock.base.errors import InputError, one_line
from oarlock.base.processes import Owner, host_name, myself

NAME = ".oarlock.lock"
"""Name of the file that says whose a folder is; it is there as long as the folder belongs to somebody."""

_NOT_HERE = (errno.ENOSYS, errno.ENOTSUP, errno.EINVAL, errno.ENOLCK)
"""What a file system says that has no locks."""


@contextmanager
def locked(folders: Iterable[Path], what: str, say: Callable[[str], None]) -> Iterator[None]:
    """Owns folders for a block. What a dead process owned is taken over.

    The system's lock on a file in the folder decides, which ends with the process that has it; on a file system that
    has no locks, whether the process lives that is named in the file. What a process of another machine owns is never
    taken over, as it cannot be looked for.

    Args:
        folders: the folders, which are made where they are missing.
        what: what they are owned for, such as ``oarlock run``.
        say: is told, in one line, of a folder that is taken over.

    Raises:
        InputError: one of them belongs to somebody else, or its file cannot be written.
    """
    with ExitStack() as stack:
        for folder in dict.fromkeys(folder.absolute() for folder in folders):
            try:
                if not folder.exists():
                    folder.mkdir(parents=True, exist_ok=True)
                    stack.callback(_remove_empty, folder)
                stack.callback(_release, folder / NAME, _taken(folder, what, say))
            except OSError as error:
                raise InputError(f"cannot write '{folder / NAME}': {error.strerror or one_line(error)}") from None
        yield


def _taken(folder: Path, what: str, say: Callable[[str], None]) -> int:
    """Takes the lock of a folder; returns the open file that holds it."""
    path = folder / NAME
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o644)
        try:
            held = _held(file)
            if not _is_at(file, path):  # whoever had it removed it meanwhile
                os.close(file)
                continue
            before = _read(file)
            owner = Owner.parse(str(before.get("owner", "")))
            if held is False or (owner is not None and (not owner.here or (held is None and not owner.dead))):
                raise InputError(f"'{folder}' {_in_use(before, owner, path)}")
            if before:
                say(f"'{folder}' was left locked by {before.get('what')}, process {owner and owner.pid}, which is gone")
            now = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
            content = {"what": what, "owner": str(myself()), "host": host_name(), "since": now}
            os.lseek(file, 0, os.SEEK_SET)
            os.ftruncate(file, 0)
            os.write(file, (json.dumps(content) + "\n").encode())
        except BaseException:
            with suppress(OSError):
                os.close(file)
            raise
        return file


def _held(file: int) -> bool | None:
    """Locks an open file: whether it is this process's now; None where the system has no locks for it."""
    if fcntl is None:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno in _NOT_HERE:
            return None
        raise
    return True


def _is_at(file: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file), path.stat(follow_symlinks=False))
    except FileNotFoundError:
        return False


def _read(file: int) -> dict[str, Any]:
    try:
        content = json.loads(os.read(file, 4096) or b"{}")
    except ValueError:
        content = {}
    return content if isinstance(content, dict) else {}


def _in_use(before: dict[str, Any], owner: Owner | None, path: Path) -> str:
    """Says who has a folder."""
    if owner is None:
        return "is in use by another oarlock, expected another folder, or that it ends first"
    who = f"'{before.get('what')}', process {owner.pid} on {before.get('host')}, since {before.get('since')}"
    if owner.here:
        return f"is in use by {who}; expected another folder, or that it ends first"
    return f"is in use by {who}; if it is gone, remove '{path}'"


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()


def _release(path: Path, file: int) -> None:
    with suppress(OSError):
        if _is_at(file, path):
            path.unlink()
    with suppress(OSError):
        os.close(file)
