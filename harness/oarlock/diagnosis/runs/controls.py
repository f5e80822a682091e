"""The user's own controls of a run, as laws of time: a keyframe's, constant ones, or random smooth ones."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import get_args

import mujoco
import numpy as np

from oarlock.base.errors import InputError, choose
from oarlock.cases import case_file
from oarlock.cases.case import Case
from oarlock.cases.case_file import CaseFile
from oarlock.diagnosis.options import Controls
from oarlock.mechanics.drive import Drive
from oarlock.mechanics.names import element_name

KINDS: list[Controls] = list(get_args(Controls))

FREQUENCIES_HZ = (0.3, 3.0)
"""Between these the random sines lie: slow enough for a motor, fast enough to move within a second."""

SINES = 3
"""Sines of one random control."""

_ACTUATOR = mujoco.mjtObj.mjOBJ_ACTUATOR


def laws(
    model: mujoco.MjModel,
    kind: Controls,
    key: str | int | None = None,
    seed: int = 0,
    values: Mapping[str, float] | None = None,
) -> dict[str, str]:
    """Actuator → law of time for its control; actuators that are not named here stay at 0.

    An actuator without a name goes by its number, ``#3``.

    Args:
        model: whose actuators they are.
        kind: ``keyframe``: the controls of a keyframe; ``constant``: ``values``; ``random``: for every actuator the sum
            of ``SINES`` sines that stays within its ctrlrange, or within ±1 where it has none.
        key: name or number of the keyframe; the first one if it is left out.
        seed: of the random controls.
        values: actuator → constant control.

    Raises:
        InputError: unknown kind, keyframe or actuator, a keyframe where there is none, or a value that is not finite.
    """
    choose("kind of controls", kind, KINDS)
    if kind == "random":
        return _random(model, seed)
    if kind == "keyframe":
        names = actuators(model)
        given = dict(zip(names, model.key_ctrl[keyframe(model, key)].tolist(), strict=True))
    else:
        given = dict(values or {})
    for name, value in given.items():
        choose("actuator", name, actuators(model))
        if not np.isfinite(value):
            raise InputError(f"control of actuator '{name}' = {value}, expected a finite number")
    return {name: repr(float(value)) for name, value in given.items() if value}


def written_out(given: case_file.Drive) -> dict[str, str]:
    """The laws of a case's drive with the constants written out."""
    values = given.values()

    def written(name: re.Match[str]) -> str:
        return f"({values[name[0]]!r})" if name[0] in values else name[0]

    return {actuator: re.sub(r"\b[A-Za-z_]\w*", written, law) for actuator, law in given.ctrl.items()}


def actuators(model: mujoco.MjModel) -> list[str]:
    """Names of the actuators, by number; ``#3`` for one without a name."""
    return [element_name(model, _ACTUATOR, index) for index in range(model.nu)]


def keyframe(model: mujoco.MjModel, key: str | int | None) -> int:
    """Number of a keyframe, given by name or number; the first one for None.

    Raises:
        InputError: there is none, or not this one.
    """
    if model.nkey == 0:
        raise InputError("the model has no keyframe, expected one for controls of kind 'keyframe'")
    names = [element_name(model, mujoco.mjtObj.mjOBJ_KEY, index) for index in range(model.nkey)]
    if isinstance(key, str):
        return names.index(choose("keyframe", key, names))
    if key is not None and not 0 <= key < model.nkey:
        raise InputError(f"keyframe {key}, expected a number from 0 to {model.nkey - 1}")
    return key or 0


def drive(model: mujoco.MjModel, by_name: Mapping[str, str]) -> Drive:
    """The drive of such laws.

    Raises:
        InputError: an actuator that the model does not have, or a law that does not parse.
    """
    file = CaseFile(title="check", drive=case_file.Drive(ctrl=dict(by_name)))
    return Drive(model, Case("check", Path(), file))


def _random(model: mujoco.MjModel, seed: int) -> dict[str, str]:
    generator = np.random.default_rng(seed)
    low_rate, high_rate = (float(np.log(frequency)) for frequency in FREQUENCIES_HZ)
    found = {}
    for index, name in enumerate(actuators(model)):
        low, high = model.actuator_ctrlrange[index] if model.actuator_ctrllimited[index] else (-1.0, 1.0)
        shares = generator.dirichlet(np.ones(SINES))
        rates = 2.0 * np.pi * np.exp(generator.uniform(low_rate, high_rate, SINES))
        phases = generator.uniform(0.0, 2.0 * np.pi, SINES)
        sines = " + ".join(
            f"{share:.6f}*sin({rate:.6f}*t + {phase:.6f})"
            for share, rate, phase in zip(shares, rates, phases, strict=True)
        )
        middle, half = 0.5 * (float(low) + float(high)), 0.5 * (float(high) - float(low))
        # Shares are rounded to six digits: together they may exceed 1 in the last one.
        found[name] = f"{middle!r} + {half * (1.0 - SINES * 1e-6)!r}*({sines})"
    return found
