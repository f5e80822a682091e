"""Self-contained copies of MJCF files: includes pasted in, assets beside them, joints, equalities and actuators named.

The author's text is kept: defaults, comments, and every number digit for digit. MuJoCo's own writer would round numbers
to six digits, and a loop that was closed to 1e-16 would come out open. That the copy is the same model is checked: both
are compiled, and every array of the two must be equal bit for bit.
"""

import os
import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from oarlock.base.errors import InputError, one_line
from oarlock.base.files import write_text
from oarlock.cases.equality_kinds import KIND_OF
from oarlock.mechanics.assets import require_kind, require_within
from oarlock.mechanics.load import load_model

ASSETS = "assets"
"""Name of the folder of the files that a copy refers to."""

FILES = {
    "mesh": ("file",),
    "hfield": ("file",),
    "skin": ("file",),
    "flexcomp": ("file",),
    "texture": ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback"),
}
"""Element → attributes that refer to files."""

_ENDS = {element: kind.ends for element, kind in KIND_OF.items()}
"""Element of an equality → attributes that a name for it is made of."""

_BEFORE_ROOT = re.compile(rb"(?:\xef\xbb\xbf)?\s*(?:<\?xml.*?\?>\s*)?((?:<!--.*?-->\s*)+)", re.DOTALL)
"""Comments in front of the root, where a tree has no place for them."""

_DRIVEN = ("joint", "jointinparent", "tendon", "site", "body", "slidersite", "cranksite")


@dataclass
class Copied:
    """What copying a model did.

    Attributes:
        files: names of the files in ``assets/``.
        names: names given to elements that had none.
    """

    files: list[str] = field(default_factory=list)
    names: list[str] = field(default_factory=list)


def copy_model(source: Path, folder: Path, *, outside: bool = False) -> Copied:
    """Writes ``model.xml`` and, if it refers to files, ``assets/`` into a folder.

    Args:
        source: the model.
        folder: the folder.
        outside: whether files are copied from outside the folder of the model, too.

    Raises:
        InputError: MuJoCo refuses the model, it has no equality, a file that it names cannot be found or copied, is
            of no kind that MuJoCo reads or lies outside, or the copy is not the same model.
    """
    original = load_model(source)
    copier = Copier(folder, None if outside else source.parent)
    root = copier.read(source, source.parent, prefix=f"{ASSETS}/")
    copier.name(root)
    text = copier.header + ET.tostring(root, encoding="unicode") + "\n"
    path = folder / "model.xml"
    write_text(path, text)
    try:
        different = differences(original, load_model(path))
    except InputError as error:
        raise InputError(f"{source}: its self-contained copy does not load: {one_line(error)}") from None
    if different:
        raise InputError(f"{source}: its self-contained copy has another {different[0]}, expected the same model")
    return copier.copied


