"""A changed copy of a model: the author's text with the changes, and proof that nothing else is another one."""

import glob
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import mujoco

from oarlock.base.errors import InputError, one_line
from oarlock.base.files import replacing, write_bytes
from oarlock.diagnosis.edit.changes import Change
from oarlock.diagnosis.edit.document import Document
from oarlock.diagnosis.edit.editor import Editor
from oarlock.diagnosis.edit.place import folder_of, require_place
from oarlock.diagnosis.edit.relocation import Relocation
from oarlock.mechanics.load import load_model
from oarlock.mechanics.mjcf import differences


def write_changed(source: Path, out: Path, changes: Sequence[Change]) -> list[Path]:
    """Writes a copy of a model with changes, as ``write_copies``; gives what was written."""
    return list(write_copies(source, out, changes))


def write_copies(source: Path, out: Path, changes: Sequence[Change]) -> dict[Path, Path]:
    """Writes a copy of a model with changes.

    Args:
        source: MJCF file.
        out: the copy; what is there is replaced.
        changes: of the model; none: the copy is the source, byte for byte, where both lie in one folder.

    Returns:
        What was written → what it is a copy of: copies of changed files that the source includes or attaches, beside
        ``out``, then ``out``.

    Raises:
        InputError: the source is no MJCF file or cannot be loaded, ``out`` is the source or cannot be written, or the
            copy would be another model.
    """
    require_place(source, out)
    folder = folder_of(out)
    wanted = load_model(source, closed=False)
    document = Document(source)
    editors = {one: Editor(one) for one in _documents(document)}
    for change in changes:
        change.edit(editors, document, wanted)
    for change in changes:
        change.apply(wanted)
    taken: dict[str, object] = {out.name: document.main}
    if folder is not None:
        files = [file for one in editors for file in one.files]
        taken |= {name: None for name in _of_others(out, folder)}
        taken |= {file.path.name: file for file in files if file.here.resolve() == folder.resolve()}
    relocation = Relocation(editors[document], folder, out.name, out.stem, editors, taken)
    texts, sources = relocation.texts(), relocation.sources()
    main = texts.pop(out.name)
    beside = {(folder or Path()) / name: text for name, text in texts.items()}
    before = {path: path.read_bytes() if path.is_file() else None for path in beside}
    try:
        for path, text in beside.items():
            write_bytes(path, text)
        with replacing(out, named=True) as temporary:
            temporary.write_bytes(main)
            _require_same(source, temporary, wanted, changes)
    except BaseException:
        for path, text in before.items():
            with suppress(OSError):
                path.unlink() if text is None else path.write_bytes(text)
        raise
    return {path: sources[path.name] for path in (*beside, out)}


def _of_others(out: Path, folder: Path) -> set[str]:
    """Names that a copy beside ``out`` would have, of files that no earlier ``out`` there leads to."""
    there = {path.name: path for path in folder.glob(f"{glob.escape(out.stem)}-*")}
    left, own = [out], set[str]()
    while left:
        path = left.pop()
        text = path.read_bytes() if path.is_file() else b""
        led = {name for name in there.keys() - own if re.search(rb"[\"']" + re.escape(name.encode()) + rb"[\"']", text)}
        own |= led
        left += [there[name] for name in led]
    return there.keys() - own


def require_room(source: Path, change: Change) -> None:
    """Checks that the text of a model has a place for a change, without writing it.

    Raises:
        InputError: it has none.
    """
    document = Document(source)
    change.edit({one: Editor(one) for one in _documents(document)}, document, load_model(source))


def _documents(document: Document) -> Iterator[Document]:
    yield document
    for child in document.attached.values():
        yield from _documents(child)


def _require_same(source: Path, copy: Path, wanted: mujoco.MjModel, changes: Sequence[Change]) -> None:
    try:
        compiled = load_model(copy)
    except InputError as error:
        raise InputError(f"{source}: its changed copy does not load: {one_line(error)}") from None
    allowed = tuple(field for change in changes for field in change.fields)
    different = [field for field in differences(wanted, compiled) if not field.startswith(allowed)]
    if different:
        raise InputError(f"{source}: its changed copy has another {different[0]}, expected the same model")
    for change in changes:
        try:
            change.require(compiled)
        except InputError as error:
            raise InputError(f"{source}: its changed copy has {error}") from None
