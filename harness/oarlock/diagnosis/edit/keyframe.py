"""A copy of an MJCF file with one keyframe more."""

from pathlib import Path

import mujoco
import numpy as np

from oarlock.diagnosis.edit.changes import Keyframe, free_name
from oarlock.diagnosis.edit.copy import write_changed
from oarlock.diagnosis.edit.place import require_place
from oarlock.mechanics.load import load_model
from oarlock.mechanics.names import element_name

KEYFRAME = "closed"
"""Name of the keyframe that is written."""


def write_keyframe(
    source: Path,
    target: Path,
    qpos: np.ndarray,
    qvel: np.ndarray | None = None,
    ctrl: np.ndarray | None = None,
    like: int | None = None,
) -> str:
    """Writes a copy of a model with a keyframe added.

    Args:
        source: MJCF file.
        target: the copy; what is there is replaced.
        qpos: of the keyframe (nq).
        qvel: (nv); None: at rest.
        ctrl: (nu); None: those of ``like``, or no control.
        like: number of the keyframe that the new one has all else of: time, activations, controls, mocap poses.

    Returns:
        The keyframe's name: ``KEYFRAME``, numbered where the model has one of that name.

    Raises:
        InputError: as ``write_changed``.
    """
    require_place(source, target)
    model = load_model(source)
    name = new_name(model)
    speed = np.zeros(model.nv) if qvel is None else qvel
    write_changed(source, target, [Keyframe(qpos, speed, name=name, like=like, ctrl=ctrl)])
    return name


def new_name(model: mujoco.MjModel) -> str:
    """A name for a keyframe that the model has none of."""
    return free_name(KEYFRAME, {element_name(model, mujoco.mjtObj.mjOBJ_KEY, key) for key in range(model.nkey)})


def source_key(model: mujoco.MjModel, wanted: str | None) -> int | None:
    """Number of the keyframe that a run starts from, given by its name or number, ``none``, or None for the first one.

    None where the run starts from none.
    """
    if wanted is None:
        return 0 if model.nkey else None
    if (index := mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, wanted)) >= 0:
        return index
    number = wanted.removeprefix("#")
    return int(number) if number.isdigit() else None
