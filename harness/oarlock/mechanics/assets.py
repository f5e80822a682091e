"""Which files a copy of a model may take along: those that MuJoCo reads for an element, from where the model lies.

A model is data from somebody else, and it may name any file: ``<texture file="/etc/passwd"/>``. MuJoCo reads, or skips,
what it names and shows nothing of it, but a copy is handed on.
"""

import struct
import xml.etree.ElementTree as ET
from pathlib import Path

from oarlock.base.errors import InputError

OUTSIDE = "--outside"
"""The flag of ``oarlock new`` that allows files from elsewhere."""

KINDS = {
    "mesh": (".obj", ".stl", ".msh"),
    "skin": (".skn",),
    "flexcomp": (".obj", ".stl", ".msh", ".png"),
    "texture": (".png", ".ktx"),
    "hfield": (".png",),
}
"""Element → endings of the files that MuJoCo reads for it."""

_SIGNATURES = {".png": b"\x89PNG\r\n\x1a\n", ".ktx": b"\xabKTX"}
_BEGINNING = 16


def require_kind(path: Path, element: ET.Element) -> None:
    """Checks that a file is of a kind that MuJoCo reads for an element: by its name, and pictures by how they begin.

    Raises:
        InputError: it is of another kind.
    """
    ending = _ending(path, element)
    with path.open("rb") as file:
        beginning = file.read(_BEGINNING)
    if element.tag == "hfield" and ending not in KINDS["hfield"]:
        if not _is_field(beginning, path.stat().st_size):
            raise InputError(f"'{path}' of <hfield> is neither a picture (.png) nor a height field of MuJoCo's")
    elif ending not in KINDS[element.tag]:
        raise InputError(f"'{path}' of <{element.tag}> is not copied, expected {', '.join(KINDS[element.tag])}")
    elif not beginning.startswith(_SIGNATURES.get(ending, b"")):
        raise InputError(f"'{path}' of <{element.tag}> is not copied: it does not begin as a file {ending} does")


def require_within(path: Path, tree: Path | None) -> None:
    """Checks that a file lies in a folder or below it, links followed.

    Args:
        path: the file.
        tree: the folder; None: any file will do.

    Raises:
        InputError: it lies elsewhere.
    """
    if tree is not None and not path.resolve().is_relative_to(tree.resolve()):
        raise InputError(f"'{path}' is outside the folder of the model, expected {OUTSIDE} to copy it all the same")


def _ending(path: Path, element: ET.Element) -> str:
    kind = element.get("content_type", "").partition("/")[2]  # image/png: MuJoCo goes by it and not by the name
    return f".{kind.removeprefix('vnd.').removeprefix('x-').lower()}" if kind else path.suffix.lower()


def _is_field(beginning: bytes, size: int) -> bool:
    """Whether it is a height field as MuJoCo reads it: two counts, and so many floats."""
    if len(beginning) < 8:
        return False
    rows, columns = struct.unpack("<ii", beginning[:8])
    return rows > 0 and columns > 0 and size == 4 * (2 + rows * columns)
