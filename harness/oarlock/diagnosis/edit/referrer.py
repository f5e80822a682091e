"""Copies that name the files that a model refers to where they are, instead of copying them."""

import os
import xml.etree.ElementTree as ET
from pathlib import Path

from oarlock.base.errors import InputError
from oarlock.base.files import destination, reason
from oarlock.mechanics.mjcf import Copier


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


class Referrer(Copier):
    """Names files as seen from a folder; in full where there is none.

    Args:
        folder: as ``folder_of`` gives it.
    """

    def __init__(self, folder: Path | None):
        super().__init__(folder or Path())
        self._from = folder

    def _keep(self, path: Path, element: ET.Element) -> str:
        path = path.resolve()
        if self._from is None:
            return path.as_posix()
        try:
            return Path(os.path.relpath(path, self._from.resolve())).as_posix()
        except ValueError:  # another drive
            return path.as_posix()

    def _keep_model(self, path: Path, element: ET.Element) -> str:
        return self._keep(path, element)