class Copier:
    """Reads MJCF files with everything that they include, and copies the files that they refer to.

    Attributes:
        copied: what was done so far.
        header: comments in front of the root of any file that was read.

    Args:
        folder: folder of the copy.
        tree: folder that what is read and copied has to lie in; None: anywhere.
    """

    def __init__(self, folder: Path, tree: Path | None = None):
        self._tree = tree
        self.copied = Copied()
        self.header = ""
        self._folder = folder
        self._taken: dict[str, Path] = {}
        self._included: dict[ET.Element, Path] = {}  # folder of the included file that an element is written in

    # Files.

    def read(self, path: Path, base: Path, prefix: str) -> ET.Element:
        """Reads a file, pastes its includes in and copies its assets.

        Args:
            path: the file.
            base: folder that its paths are relative to.
            prefix: put before the names of the copied assets.

        Raises:
            InputError: a file is missing or not well-formed.
        """
        root = self._parse(path)
        self._paste(root, base, path.parent)
        self._gather(root, base, prefix)
        return root

    def _parse(self, path: Path) -> ET.Element:
        try:
            text = path.read_bytes()
            root = ET.fromstring(text, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
        except (OSError, ET.ParseError) as error:
            raise InputError(f"{path}: not well-formed XML: {one_line(error)}") from None
        if before := _BEFORE_ROOT.match(text):  # of every file: a licence has to stay with what it covers
            self.header += before[1].decode(errors="replace")
        return root

    def _paste(self, parent: ET.Element, base: Path, here: Path) -> None:
        """Pastes includes in. Like MuJoCo it looks beside the model first, then beside the including file."""
        for child in list(parent):
            if child.tag != "include":
                self._paste(child, base, here)
                continue
            path = self._find(child.get("file", ""), [base, here])
            require_within(path, self._tree)
            root = self._parse(path)
            self._paste(root, base, path.parent)
            for element in root.iter():
                self._included.setdefault(element, path.parent)
            at = list(parent).index(child)
            parent.remove(child)
            for offset, element in enumerate(root):
                parent.insert(at + offset, element)
            if len(root):
                root[-1].tail = child.tail

    def _gather(self, root: ET.Element, base: Path, prefix: str) -> None:
        meshes, textures, strip = base, base, False
        for compiler in root.iter("compiler"):
            assets = compiler.attrib.pop("assetdir", None)
            meshes = _beside(base, compiler.attrib.pop("meshdir", assets), meshes)
            textures = _beside(base, compiler.attrib.pop("texturedir", assets), textures)
            strip = compiler.attrib.pop("strippath", "true" if strip else "false") == "true"
        for element in root.iter():
            where = textures if element.tag == "texture" else meshes
            for attribute in FILES.get(element.tag, ()) if isinstance(element.tag, str) else ():
                if (file := element.get(attribute)) and not _unread(element):
                    file = Path(file).name if strip else file
                    folders = [where, base, *filter(None, [self._included.get(element)])]
                    element.set(attribute, prefix + self._keep(self._find(file, folders), element))
            if element.tag == "model" and (file := element.get("file")):
                element.set("file", prefix + self._keep_model(self._find(file, [base]), element))

    def _find(self, file: str, folders: list[Path]) -> Path:
        for folder in folders:  # MuJoCo takes '..' out of a name without a look at the folders
            if (path := Path(os.path.normpath(folder / file))).is_file():
                return path
        places = dict.fromkeys(repr(str(folder)) for folder in folders)
        raise InputError(f"no file '{file}' in {' or '.join(places)}")

    def _keep(self, path: Path, element: ET.Element) -> str:
        require_within(path, self._tree)
        require_kind(path, element)
        name = self._free(path)
        target = self._folder / ASSETS / name
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target)
            self.copied.files.append(name)
        return name

    def _keep_model(self, path: Path, element: ET.Element) -> str:
        require_within(path, self._tree)
        name = self._free(path)
        target = self._folder / ASSETS / name
        if not target.exists():
            root = self.read(path, path.parent, prefix="")
            write_text(target, ET.tostring(root, encoding="unicode") + "\n")
            self.copied.files.append(name)
        return name

    def _free(self, path: Path) -> str:
        """Returns an unused file name for an asset: files from different folders may have the same name."""
        path, name, count = path.resolve(), path.name, 1
        while self._taken.setdefault(name, path) != path:
            count += 1
            name = f"{path.stem}-{count}{path.suffix}"
        return name

    # Names.

    def name(self, root: ET.Element) -> None:
        """Names joints, equalities and actuators that have no name, because a case addresses them by name."""
        joints: set[str | None] = {e.get("name") for tag in ("joint", "freejoint") for e in root.iter(tag)}
        for body, element in _joints(root):
            kind = "free" if element.tag == "freejoint" else element.get("type", "joint")
            self._give(element, f"{body}_{kind}", joints)
        for section, parts in (("equality", _ENDS), ("actuator", None)):
            elements = [e for parent in root.iter(section) for e in parent if isinstance(e.tag, str)]
            taken: set[str | None] = {e.get("name") for e in elements}
            for element in elements:
                ends = (parts or {}).get(element.tag, ()) if parts else _DRIVEN
                words = [word for end in ends if (word := element.get(end))]
                first, last = ([element.tag], []) if parts else ([], [element.tag])
                self._give(element, "_".join([*first, *words, *last]), taken)

    def _give(self, element: ET.Element, wanted: str, taken: set[str | None]) -> None:
        if element.get("name"):
            return
        name, count = wanted, 1
        while name in taken:
            count += 1
            name = f"{wanted}{count}"
        taken.add(name)
        # First among the attributes, where one looks for it.
        attributes = dict(element.attrib)
        element.attrib.clear()
        element.attrib.update({"name": name, **attributes})
        self.copied.names.append(name)


def _unread(element: ET.Element) -> bool:
    """Whether MuJoCo does not read the files that an element names: it makes the texture itself."""
    return element.tag == "texture" and element.get("builtin", "none") != "none"


def _beside(base: Path, folder: str | None, otherwise: Path) -> Path:
    return otherwise if folder is None else base / folder


def _joints(root: ET.Element) -> Iterator[tuple[str, ET.Element]]:
    """Yields every joint of the tree of bodies with the name of its body."""
    count = 0

    def walk(element: ET.Element, body: str) -> Iterator[tuple[str, ET.Element]]:
        nonlocal count
        for child in element:
            if child.tag in ("joint", "freejoint"):
                yield body, child
            elif child.tag == "body":
                count += 1
                yield from walk(child, child.get("name") or f"body{count}")
            elif child.tag in ("frame", "replicate"):
                yield from walk(child, body)

    for world in root.iter("worldbody"):
        yield from walk(world, "world")


# Sameness.

_NAMES = ("names", "names_map", "paths", "nnames", "nnames_map", "npaths", "nbuffer", "signature")


def differences(first: mujoco.MjModel, second: mujoco.MjModel) -> list[str]:
    """Returns the fields in which two models differ in any bit, apart from names and paths of files."""
    found = []
    for name, value, other in _fields(first, second):
        if isinstance(value, np.ndarray):
            if value.shape != other.shape or value.tobytes() != other.tobytes():
                found.append(name)
        elif value != other:
            found.append(name)
    return found


def _fields(first: Any, second: Any, within: str = "") -> Iterator[tuple[str, Any, Any]]:
    for name in dir(first):
        if name.startswith(("_", "name_")) or name.endswith(("_pathadr", "_contenttypeadr")) or name in _NAMES:
            continue
        value = getattr(first, name)
        if isinstance(value, np.ndarray | int | float):
            yield within + name, value, getattr(second, name)
        elif type(value).__module__.startswith("mujoco") and not callable(value):
            yield from _fields(value, getattr(second, name), f"{within}{name}.")
