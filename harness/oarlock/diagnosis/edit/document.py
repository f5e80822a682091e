"""An MJCF model as its author wrote it: the main file, what it includes, and the models that it attaches."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from oarlock.base.errors import InputError
from oarlock.base.files import reason
from oarlock.diagnosis.edit.markup import Element, parse
from oarlock.mechanics.limits import require_moderate


@dataclass(eq=False)
class SourceFile:
    """One file.

    Attributes:
        path: where it is.
        text: its bytes.
        root: its elements.
        includes: ``<include>`` in it → the file that is pasted there.
    """

    path: Path
    text: bytes
    root: Element
    includes: dict[Element, "SourceFile"] = field(default_factory=dict)

    @property
    def here(self) -> Path:
        """Its folder, in which MuJoCo looks last."""
        return self.path.parent


@dataclass(frozen=True)
class Place:
    """An element and the file that it stands in."""

    file: SourceFile
    element: Element


class Document:
    """A model: a file with its includes pasted in. What it attaches is a document of its own.

    Args:
        path: the main file.

    Attributes:
        main: the main file.
        base: folder that the names of files are relative to, of all files.
        files: the main file, and all that are included, each once, as MuJoCo reads them.

    Raises:
        InputError: a file cannot be read, or is not well-formed.
    """

    def __init__(self, path: Path):
        require_moderate(path)
        self.base = path.parent
        self.files: list[SourceFile] = []
        self.main = self._read(path)

    def _read(self, path: Path) -> SourceFile:
        try:
            text = path.read_bytes()
        except (OSError, ValueError) as error:
            said = reason(error) if isinstance(error, OSError) else error
            raise InputError(f"'{path}' cannot be read: {said}") from None
        file = SourceFile(path, text, parse(text, path))
        self.files.append(file)
        for element in file.root.within():
            if element.tag == "include":
                file.includes[element] = self._read(find(element.get("file"), [self.base, file.here]))
        return file

    # What MuJoCo reads, in its order.

    def children(self, place: Place) -> Iterator[Place]:
        """The elements in another one."""
        for child in place.element.children:
            if child.tag == "include" and child in place.file.includes:
                included = place.file.includes[child]
                yield from self.children(Place(included, included.root))
            else:
                yield Place(place.file, child)

    def sections(self, tag: str) -> list[Place]:
        """Every ``<tag>`` of the root."""
        top = self.children(Place(self.main, self.main.root))
        return [place for place in top if place.element.tag == tag]

    def members(self, section: str) -> list[Place]:
        """The elements of all sections of a name."""
        return [place for one in self.sections(section) for place in self.children(one)]

    def everything(self) -> Iterator[Place]:
        """Every element of every file, but the roots of included ones."""
        left = [Place(self.main, self.main.root)]
        while left:
            place = left.pop()
            yield place
            left += reversed(list(self.children(place)))

    def bodies(self) -> list[Place] | None:
        """The bodies in the order of their numbers, from 1; None where a file says that of some only as copies."""
        found, left = list[Place](), [place for one in self.sections("worldbody") for place in self.children(one)]
        left.reverse()
        while left:
            place = left.pop()
            if place.element.tag in ("replicate", "attach", "composite", "flexcomp"):
                return None
            if place.element.tag == "body":
                found.append(place)
            if place.element.tag in ("body", "frame"):
                left += reversed(list(self.children(place)))
        return found

    @cached_property
    def attached(self) -> "dict[Element, Document]":
        """``<model>`` → the document that it names, without those that those name."""
        found = {}
        for place in self.everything():
            if place.element.tag == "model" and place.element.get("file"):
                path = find(place.element.get("file"), [self.base, place.file.here])
                if path.suffix == ".xml":
                    found[place.element] = Document(path)
        return found

    @cached_property
    def copies(self) -> bool:
        """Whether elements of the model may be copies of one in the file, or come from another one."""
        return any(place.element.tag in ("replicate", "attach", "composite", "flexcomp") for place in self.everything())


def find(name: str, folders: list[Path]) -> Path:
    """The file of a name in the first of some folders that has it.

    Raises:
        InputError: none has it.
    """
    for folder in folders:
        if name and (path := folder / name).is_file():
            return path
    raise InputError(f"no file '{name}' in {' or '.join(repr(str(folder)) for folder in folders)}")
