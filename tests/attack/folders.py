"""Damaged folders of results, and kept files of a finished suite that were garbled or retyped.

Of the first a command must say what is wrong, or show what is whole. A suite that is resumed in the second must leave
what an undisturbed one leaves, or name what it cannot do again: nothing damaged is believed.

    cd tests && ../.venv/bin/python -m attack --only folders,kept
"""

import os
import pickle
import random
import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from mechanisms import four_bar, write_model
from suites import TINY

from attack import endings
from attack.damage import CONTENTS, KINDS, damaged
from attack.trials import Attempt, command, forked

SUITE = ("suite", "a", "--out", "out", "--jobs", "1")
MADE = {
    "one": ("run", "a", "--out", "one", "--report", "one-report"),
    "suite": ("suite", "a", "b", "--out", "suite"),
    "sweep": ("suite", "a", "--out", "sweep", "--sweep", "seed=1:2:2"),
}
"""Folder of results → the command that makes it."""


def attempts(seed: int, folder: Path, count: int = 300) -> Iterator[Attempt]:
    """Commands that read damaged folders of results, and such that go on in them."""
    kept = _models(folder / "kept")
    for arguments in MADE.values():
        forked(partial(_made, arguments, kept), folder)
    for number in range(count):
        chance = random.Random(f"folders-{seed}-{number}")
        which = chance.choice([name for name in MADE if name != "sweep" or chance.random() < 0.5])
        damage: list[str] = []
        arguments = _command(which, chance)
        given = ("page", "out", *(("bad",) if arguments[0] in ("run", "suite") else ()))
        prepare = partial(_write, kept, which, f"folders-{seed}-{number}", damage)
        yield Attempt(f"folders {seed}-{number} ({which})", arguments, prepare, given)


def _command(which: str, chance: random.Random) -> tuple[str, ...]:
    inner = {"one": "bad", "suite": "bad/a", "sweep": "bad/a/sweep-seed"}[which]
    reading = [
        ("diff", which, "bad"),
        ("diff", "bad", which, "--report", "page"),
        ("diff", "bad", "bad", "--json", "-"),
        ("report", inner, "--to", "page"),
        ("report", inner, "--to", "page"),
    ]
    going_on = {
        "one": [("run", "a", "--out", "bad"), ("run", "a", "--out", "bad", "--replace", "--report", "page")],
        "suite": [("suite", "a", "b", "--out", "bad"), ("suite", "a", "--out", "bad", "--report", "page")],
        "sweep": [("suite", "a", "--out", "bad", "--sweep", "seed=1:2:2")],
    }[which]
    return chance.choice(reading if chance.random() < 0.6 else going_on)


def _write(kept: Path, which: str, seed: str, damage: list[str], folder: Path) -> None:
    shutil.copytree(kept, folder, dirs_exist_ok=True, symlinks=True)
    shutil.copytree(kept / which, folder / "bad")
    (folder / "theirs").write_text("somebody else's")
    os.mkfifo(folder / "theirs pipe")
    chance = random.Random(f"{seed} damage")
    for _ in range(chance.choice([1, 1, 2, 5])):
        files = sorted(path for path in (folder / "bad").rglob("*") if path.is_file() and not path.is_symlink())
        if files:
            damage.append(damaged(chance.choice(files), chance, KINDS))


def kept_files(seed: int, folder: Path, count: int = 400) -> Iterator[Attempt]:
    """Finished suites in which one file, or up to three, have other contents; resumed, and compared."""
    kept = _models(folder / "kept")
    expected = folder / "expected"
    expected.write_bytes(pickle.dumps(forked(partial(_suite, kept), folder)))
    names = sorted(str(path.relative_to(kept)) for path in (kept / "out").rglob("*") if path.is_file())
    for number in range(count):
        seeds = f"kept-{seed}-{number}"
        chance = random.Random(seeds)
        # Results first: pages are made of them.
        chosen = [
            chance.choice([n for n in names if "/report/" not in n or chance.random() < 0.2])
            for _ in range(chance.choice([1, 1, 1, 3]))
        ]
        prepare = partial(_garble, kept, chosen, seeds)
        after = partial(_believed, expected)
        yield Attempt(f"kept {seed}-{number} ({', '.join(chosen)})", SUITE, prepare, after=after)


def _garble(kept: Path, names: list[str], seed: str, folder: Path) -> None:
    shutil.copytree(kept, folder, dirs_exist_ok=True)
    chance = random.Random(f"{seed} damage")
    for name in names:
        path = folder / name
        before = path.read_bytes()
        damaged(path, chance, CONTENTS)
        while path.read_bytes() == before:
            damaged(path, chance, CONTENTS)


def _believed(expected: Path, status: int) -> str:
    """What a resumed suite left that an undisturbed one would not; in the folder where it ran."""
    if status == 2:
        return ""  # it was named
    wanted: dict[str, Any] = pickle.loads(expected.read_bytes())
    try:
        found = endings.contents(Path("out"))
    except Exception as error:
        return f"status {status}, and what is kept cannot be read: {type(error).__name__}: {error}"
    if found.keys() != wanted.keys():
        return f"status {status}, other files: {sorted(found.keys() ^ wanted.keys())}"
    different = [name for name in wanted if found[name] != wanted[name]]
    return f"status {status}, believed: {different}" if different else ""


def _models(folder: Path) -> Path:
    for name in ("a", "b"):
        write_model(folder / name, four_bar(), TINY)
    Path(f"{folder}.tmp").mkdir()
    return folder


def _suite(kept: Path) -> dict[str, Any]:
    _made(SUITE, kept)
    return endings.contents(kept / "out")


def _made(arguments: tuple[str, ...], kept: Path) -> None:
    if status := command(arguments, kept):
        raise RuntimeError(f"{arguments} ends with {status}: {Path(f'{kept}.err').read_text()}")
