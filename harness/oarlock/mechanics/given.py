"""Models that a program holds, as files for those who take files: compiled ones, specifications, and MJCF as text."""

import atexit
import copy
import re
import shutil
from functools import cache
from pathlib import Path

import mujoco

from oarlock.base.errors import InputError
from oarlock.base.scratch import scratch
from oarlock.mechanics.refusal import refusal

Model = str | Path | mujoco.MjModel | mujoco.MjSpec
"""A name, a path, MJCF as text, a compiled model, or a specification of one."""

TEXT = "the MJCF that was given"

COMPILED = ".mjb"
"""Ending of what stands for a compiled model."""

_compiled: dict[Path, mujoco.MjModel] = {}

_given: dict[Path, str] = {}
"""A file that stands for a model → what was given."""


def path_of(model: Model) -> str | Path:
    """Gives the path of a file that stands for a model until the process ends; a name or a path is left as it is.

    A compiled model and a specification are copied as they are now, and cannot be edited as MJCF. Files that MJCF as
    text names are looked for from the working folder.

    Raises:
        InputError: it is none of these, or MuJoCo refuses it.
    """
    if isinstance(model, Path):
        return model
    if isinstance(model, str):
        return _of_text(model) if model.lstrip().startswith("<") else model
    try:
        compiled = model.copy().compile() if isinstance(model, mujoco.MjSpec) else copy.copy(model)
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise InputError(f"the MjSpec: {refusal(error)}") from None
    if not isinstance(compiled, mujoco.MjModel):
        raise InputError(f"model is a {type(model).__name__}, expected a name, a path, MJCF, an MjModel or an MjSpec")
    path = _place(compiled.names.partition(b"\0")[0].decode(errors="replace"), COMPILED)
    _given[path] = f"the {type(model).__name__}"
    mujoco.mj_saveModel(compiled, str(path), None)
    _compiled[path] = compiled
    return path


def as_given(text: str) -> str:
    """A message with what was given in place of the files that stand for it."""
    for path, what in _given.items():
        text = text.replace(f"'{path}'", what).replace(str(path), what)
    return text


def compiled_at(path: Path) -> mujoco.MjModel:
    """Gives a copy of the compiled model that a file stands for.

    Raises:
        InputError: it stands for none: MuJoCo believes every number of such a file, so that nobody else's is read.
    """
    if path not in _compiled:
        raise InputError(f"'{path}' is a compiled model, expected the MJCF that it was made of")
    return copy.copy(_compiled[path])


def _of_text(text: str) -> Path:
    try:
        spec = mujoco.MjSpec.from_string(text)
    except ValueError as error:
        raise InputError(f"{TEXT}: {refusal(error)}") from None
    path = _place(spec.modelname, ".xml")
    _given[path] = TEXT
    path.write_text(text, encoding="utf-8")
    return path


_UNNAMED = ("", "MuJoCo Model")


def _place(name: str, ending: str) -> Path:
    """A file of its own, named after the model."""
    name = "model" if name in _UNNAMED else name
    folder = _folder() / str(sum(1 for _ in _folder().iterdir()))
    folder.mkdir()
    return folder / f"{re.sub(r'[^A-Za-z0-9_-]+', '-', name).strip('-')[:60] or 'model'}{ending}"


@cache
def _folder() -> Path:
    folder = scratch()
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
