"""Folders of reports, which are replaced as a whole, and only if nothing but an old report is lost."""

import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from oarlock.base.errors import InputError
from oarlock.base.files import uninterrupted
from oarlock.base.scratch import scratch

CONTENTS = ("README.md", "figures", "index.html", "timings.json", "provenance.json")
"""Names in the folder of a report. A folder that holds anything else is not replaced."""


def require_report(target: Path, contents: Sequence[str]) -> None:
    """Checks that a folder may be replaced.

    Raises:
        InputError: ``target`` is a file, or a folder that holds anything but ``contents``.
    """
    if target.exists() and not target.is_dir():
        raise InputError(f"'{target}' is a file, expected a new folder or an old report")
    foreign = sorted(path.name for path in target.iterdir() if path.name not in contents) if target.exists() else []
    if foreign:
        raise InputError(f"'{target}' holds '{foreign[0]}', expected a new folder or an old report and nothing else")


def require_same_page(path: Path, text: str) -> None:
    """Checks that a page in a folder of several may be written: there is none yet, or an older one with its title.

    Args:
        path: of the page.
        text: what is to stand there; its first line is the title.

    Raises:
        InputError: another page is there.
    """
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            title = file.readline().rstrip("\n")
    except FileNotFoundError:
        return
    except OSError as error:
        raise InputError(f"cannot write '{path}': {error.strerror or error}") from None
    if title != text.partition("\n")[0]:
        raise InputError(f"'{path}' is a page of something else, expected a new folder or an old report")


def write_whole(target: Path, write: Callable[[Path], None]) -> Path:
    """Writes a folder under a temporary name, then puts it in place of the old one.

    Args:
        target: the folder.
        write: writes the contents to the folder that it is given.

    Raises:
        InputError: the folder cannot be written.
    """
    place = target
    try:
        target = target.resolve()  # of a link, what it leads to
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = scratch(f".{target.name}", target.parent)
        try:
            write(temporary)
            temporary.chmod(0o755)
            _replace(target, temporary)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        raise InputError(f"cannot write the report to '{place}': {error.strerror or error}") from None
    return place


def _replace(target: Path, new: Path) -> None:
    old = new.with_name(f"{new.name}.old")  # a name that is nobody's
    with uninterrupted():
        if target.exists():
            os.replace(target, old)
        try:
            os.replace(new, target)
        except OSError:
            if old.exists():
                os.replace(old, target)
            raise
    shutil.rmtree(old, ignore_errors=True)
