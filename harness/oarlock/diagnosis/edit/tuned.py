"""A tuned copy of an MJCF file: the author's text with another timestep, integrator, solref and solimp.

MuJoCo's own writer rounds numbers to six digits, which opens a loop that was closed; so the text is kept, includes are
pasted in, and files are referred to from where the copy lies. That nothing else changed is checked array by array.
"""

import xml.etree.ElementTree as ET
from pathlib import Path

from oarlock.base.errors import InputError, one_line
from oarlock.base.files import replacing, write_text
from oarlock.cases.equality_kinds import KIND_OF
from oarlock.diagnosis.edit.referrer import Referrer, folder_of
from oarlock.diagnosis.runs.trials import Setting
from oarlock.mechanics.load import load_model
from oarlock.mechanics.mjcf import differences


def write_tuned(source: Path, out: Path, setting: Setting) -> list[Path]:
    """Writes a copy of an MJCF file with a setting.

    Args:
        source: the MJCF file.
        out: where the copy goes; its folder must exist. Meshes, textures and such stay where they are.
        setting: for ``<option>`` and every equality.

    Returns:
        What was written: the copy, and beside it one of every attached model with equalities or options of its own.

    Raises:
        InputError: the source cannot be loaded, is a script, or is what would be overwritten; the folder cannot be
            written to; or the copy would not be the same model but for the setting.
    """
    if source.suffix == ".py":
        raise InputError(f"{source} builds its model by a script, expected an MJCF file to write a tuned copy of")
    if out.resolve() == source.resolve():
        raise InputError(f"'{out}' is the model itself, expected another file for its tuned copy")
    copier = _Tuner(out, setting)
    wanted = load_model(source)
    setting.apply(wanted)
    root = copier.read(source, source.parent, prefix="")
    if root.find("option") is None:
        ET.SubElement(root, "option")
    copier.tune(root)
    with replacing(out, named=True) as temporary:
        temporary.write_text(copier.header + ET.tostring(root, encoding="unicode") + "\n", encoding="utf-8")
        try:
            different = differences(wanted, load_model(temporary))
        except InputError as error:
            raise InputError(f"{source}: its tuned copy does not load: {one_line(error)}") from None
        if different:
            raise InputError(f"{source}: its tuned copy '{out}' has another {different[0]}, expected the same model")
    return [*copier.beside, out]


class _Tuner(Referrer):
    """Refers to files where they are, and sets every equality."""

    def __init__(self, out: Path, setting: Setting):
        super().__init__(folder_of(out))
        self._out, self._setting = out, setting
        self.beside: list[Path] = []

    def tune(self, root: ET.Element) -> bool:
        """Sets the equalities and options of a tree; says whether it has any.

        Those of an attached model too: where it has options of its own, MuJoCo warns of any that differ.
        """
        every = [element for parent in root.iter("equality") for element in parent]
        found = [element for element in every if element.tag in KIND_OF and KIND_OF[element.tag].known]
        for element in found:
            element.attrib.update(self._setting.equality_attributes())
        options = root.findall("option")
        for option in options:
            option.attrib.update(self._setting.option_attributes())
        return bool(found or options)

    def _keep_model(self, path: Path, element: ET.Element) -> str:
        root = self.read(path, path.parent, prefix="")
        if not self.tune(root):
            return self._keep(path, element)
        name = self._free(path.with_name(f"{self._out.stem}-{path.name}"))
        if self._from is None:
            raise InputError(f"'{self._out}' is no file, expected one: a tuned copy of '{path}' has to lie beside it")
        beside = self._from / name
        write_text(beside, ET.tostring(root, encoding="unicode") + "\n")
        self.beside.append(beside)
        return name
