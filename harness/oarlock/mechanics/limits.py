"""Limits on what an MJCF file may ask for, before MuJoCo reads it: it would take minutes or gigabytes, or wait.

A model comes from anybody. A file beyond one of these is refused by name; whoever means it builds the model in a
``model.py``, which is code and has no limits but its own.
"""

import html
import math
import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path

import mujoco

from oarlock.base.errors import InputError
from oarlock.base.files import read_bytes, reason
from oarlock.base.text import short_name
from oarlock.mechanics.nesting import Part, require_few_copies

FILE_BYTES = 2**26
"""Of an MJCF file, and of each that it includes."""

FILES = 1000
"""Files that are included."""

REPLICAS = 5000
"""Copies that <replicate> makes, nested ones multiplied. MuJoCo's time grows with their square: 3 s."""

POINTS = 20_000
"""Points of a <flexcomp>, and of a <composite>: some 10 s."""

CELLS = 2**26
"""Of a height field or a texture: 256 MiB."""

RESERVED = 10_000
"""What <size> may reserve: keyframes, numbers of the user."""

NAME_LENGTH = 1000
"""Characters of a name."""

EQUALITIES = 500
"""Of an MJCF file. The time of ``check`` and of ``new`` grows with their square: 40 s."""

NUMBERS = 2**24
"""Of a sensor or an actuator, and of all of a model: 128 MiB."""

ITERATIONS = 10_000
"""Of MuJoCo's solvers, a step: with a tolerance of 0 they make all of them."""

TIMESTEPS = 1e-9, 1e9
"""s. The shortest, which adds digits to a time of seconds, and the longest, whose powers are numbers still."""

