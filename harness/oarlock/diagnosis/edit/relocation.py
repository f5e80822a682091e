"""Where the files of a changed model will lie, and the names by which they find one another from there.

The main file becomes the copy. A file that it includes or attaches stays where it is and is named from the new place,
unless something changes in it: then a copy of it lies beside that of the main file. Meshes, textures and such stay.
MuJoCo looks for an included or attached file beside the main one first, for an asset in the folder that ``<compiler>``
names, and then for either beside the file that names it; from another folder names may have to change.
"""

import os
from pathlib import Path

from oarlock.base.errors import InputError
from oarlock.diagnosis.edit.document import Document, Place, SourceFile, find
from oarlock.diagnosis.edit.editor import Editor
from oarlock.diagnosis.edit.markup import Element
from oarlock.mechanics.mjcf import FILES

_DIRECTORIES = {"texture": "texturedir"}
"""Element → attribute of ``<compiler>`` for its folder; ``meshdir`` for all others."""


class Relocation:
    """A document with its changes, on its way to a folder.

    Args:
        editor: its changes; the names of files are added to them.
        folder: as ``folder_of`` gives it; None: no folder, and files are named in full.
        name: of the main file's copy there.
        stem: begins the names of what has to lie beside it.
        editors: of the documents that are attached, by ``<model>``, with theirs.
        taken: names in the folder that are in use → by what.

    Raises:
        InputError: a file is missing, or one would have to lie beside a copy that is no file.
    """

    def __init__(
        self,
        editor: Editor,
        folder: Path | None,
        name: str,
        stem: str,
        editors: "dict[Document, Editor]",
        taken: dict[str, object],
    ):
        self._editor, self._document, self._folder = editor, editor.document, folder
        self._stem, self._taken = stem, taken
        self._moved = {self._document.main: name}
        self._extra: dict[str, str] = {}
        self.inner: dict[Document, Relocation] = {}
        for element, child in self._document.attached.items():
            own = editors[child]
            inner = Relocation(own, folder, "", stem, editors, taken)
            if own.changed or inner.inner:
                inner._moved[child.main] = self._free(child.main.path, child)
                self.inner[child] = inner
            del element
        for file in editor.changed:
            self._move(file)
        self._names: dict[Place, dict[str, str]] = {}

    def _free(self, path: Path, whose: object) -> str:
        """A name beside the copy that no file of the source has, nor another one that is copied."""
        if self._folder is None:
            raise InputError(f"a changed copy of '{path}' has to lie beside the copy, expected a file to write to")
        name, count = f"{self._stem}-{path.name}", 1
        while self._taken.setdefault(name, whose) is not whose:
            count += 1
            name = f"{self._stem}-{path.stem}-{count}{path.suffix}"
        return name

    def _move(self, file: SourceFile) -> None:
        if file not in self._moved:
            self._moved[file] = self._free(file.path, file)

    def texts(self) -> dict[str, bytes]:
        """Name → text of every file that has to be written; of the main file last."""
        found: dict[str, bytes] = {}
        for inner in self.inner.values():
            found |= inner.texts()
        while self._rename():
            pass
        for place, names in self._names.items():
            self._editor.set(place, names)
        if self._extra:
            own = [place for place in self._document.sections("compiler") if place.file is self._document.main]
            if own:
                self._editor.set(own[-1], self._extra)
            else:
                self._editor.add("", "compiler", self._extra)
        for file, name in reversed(self._moved.items()):
            found[name] = self._editor.text(file)
        return found

    def sources(self) -> dict[str, Path]:
        """Name of a copy → the file that it is a copy of; once ``texts`` was asked for."""
        found = {name: file.path for file, name in self._moved.items()}
        for inner in self.inner.values():
            found |= inner.sources()
        return found

    # Names.

    def _rename(self) -> bool:
        """Finds the names that have to change; says whether that made another file move, or another folder needed."""
        self._names = {}
        before = len(self._moved), len(self._extra)
        self._includes()
        folders = self._folders()
        for place in self._document.everything():
            tag = place.element.tag
            if tag in FILES and not _unread(place.element):
                self._assets(place, folders[_DIRECTORIES.get(tag, "meshdir")])
            elif tag == "model" and place.element.get("file"):
                self._model(place)
        for place in self._names:
            self._move(place.file)
        return (len(self._moved), len(self._extra)) != before

    def _includes(self) -> None:
        for file in self._document.files:
            for element, included in file.includes.items():
                name = self._moved.get(included)
                self._refer(Place(file, element), "file", included.path, name)

    def _model(self, place: Place) -> None:
        child = self._document.attached.get(place.element)
        folders = [self._document.base, place.file.here]
        path = child.main.path if child else find(place.element.get("file"), folders)
        inner = self.inner.get(child) if child else None
        self._refer(place, "file", path, inner._moved[child.main] if inner and child else None)

    def _refer(self, place: Place, attribute: str, path: Path, name: str | None) -> None:
        """Names a file that MuJoCo looks for beside the main one, then beside the one that names it."""
        text = place.element.get(attribute)
        if name is None and not _leads(text, [self._base, self._here(place.file)], path):
            name = self._relative(path, self._base)
        if name is not None and name != text:
            self._names.setdefault(place, {})[attribute] = name

    def _folders(self) -> dict[str, tuple[Path, Path, bool]]:
        """Attribute of ``<compiler>`` → the folder of assets, the one in the copy, and whether paths are stripped."""
        base = self._document.base
        found = {name: (base, self._base) for name in ("meshdir", "texturedir")}
        strip = False
        for place in self._document.sections("compiler"):
            given = place.element.attributes
            strip = place.element.get("strippath", "true" if strip else "false") == "true"
            for name in given.keys() & {"meshdir", "texturedir", "assetdir"}:
                folder = base / given[name].text
                kept = self._kept or Path(given[name].text).is_absolute()
                value = given[name].text if kept else self._relative(folder, self._base)
                if value != given[name].text:
                    self._names.setdefault(place, {})[name] = value
            for name in ("meshdir", "texturedir"):
                own = name if name in given else "assetdir" if "assetdir" in given else None
                if own:
                    value = self._names.get(place, {}).get(own, given[own].text)
                    found[name] = (base / given[own].text, self._base / value)
        for name, value in self._extra.items():
            found[name] = (found[name][0], self._base / value)
        return {name: (*folders, strip) for name, folders in found.items()}

    def _assets(self, place: Place, folders: tuple[Path, Path, bool]) -> None:
        old, new, strip = folders
        for attribute in FILES[place.element.tag]:
            text = place.element.get(attribute)
            if not text:
                continue
            text = Path(text).name if strip else text
            path = find(text, [old, place.file.here])
            if _leads(text, [new, self._here(place.file)], path):
                continue
            directory = _DIRECTORIES.get(place.element.tag, "meshdir")
            if old == self._document.base and new == self._base and not self._kept and (old / text).is_file():
                self._extra[directory] = self._relative(old, self._base)
                return
            self._names.setdefault(place, {})[attribute] = self._relative(path, new)

    # Folders.

    @property
    def _base(self) -> Path:
        return self._folder if self._folder is not None else Path("/")

    @property
    def _kept(self) -> bool:
        """Whether names are relative to the same folder as before."""
        return self._folder is not None and self._folder.resolve() == self._document.base.resolve()

    def _here(self, file: SourceFile) -> Path:
        return self._base if file in self._moved else file.here

    def _relative(self, path: Path, folder: Path) -> str:
        path = path.resolve()
        if self._folder is None:
            return path.as_posix()
        try:
            return Path(os.path.relpath(path, folder.resolve())).as_posix()
        except ValueError:  # another drive
            return path.as_posix()


def _leads(text: str, folders: list[Path], path: Path) -> bool:
    """Whether a name leads to a file, looked for in some folders one after another."""
    for folder in folders:
        if (found := folder / text).is_file():
            return found.resolve() == path.resolve()
    return False


def _unread(element: Element) -> bool:
    """Whether MuJoCo does not read the files that an element names: it makes the texture itself."""
    return element.tag == "texture" and element.get("builtin", "none") != "none"
