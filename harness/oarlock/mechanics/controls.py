"""Controls as laws of time, by the names of actuators: a keyframe's, constant ones, random smooth ones, a log's."""

import re
from collections.abc import Mapping

import mujoco
import numpy as np

from oarlock.base.core import TimeLaw
from oarlock.base.errors import InputError, choose
from oarlock.cases.drive import Drive as CaseDrive
from oarlock.cases.motion import KINDS, NO_KEYFRAME, Kind
from oarlock.mechanics.drive import ACTIVE, Drive
from oarlock.mechanics.mocap import MOCAP, mocap_parts, require_part
from oarlock.mechanics.names import element_name

FREQUENCIES_HZ = (0.3, 3.0)
"""Between these the random sines lie: slow enough for a motor, fast enough to move within a second."""

SINES = 3
"""Sines of one random control."""

_ACTUATOR = mujoco.mjtObj.mjOBJ_ACTUATOR


OTHERS = (ACTIVE, MOCAP)
"""How names of laws begin that are no actuators'."""


class Laws(dict[str, str]):
    """Actuator → its law, as a document shows it.

    Attributes:
        logs: actuator → the law of a log, which no text holds; its text says where it comes from.
        held: whether a control is held over a step, as the loop of a program does that sets it before ``mj_step``;
            else it follows its law at every stage of the integrator.
        what: what a message calls an actuator that is unknown.
    """

    def __init__(
        self,
        written: Mapping[str, str],
        *,
        logs: Mapping[str, TimeLaw] | None = None,
        held: bool = False,
        what: str = "actuator",
    ):
        super().__init__(written)
        self.logs, self.held, self.what = dict(logs or {}), held, what

    @property
    def constant(self) -> bool:
        """Whether no control changes."""
        return all(law.is_constant for law in self.parsed().values())

    def parsed(self) -> dict[str, TimeLaw]:
        """Actuator → its law.

        Raises:
            InputError: a law does not parse.
        """
        return {name: self.logs[name] if name in self.logs else TimeLaw(law) for name, law in self.items()}


def laws(
    model: mujoco.MjModel,
    kind: Kind,
    key: str | int | None = None,
    seed: int = 0,
    values: Mapping[str, float | str] | None = None,
) -> Laws:
    """Actuator → law of time for its control, held over a step; actuators that are not named here stay at 0.

    An actuator without a name goes by its number, ``#3``. Laws of ``OTHERS`` may be among ``values``.

    Args:
        model: whose actuators they are.
        kind: ``keyframe``: the controls of a keyframe; ``constant``: 0; ``random``: for every actuator the sum of
            ``SINES`` sines that stays within its ctrlrange, or within ±1 where it has none.
        key: name or number of the keyframe; the first one if it is left out.
        seed: of the random controls.
        values: actuator → control, a number or a law of time, in place of what ``kind`` says.

    Raises:
        InputError: unknown kind, keyframe or actuator, a keyframe where there is none, or a value that is not finite.
    """
    choose("kind of controls", kind, KINDS)
    given: dict[str, str] = {}
    if kind == "random":
        given = _random(model, seed)
    elif kind == "keyframe":
        number = keyframe(model, key)
        if number is None:
            raise InputError("the model has no keyframe to start from, expected one for controls of kind 'keyframe'")
        given = dict(zip(actuators(model), map(repr, model.key_ctrl[number].tolist()), strict=True))
    for name, value in (values or {}).items():
        if name.startswith(MOCAP) and name not in actuators(model):
            require_part(model, name)
        elif not name.startswith(ACTIVE):
            choose("actuator", name, actuators(model))
        if not isinstance(value, str) and not np.isfinite(value):
            raise InputError(f"control of actuator '{name}' = {value}, expected a finite number")
        given[name] = value if isinstance(value, str) else repr(float(value))
    zero = {name for name, law in given.items() if law in ("0.0", "-0.0") and not name.startswith(OTHERS)}
    return Laws({name: law for name, law in given.items() if name not in zero}, held=True)


def written_out(given: CaseDrive, what: str = "actuator") -> Laws:
    """The laws of a case's drive with the constants written out; ``what`` as of ``Laws``."""
    values = given.values()

    def written(name: re.Match[str]) -> str:
        return f"({values[name[0]]!r})" if name[0] in values else name[0]

    out = {name: re.sub(r"\b[A-Za-z_]\w*", written, law) for name, law in given.sources().items()}
    return Laws(out, held=given.held, what=what)


def switches(model: mujoco.MjModel) -> list[str]:
    """What laws that switch equalities go by: their names, or ``#3``, after ``ACTIVE``."""
    names = [element_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, index) for index in range(model.neq)]
    return [ACTIVE + name for name in names]


def columns(model: mujoco.MjModel) -> list[str]:
    """What the columns of a log may be called, besides the time."""
    return [*actuators(model), *switches(model), *mocap_parts(model)]


def place_mocaps(model: mujoco.MjModel, laws: Laws) -> None:
    """Moves the mocap bodies of a model to where its laws have them at the start, for every data that is made of it.

    Raises:
        InputError: a mocap body or a part of its pose that there is not, or a law that has no finite value there.
    """
    for law in drive(model, laws).mocaps if moves_mocaps(laws) else ():
        model.body_pos[law.body], quaternion = law.at(0.0)
        model.body_quat[law.body] = quaternion / np.linalg.norm(quaternion)


def moves_mocaps(laws: Mapping[str, str]) -> bool:
    """Whether one of the laws is that of a mocap body's pose."""
    return any(name.startswith(MOCAP) for name in laws)


def actuators(model: mujoco.MjModel) -> list[str]:
    """Names of the actuators, by number; ``#3`` for one without a name."""
    return [element_name(model, _ACTUATOR, index) for index in range(model.nu)]


def keyframe(model: mujoco.MjModel, key: str | int | None) -> int | None:
    """Number of a keyframe, given by name or number; the first one for None, none for ``none`` or where there is none.

    Raises:
        InputError: there is not this one.
    """
    names = [element_name(model, mujoco.mjtObj.mjOBJ_KEY, index) for index in range(model.nkey)]
    if key is None:
        return 0 if names else None
    if isinstance(key, str) and key in names:
        return names.index(key)
    if key == NO_KEYFRAME:
        return None
    if isinstance(key, str) and not key.isdecimal():
        return names.index(choose("keyframe", key, [*names, NO_KEYFRAME]))
    if not 0 <= int(key) < model.nkey:
        expected = f"a number from 0 to {model.nkey - 1}" if model.nkey else f"{NO_KEYFRAME}, for there are none"
        raise InputError(f"keyframe {key}, expected {expected}")
    return int(key)


def drive(model: mujoco.MjModel, by_name: Mapping[str, str], parts: int = 1) -> Drive:
    """The drive of such laws.

    Args:
        model: of the run.
        by_name: the laws; of a plain mapping they are not held.
        parts: into how many of its timesteps a whole step is cut: over it controls are held.

    Raises:
        InputError: an actuator that the model does not have, or a law that does not parse.
    """
    given = by_name if isinstance(by_name, Laws) else Laws(by_name)
    return Drive.of(model, given.parsed(), parts * float(model.opt.timestep), given.held, given.what, given.logs)


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