_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_TAG = re.compile(rb"<(/?)([a-z]+)((?:\s+[\w:.-]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*)\s*(/?)>")
_ATTRIBUTE = re.compile(rb"([\w:.-]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_FOLDERS = ("assetdir", "meshdir", "texturedir")
_NUMBERS = {"user": ("dim",), "numeric": ("size",), "general": ("actdim",)}
"""Attributes by which an element asks for so many numbers."""
_RESERVING = re.compile("nkey|nuser")


def require_moderate(path: Path) -> None:
    """Checks an MJCF file and everything that it includes against the limits of this module.

    What is not well-formed is left to MuJoCo, which says more.

    Raises:
        InputError: a limit is passed, or a file that is named is no regular one.
    """
    base, parts, folders = path.parent, dict[Path, Part](), {path.parent}
    left = [path]
    while left:
        file = left.pop()
        if file in parts:
            continue
        part = parts[file] = Part()
        if len(parts) > FILES:
            raise InputError(f"{path}: includes more than {FILES} files, expected fewer")
        folders.add(file.parent)
        for tag, given in _elements(file):
            _require_sizes(path, tag, given)
            folders |= {base / given[name] for name in _FOLDERS if name in given}
            if tag == "attach":
                part.attached[given.get("model", "")] += 1
            for name, value in given.items():
                if name.startswith("file") and value and "\0" not in value:
                    found = [_one_name(place / value) for place in folders if _kind(place / value) is not None]
                    if any(not stat.S_ISREG(_kind(place) or 0) for place in found):
                        raise InputError(f"{path}: <{tag}> names '{value}', which is no regular file")
                    if tag == "include":
                        part.includes += found
                    elif tag == "model":
                        part.models += [(given.get("name", ""), place) for place in found]
                    left += found if tag in ("include", "model") else []
    require_few_copies(path, parts)


def _one_name(path: Path) -> Path:
    """A path without ``..``, which would give a file ever new names; links stay."""
    return Path(os.path.normpath(path))


def _kind(path: Path) -> int | None:
    try:
        return path.stat().st_mode
    except (OSError, ValueError):
        return None


def _elements(path: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """The elements of a file with their attributes; of a <replicate> the count of all copies that it is in."""
    try:
        text = _COMMENT.sub(b"", read_bytes(path, FILE_BYTES))
    except (OSError, ValueError) as error:
        raise InputError(f"'{path}' cannot be read: {reason(error) if isinstance(error, OSError) else error}") from None
    nested = [1.0]
    for closing, name, attributes, empty in _TAG.findall(text):
        tag = name.decode()
        given = {
            key.decode(): html.unescape((one or other).decode(errors="replace"))
            for key, one, other in _ATTRIBUTE.findall(attributes)
        }
        if tag == "replicate" and closing:
            nested = nested[:-1] or [1.0]
        elif tag == "replicate":
            together = nested[-1] * max(1.0, _product(given.get("count", "1")))
            given["count"] = repr(together)
            nested += [] if empty else [together]
        if not closing:
            yield tag, given


def _require_sizes(path: Path, tag: str, given: dict[str, str]) -> None:
    asked: list[tuple[str, float, int]] = []
    if tag == "replicate":
        asked.append(("count", _product(given["count"]), REPLICAS))
    elif tag in ("flexcomp", "composite"):
        asked.append(("count", _product(given.get("count", "1")), POINTS))
    elif tag in ("hfield", "texture"):
        pair = ("nrow", "ncol") if tag == "hfield" else ("width", "height")
        asked.append((" × ".join(pair), math.prod(_product(given.get(name, "1")) for name in pair), CELLS))
    elif tag in ("option", "size"):
        reserving = [name for name in given if name.endswith("iterations") or _RESERVING.match(name)]
        asked += [(n, _product(given[n]), ITERATIONS if n.endswith("iterations") else RESERVED) for n in reserving]
    asked += [(name, _product(given[name]), NUMBERS) for name in _NUMBERS.get(tag, ()) if name in given]
    for name, value, most in asked:
        if value > most:
            raise InputError(f"{path}: <{tag}> has {name} = {value:.15g}, expected {most} at most")
    for name in ("name", "class", "prefix", "model"):
        if len(given.get(name, "")) > NAME_LENGTH:
            said = f"{len(given[name])} characters, '{short_name(given[name])}'"
            raise InputError(f"{path}: <{tag}> has a {name} of {said}, expected {NAME_LENGTH} at most")


def require_timestep(timestep_s: float) -> None:
    """Checks a timestep (s) that is about to be used.

    Raises:
        InputError: it is not finite, not positive, or beyond ``TIMESTEPS``.
    """
    if not (math.isfinite(timestep_s) and timestep_s > 0):
        raise InputError(f"timestep of the model = {timestep_s:g} s, expected a finite number > 0")
    if not TIMESTEPS[0] <= timestep_s <= TIMESTEPS[1]:
        raise InputError(f"timestep = {timestep_s:g} s, expected one from {TIMESTEPS[0]:g} to {TIMESTEPS[1]:g} s")


def _product(numbers: str) -> float:
    """The product of the numbers of an attribute; 1 where they are none, of which MuJoCo complains."""
    try:
        return math.prod(float(number) for number in numbers.split())
    except (ValueError, OverflowError):
        return 1.0


def require_moderate_model(path: Path, model: mujoco.MjModel) -> None:
    """Checks what a model may also have from defaults or a script: iterations, numbers of a state, lengths of names.

    Raises:
        InputError: a limit is passed.
    """
    for name in ("iterations", "ls_iterations", "noslip_iterations", "ccd_iterations", "sdf_iterations"):
        if (value := getattr(model.opt, name, 0)) > ITERATIONS:
            raise InputError(f"{path}: option {name} = {value}, expected {ITERATIONS} at most")
    if model.neq > EQUALITIES and path.suffix == ".xml":
        raise InputError(
            f"{path}: {model.neq} equalities, expected {EQUALITIES} at most, or a model.py that builds them"
        )
    for name in ("nsensordata", "nuserdata", "na", "nhistory"):
        if (value := getattr(model, name, 0)) > NUMBERS:
            raise InputError(f"{path}: {name} = {value}, expected {NUMBERS} at most")
    longest = max(map(len, model.names.split(b"\0")), default=0)
    if longest > 4 * NAME_LENGTH:  # bytes
        raise InputError(f"{path}: a name of {longest} bytes, expected {NAME_LENGTH} characters at most")
