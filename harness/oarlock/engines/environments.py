"""Environments of engines: a folder in the user's cache each, or an interpreter that the user names.

Nothing is ever installed beside the user's own packages. A folder's name holds the digest of what is in it, and it is
moved to its place once it is complete, so that one that is there can be used.
"""

import importlib.metadata
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from oarlock.base.errors import InputError, one_line
from oarlock.base.hashing import of_document
from oarlock.base.scratch import scratch
from oarlock.engines.registry import Engine, split_requirement

_ANSWER_S = 60.0
"""Time that an interpreter has to say what it is, s."""

_TAIL = 300
"""Characters of what an installer said that are shown."""


@dataclass(frozen=True)
class Environment:
    """What runs a program.

    Attributes:
        python: the interpreter.
        first: folders that come first on its ``sys.path``.
        identity: changes with whatever it holds, as far as can be told without running it.
    """

    python: str
    first: tuple[str, ...]
    identity: str


def cache() -> Path:
    """The folder of all environments, in the user's cache."""
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "oarlock" / "engines"


def place(engine: Engine) -> Path:
    """The folder of an engine's environment, there or not."""
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    digest = of_document([sorted(engine.requirements), version, engine.program.beside])
    called = engine.program.name + (f"-{engine.version}" if engine.version else "")
    own = cache() / f"{called}-{digest}"
    # Programs of one engine share what holds the same.
    others = [] if own.is_dir() else sorted(cache().glob(f"*-{digest}"))
    return others[0] if others else own


def find(engine: Engine) -> Environment | None:
    """The environment of an engine; None if there is none yet.

    The interpreter that the user names; else the folder in the cache; else, where no version is asked for, this very
    interpreter if it holds all that the program requires.

    Raises:
        InputError: the user names no interpreter that can be run.
    """
    if engine.python:
        return _given(engine)
    folder = place(engine)
    if folder.is_dir():
        if engine.program.beside:
            return Environment(sys.executable, (str(folder),), folder.name)
        return Environment(str(_python(folder)), (), folder.name)
    if not engine.version and all(map(_holds, engine.requirements)):
        held = sorted(f"{name} {importlib.metadata.version(name)}" for name in map(_package, engine.requirements))
        return Environment(sys.executable, (), of_document([sys.version, held]))
    return None


def _given(engine: Engine) -> Environment:
    path = shutil.which(engine.python) or engine.python
    asked, why = [path, "-c", "import sys; print(sys.version_info[:3])"], ""
    try:
        done = subprocess.run(asked, capture_output=True, text=True, timeout=_ANSWER_S, check=False)
        if done.returncode:
            why = f"it ends with status {done.returncode}"
        elif not done.stdout:
            why = "it prints nothing"
        # What is installed changes the folders of packages.
        folders = sorted(Path(path).parent.parent.glob("lib*/python*/site-packages"))
        stamps = [folder.stat().st_mtime_ns for folder in folders]
    except (OSError, ValueError) as error:
        raise _no_python(engine, one_line(error)[:80]) from None
    except subprocess.TimeoutExpired:
        raise _no_python(engine, f"it does not answer in {_ANSWER_S:g} s") from None
    if why:
        raise _no_python(engine, why)
    return Environment(path, (), of_document([path, done.stdout.strip(), stamps]))


def _no_python(engine: Engine, why: str) -> InputError:
    return InputError(f"engine '{engine.asked}': '{engine.python}' is no Python that runs ({why})")


def _package(requirement: str) -> str:
    return split_requirement(requirement)[0]


def _holds(requirement: str) -> bool:
    """Whether this interpreter holds a requirement, as far as comparisons of its numbers tell."""
    package, _, versions = split_requirement(requirement)
    try:
        held = _numbers(importlib.metadata.version(package))
    except importlib.metadata.PackageNotFoundError:
        return False
    for clause in filter(None, versions.split(",")):
        found = re.fullmatch(r"\s*(>=|<=|==|!=|~=|>|<)\s*([0-9][\w.]*?)(\.\*)?\s*", clause)
        if found is None:
            return False
        wanted = _numbers(found[2])
        cut = held[: len(wanted)] if found[3] else held
        length = max(len(cut), len(wanted))
        own, other = (numbers + (0,) * (length - len(numbers)) for numbers in (cut, wanted))
        holds = {
            ">=": own >= other,
            "<=": own <= other,
            ">": own > other,
            "<": own < other,
            "==": own == other,
            "!=": own != other,
            "~=": own >= other and held[: len(wanted) - 1] == wanted[:-1],
        }
        if not holds[found[1]]:
            return False
    return True


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version.partition("+")[0])[:4])


def _python(folder: Path) -> Path:
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def _uv() -> str | None:
    beside = Path(sys.executable).with_name("uv")
    return shutil.which("uv") or (str(beside) if beside.exists() else None)


def commands(engine: Engine, folder: Path) -> list[list[str]]:
    """The commands that make an environment in a folder: by uv where there is one, else by venv and pip."""
    uv, python = _uv(), str(_python(folder))
    if engine.program.beside:
        installer = (
            [uv, "pip", "install", "--python", sys.executable] if uv else [sys.executable, "-m", "pip", "install"]
        )
        return [[*installer, "--quiet", "--target", str(folder), *engine.requirements]]
    if uv:
        make = [uv, "venv", "--quiet", "--python", sys.executable, str(folder)]
        return [make, [uv, "pip", "install", "--quiet", "--python", python, *engine.requirements]]
    make = [sys.executable, "-m", "venv", str(folder)]
    return [make, [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *engine.requirements]]


def make(engine: Engine, say: Callable[[str], None] = lambda text: None) -> Environment:
    """Makes the environment of an engine, unless there is one.

    Args:
        engine: the engine.
        say: is told, in one line, what is installed where.

    Raises:
        InputError: it cannot be made.
    """
    if there := find(engine):
        return there
    folder = place(engine)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = scratch(f".{folder.name}", folder.parent)
    except OSError as error:
        raise InputError(f"cannot make '{folder}': {error.strerror or error}") from None
    say(f"installing {', '.join(engine.requirements)} for engine '{engine.name}' into '{folder}'")
    try:
        for command in commands(engine, temporary):
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                said = one_line(done.stderr.strip() or done.stdout.strip())[-_TAIL:]
                raise InputError(f"engine '{engine.name}' cannot be installed: {said}")
        try:
            os.replace(temporary, folder)
        except OSError:
            if not folder.is_dir():  # else somebody else was faster
                raise
    except OSError as error:
        raise InputError(f"cannot make '{folder}': {error.strerror or error}") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    found = find(engine)
    assert found is not None
    return found


def how_to(engine: Engine) -> str:
    """What to do for an engine that is not there, in one line: the option, and a command line to copy."""
    lines = " && ".join(shlex.join(command) for command in commands(engine, place(engine)))
    return f"'oarlock conform … --install' makes an environment of its own in '{cache()}'; by hand: {lines}"
