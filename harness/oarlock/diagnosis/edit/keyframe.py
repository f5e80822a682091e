"""A copy of an MJCF file with one keyframe more.

The author's text is kept, digit for digit, with includes pasted in: MuJoCo's own writer would round the keyframe to six
digits, and the loops would come out open again. Files that the model names stay where they are, and are named from the
new place. That the copy is the same model is checked: both are compiled, and every array must be equal bit for bit.
"""

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np

from oarlock.base.errors import InputError, one_line
from oarlock.base.files import replacing
from oarlock.diagnosis.edit.referrer import Referrer, folder_of
from oarlock.mechanics.load import load_model
from oarlock.mechanics.mjcf import differences
from oarlock.mechanics.names import element_name

KEYFRAME = "closed"
"""Name of the keyframe that is written."""

NORMALISED = 1e-15
"""MuJoCo normalises the quaternions of keyframes once more."""


def write_keyframe(
    source: Path, target: Path, qpos: np.ndarray, qvel: np.ndarray | None = None, ctrl: np.ndarray | None = None
) -> str:
    """Writes a copy of a model with a keyframe added.

    Args:
        source: MJCF file.
        target: the copy; what is there is replaced.
        qpos: of the keyframe (nq).
        qvel: (nv); None: at rest.
        ctrl: (nu); None: no control.

    Returns:
        The keyframe's name: ``KEYFRAME``, numbered where the model has one of that name.

    Raises:
        InputError: the source is no MJCF file or cannot be copied, the target is the source or cannot be written.
    """
    if source.suffix != ".xml":
        raise InputError(f"'{source}' is not an MJCF file (.xml), expected one to write a keyframe into")
    if target.resolve() == source.resolve():
        raise InputError(f"'{target}' is the model itself, expected another file to write the keyframe to")
    copier = Referrer(folder_of(target))
    original = load_model(source)
    taken = {element_name(original, mujoco.mjtObj.mjOBJ_KEY, key) for key in range(original.nkey)}
    names = (KEYFRAME if count == 1 else f"{KEYFRAME}{count}" for count in range(1, len(taken) + 2))
    name = next(name for name in names if name not in taken)
    root = copier.read(source, source.parent, prefix="")
    values = {"qpos": qpos, "qvel": qvel, "ctrl": ctrl}
    given = {key: value for key, value in values.items() if value is not None and np.any(value)}
    section = root.find("keyframe")
    if section is None:
        section = ET.SubElement(root, "keyframe")
        section.tail = "\n"
    key = ET.SubElement(section, "key", {"name": name})
    key.tail = "\n"
    for attribute, value in given.items():
        key.set(attribute, " ".join(map(repr, np.asarray(value, dtype=float).tolist())))
    text = copier.header + ET.tostring(root, encoding="unicode") + "\n"
    with replacing(target, named=True) as temporary:
        temporary.write_text(text, encoding="utf-8")
        _require_same(source, temporary, original, name, qpos)
    return name


def _require_same(source: Path, target: Path, original: mujoco.MjModel, name: str, qpos: np.ndarray) -> None:
    try:
        copy = load_model(target)
    except InputError as error:
        raise InputError(f"{source}: its copy with a keyframe does not load: {one_line(error)}") from None
    different = [field for field in differences(original, copy) if not field.startswith(("key_", "nkey"))]
    if different:
        raise InputError(f"{source}: its copy with a keyframe has another {different[0]}, expected the same model")
    key = mujoco.mj_name2id(copy, mujoco.mjtObj.mjOBJ_KEY, name)
    if np.abs(copy.key_qpos[key] - qpos).max(initial=0.0) > NORMALISED:
        raise InputError(f"{source}: its copy has another pose in keyframe '{name}', expected the one that was given")
