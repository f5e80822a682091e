"""Controllers that a program holds: what one commands along MuJoCo's own run, as a log of controls."""

import copy
from collections.abc import Callable

import mujoco
import numpy as np

from oarlock.base.core import TimeLaw
from oarlock.base.errors import InputError, one_line
from oarlock.mechanics.controls import Laws, actuators

Controller = Callable[[mujoco.MjModel, mujoco.MjData], None]
"""Writes ``data.ctrl`` before every step, and nothing else."""


def commanded(
    model: mujoco.MjModel, start: tuple[np.ndarray, np.ndarray, np.ndarray], controller: Controller, steps: int
) -> tuple[Laws, str]:
    """Lets a controller drive MuJoCo and takes down what it commands, each value held until the next.

    Its feedback is that of this run: whoever is compared with MuJoCo is given the same controls.

    Args:
        model: left alone.
        start: positions (nq), velocities (nv) and activations (na).
        controller: is given a model and a data of its own, which it may read as it likes.
        steps: how many; fewer where the run diverges.

    Returns:
        The controls, and what they are in words.

    Raises:
        InputError: the controller raises, or commands a number that is not finite; the model has no actuator.
    """
    called = getattr(controller, "__qualname__", type(controller).__name__)
    if model.nu == 0:
        raise InputError(f"control = {called}, expected none: the model has no actuators")
    own, data = copy.copy(model), mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.act[:] = start
    times, taken = np.zeros(steps), np.zeros((steps, model.nu))
    count = 0
    for step in range(steps):
        _ask(controller, called, own, data)
        times[step], taken[step] = data.time, data.ctrl
        count = step + 1
        mujoco.mj_step(own, data)
        if not np.isfinite(data.qpos).all() or data.time <= times[step]:  # MuJoCo starts anew where it diverged
            break
    sampled = {
        name: TimeLaw.sampled(name, times[:count], taken[:count, index])
        for index, name in enumerate(actuators(model))
        if taken[:count, index].any()
    }
    said = f"controls of {called}, along MuJoCo's own run"
    return Laws(dict.fromkeys(sampled, said), logs=sampled, held=True), said


_READ = ("time", "qpos", "qvel", "act", "qfrc_applied", "xfrc_applied", "mocap_pos", "mocap_quat", "eq_active")
"""What a controller may read of a data, but not write."""


def _ask(controller: Controller, called: str, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    before = {name: np.array(getattr(data, name)) for name in _READ}
    try:
        answer = controller(model, data)
    except Exception as error:
        raise InputError(
            f"control = {called} raises {type(error).__name__} at t = {data.time:.6g} s: {one_line(error)}"
        ) from error
    if answer is not None:
        raise InputError(f"control = {called} gives back {type(answer).__name__}, expected it to write data.ctrl")
    for name, values in before.items():
        if not np.array_equal(getattr(data, name), values):
            raise InputError(
                f"control = {called} writes data.{name} at t = {before['time']:.6g} s, expected data.ctrl alone: "
                "others are given the same controls, and nothing else"
            )
    if not np.isfinite(data.ctrl).all():
        worst = int(np.flatnonzero(~np.isfinite(data.ctrl))[0])
        raise InputError(
            f"control = {called} gives {data.ctrl[worst]} for actuator '{actuators(model)[worst]}' at t = "
            f"{data.time:.6g} s, expected a finite number"
        )
