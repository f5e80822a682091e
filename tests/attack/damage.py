"""What can befall kept files: bytes and values changed, files cut, gone, exchanged, something else in their place."""

import json
import os
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

from attack.models import garbled

ODD: list[Any] = [
    None,
    True,
    False,
    0,
    -1,
    2**70,
    1e308,
    "",
    "x",
    "\u001b[2J",
    "../../x",
    "[b]",
    [],
    [[]],
    {},
    {"a": 1},
]
"""Values of JSON in the place of others."""


def retyped(path: Path, chance: random.Random) -> None:
    """One to three values of a document become others, as an edit by hand would make them; now and then resealed."""
    try:
        document = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return
    for _ in range(chance.choice([1, 1, 2, 3])):
        place, key = _somewhere(document, chance)
        if key is None:
            continue
        match chance.randrange(5):
            case 0:
                del place[key]
            case 1 if isinstance(place[key], int | float):
                place[key] = place[key] * 2 + 1
            case 2 if isinstance(place[key], str):
                place[key] = place[key] + chance.choice(["x", "\n", "\u001b[31m", "/../x"])
            case _:
                place[key] = chance.choice(ODD)
    path.write_text(json.dumps(document, indent=1) + "\n")


def _somewhere(document: Any, chance: random.Random) -> tuple[Any, Any]:
    """A place in a document: what holds it and its key or index; (None, None) if there is none."""
    found: tuple[Any, Any] = (None, None)
    while isinstance(document, dict | list) and document:
        key = chance.choice(list(document)) if isinstance(document, dict) else chance.randrange(len(document))
        found = document, key
        if chance.random() < 0.25:
            break
        document = document[key]
    return found


def bytes_changed(path: Path, chance: random.Random) -> None:
    content = path.read_bytes()
    for _ in range(chance.choice([1, 1, 5])):
        content = garbled(content, chance)
    path.write_bytes(content)


def digit_changed(path: Path, chance: random.Random) -> None:
    """One digit of a text; in other files a bit."""
    content = bytearray(path.read_bytes())
    digits = [at for at, byte in enumerate(content) if byte in b"0123456789"]
    if path.suffix != ".parquet" and digits:
        at = chance.choice(digits)
        content[at] = ord("0") + (content[at] - ord("0") + 1 + chance.randrange(9)) % 10
    elif content:
        content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
    path.write_bytes(content)


def emptied(path: Path, _: random.Random) -> None:
    path.write_bytes(b"")


def zeroed(path: Path, _: random.Random) -> None:
    path.write_bytes(bytes(path.stat().st_size))


def gone(path: Path, _: random.Random) -> None:
    path.unlink()


def pipe(path: Path, _: random.Random) -> None:
    path.unlink()
    os.mkfifo(path)


def folder(path: Path, _: random.Random) -> None:
    path.unlink()
    path.mkdir()


def link_to_itself(path: Path, _: random.Random) -> None:
    path.unlink()
    path.symlink_to(path.name)


def link_elsewhere(path: Path, chance: random.Random) -> None:
    """To a file of somebody else's, ``theirs`` in the working folder, or to where none is."""
    path.unlink()
    up = Path(*[".."] * (len(path.relative_to(_attempt(path)).parts) - 1))
    path.symlink_to(up / chance.choice(["theirs", "theirs", "not there", "theirs pipe"]))


def _attempt(path: Path) -> Path:
    """The working folder of the attempt that a file is in: the one that has ``theirs``."""
    return next(folder for folder in path.parents if (folder / "theirs").exists())


def exchanged(path: Path, chance: random.Random) -> None:
    """The contents of another file of the folder, of the same kind if there is one."""
    others = [other for other in path.parent.iterdir() if other.is_file() and not other.is_symlink() and other != path]
    same = [other for other in others if other.suffix == path.suffix]
    if same or others:
        path.write_bytes(chance.choice(same or others).read_bytes())


def deep(path: Path, chance: random.Random) -> None:
    path.write_text(
        chance.choice(["[" * 100_000, '{"a":' * 100_000, "9" * 100_000, '{"runs": [' + "{}," * 1000 + "{}]}", "[]"])
    )


KINDS: dict[Callable[[Path, random.Random], None], int] = {
    retyped: 4,
    bytes_changed: 4,
    digit_changed: 4,
    emptied: 1,
    zeroed: 1,
    gone: 2,
    exchanged: 2,
    pipe: 1,
    folder: 1,
    link_to_itself: 1,
    link_elsewhere: 2,
    deep: 1,
}
"""How a file is damaged → how often."""

CONTENTS: dict[Callable[[Path, random.Random], None], int] = {
    kind: often
    for kind, often in KINDS.items()
    if kind in (retyped, bytes_changed, digit_changed, emptied, zeroed, exchanged)
}
"""Those that leave a regular file with other contents."""


def damaged(path: Path, chance: random.Random, kinds: dict[Callable[[Path, random.Random], None], int]) -> str:
    """Damages a file in one of some ways; names it."""
    ways = {kind: often for kind, often in kinds.items() if kind is not retyped or path.suffix == ".json"}
    how = chance.choices(list(ways), list(ways.values()))[0]
    how(path, chance)
    return f"{path.name} {how.__name__}"
