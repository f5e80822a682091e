"""The folder that a changed copy of a model lies in."""

from pathlib import Path

from oarlock.base.errors import InputError
from oarlock.base.files import destination, reason
from oarlock.mechanics.given import COMPILED


def folder_of(target: Path) -> Path | None:
    """The folder that the names of files in a copy are relative to; None where the copy is not kept as a file.

    Raises:
        InputError: the copy cannot be written there.
    """
    try:
        file = destination(target)
    except (OSError, ValueError) as error:
        raise InputError(f"'{target}' cannot be written: {reason(error)}") from None
    if file is None:
        return None
    if not file.parent.is_dir():
        raise InputError(f"'{target}' cannot be written: no folder '{file.parent}'")
    return file.parent


def require_place(source: Path, out: Path) -> None:
    """Checks that a model may have a changed copy at a place.

    Raises:
        InputError: it is no MJCF file, or the place is its own or cannot be written to.
    """
    if source.suffix in (".py", COMPILED):
        what = "builds its model by a script" if source.suffix == ".py" else "stands for a compiled model"
        raise InputError(f"'{source}' is not an MJCF file (.xml): it {what}, expected MJCF to change")
    if out.resolve() == source.resolve():
        raise InputError(f"'{out}' is the model itself, expected another file for its copy")
    folder_of(out)
