"""The folder of a report: replaced as a whole, and only where nothing but an old report is lost."""

import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from oarlock.base.errors import InputError

CONTENTS = ("README.md", "figures", "index.html", "timings.json", "provenance.json")
"""What the report of a model's results consists of. A folder that holds anything else is not replaced."""


def require_report(target: Path, contents: Sequence[str]) -> None:
    """Raises InputError where a folder holds anything but an old report of these contents, or is a file."""
    if target.exists() and not target.is_dir():
        raise InputError(f"'{target}' is a file, expected a new folder or an old report")
    foreign = sorted(path.name for path in target.iterdir() if path.name not in contents) if target.exists() else []
    if foreign:
        raise InputError(f"'{target}' holds '{foreign[0]}', expected a new folder or an old report and nothing else")


def write_whole(target: Path, write: Callable[[Path], None]) -> Path:
    """Has a folder written under a temporary name, which then takes the place of the old one.

    Raises:
        InputError: it cannot be written.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
        try:
            write(temporary)
            temporary.chmod(0o755)
            _replace(target, temporary)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        raise InputError(f"cannot write the report to '{target}': {error.strerror or error}") from None
    return target


def _replace(target: Path, new: Path) -> None:
    old = target.with_name(f".{target.name}.old")
    shutil.rmtree(old, ignore_errors=True)
    if target.exists():
        os.replace(target, old)
    os.replace(new, target)
    shutil.rmtree(old, ignore_errors=True)
