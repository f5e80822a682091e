"""Temporary folders that say whose they are, so that those of dead processes can be told, and go."""

import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from oarlock.base.processes import Owner, myself

PREFIX = "oarlock"
"""Begins the names of temporary folders in that of the system."""

FOREIGN_S = 7 * 86400.0
"""Time (s) without a write after which the folder of a process of another machine, which nobody here can look for, is
taken for left behind."""

_NAME = re.compile(rf"(?:{PREFIX}|\..+)\.({Owner.PATTERN})\.\w+", re.ASCII | re.DOTALL)
_FILE = re.compile(r"\..+\.(\d+)\.tmp(?:\.\w+)?", re.ASCII | re.DOTALL)
"""Name of a file that is about to be moved to its place (``base.files.replacing``)."""


def scratch(prefix: str = PREFIX, parent: Path | None = None) -> Path:
    """Makes a temporary folder, named after this process.

    Args:
        prefix: begins its name: ``PREFIX``, or something with a dot in front.
        parent: where it is made; None for the system's temporary folder.

    Raises:
        OSError: it cannot be made.
    """
    return Path(tempfile.mkdtemp(prefix=f"{prefix}.{myself()}.", dir=parent))


@contextmanager
def scratch_folder(prefix: str = PREFIX, parent: Path | None = None) -> Iterator[Path]:
    """Makes a temporary folder for a block, as ``scratch``, and removes it."""
    folder = scratch(prefix, parent)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def sweep_up(folders: Iterable[Path] = ()) -> str:
    """Removes what dead processes left in the system's temporary folder and in others.

    Only what carries the name of ``scratch``, belongs to this user, and whose process is known to be dead or, if it was
    one of another machine, is old (``FOREIGN_S``); in the other folders also files that were about to be moved to their
    place.

    Args:
        folders: the other folders, which nobody else writes to now; those that are not there are passed over.

    Returns:
        One line about what was removed; empty if nothing was.
    """
    removed = list(_swept(Path(tempfile.gettempdir()), _left_behind))
    for folder in dict.fromkeys(folders):
        removed += _swept(folder, lambda entry: _left_behind(entry) or _unfinished(entry))
    if not removed:
        return ""
    places = sorted({str(path.parent) for path in removed})
    count = f"{len(removed)} temporary folders and files" if len(removed) > 1 else "a temporary folder or file"
    return f"removed {count} of processes that ended before they could, in {', '.join(places)}"


def _swept(folder: Path, gone: "Callable[[os.DirEntry[str]], bool]") -> Iterator[Path]:
    try:
        with os.scandir(folder) as found:
            entries = [entry for entry in found if gone(entry)]
    except OSError:
        return
    for entry in entries:
        path = Path(entry.path)
        if entry.is_dir(follow_symlinks=False):
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
        if not path.exists():
            yield path


def _left_behind(entry: "os.DirEntry[str]") -> bool:
    """Whether it is a temporary folder of a process that is dead."""
    match = _NAME.fullmatch(entry.name)
    owner = Owner.parse(match[1]) if match else None
    try:
        if owner is None or not entry.is_dir(follow_symlinks=False) or not _own(entry):
            return False
        return owner.dead or (not owner.here and _idle_s(entry) > FOREIGN_S)
    except OSError:
        return False


def _unfinished(entry: "os.DirEntry[str]") -> bool:
    """Whether it is a file that a dead process was about to move to its place."""
    match = _FILE.fullmatch(entry.name)
    try:
        if match is None or not entry.is_file(follow_symlinks=False) or not _own(entry):
            return False
        return Owner(int(match[1]), 0, myself().host).dead
    except OSError:
        return False


def _own(entry: "os.DirEntry[str]") -> bool:
    return not hasattr(os, "geteuid") or entry.stat(follow_symlinks=False).st_uid == os.geteuid()


def _idle_s(entry: "os.DirEntry[str]") -> float:
    """Time since the last write in a folder, s."""
    newest = entry.stat(follow_symlinks=False).st_mtime
    for inside in os.scandir(entry.path):
        newest = max(newest, inside.stat(follow_symlinks=False).st_mtime)
    return time.time() - newest
