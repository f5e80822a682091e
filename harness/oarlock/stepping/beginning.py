"""Where a run begins and what drives it: one rule for every command.

A case says both. Of a file without a case:

- start: the keyframe that was asked for, else the first one, with its positions, velocities, activations and the poses
  of its mocap bodies; where there is none, and for ``none``, the model's own pose, at rest. The time begins at 0.
- controls: what was asked for; else those of the keyframe, also where they are zero; without one a random smooth
  control of every actuator, of seed 0. They are set before a step and held over it, as the loop of a program does.
- integrator: the model's own, or ``SUBSTITUTE`` where exact runs cannot take that.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from oarlock.base.errors import InputError, choose
from oarlock.cases.case import Case
from oarlock.cases.integrators import SUBSTITUTE, IntegratorName
from oarlock.cases.motion import KINDS, NO_KEYFRAME, RULE, Kind, Motion
from oarlock.mechanics import controls
from oarlock.mechanics.control_log import ControlLog
from oarlock.mechanics.controller import commanded
from oarlock.mechanics.controls import Laws
from oarlock.mechanics.names import element_name
from oarlock.mechanics.prepare import integrator_of

KEYFRAME = "start"
"""Name of the keyframe that a case begins from, if it names none and the model has it."""

MOVED = "mocap bodies move, which is stepped in Python and conserves no energy"
"""What a run says then."""

UNIT = 1e-3
"""Largest deviation of a quaternion's norm from 1, as one of three digits has; more is a mistake, not rounding."""


@dataclass(frozen=True)
class Beginning:
    """A start as it was given, not yet closed, and the controls.

    Attributes:
        qpos: positions (nq); qvel: velocities (nv); act: activations (na).
        key: number of the keyframe that it starts from; None of one that starts from none.
        begins: where the start comes from, in words.
        laws: the controls.
        driven: the same in words.
    """

    qpos: np.ndarray
    qvel: np.ndarray
    act: np.ndarray
    key: int | None
    begins: str
    laws: Laws
    driven: str

    def __str__(self) -> str:
        moved = f"; {MOVED}" if controls.moves_mocaps(self.laws) else ""
        return f"from {self.begins}; {self.driven}{moved}"


def beginning_of_file(model: mujoco.MjModel, asked: Motion = RULE) -> Beginning:
    """Where a file begins. Mocap bodies of the model are moved to where the keyframe, or their laws, have them.

    Raises:
        InputError: an unknown keyframe or actuator, or a log that is not as expected.
    """
    key = controls.keyframe(model, asked.keyframe)
    begins = "the model's own pose, at rest" if key is None else f"keyframe '{_key_name(model, key)}'"
    return _from_key(model, key, begins, *driven_by(model, asked, key))


def beginning_of_case(model: mujoco.MjModel, case: Case, asked: Motion = RULE) -> Beginning:
    """Where a case begins; of a file that has none, see ``beginning_of_file``.

    Raises:
        InputError: as there; a joint or keyframe that ``[start]`` names is unknown, a value has the wrong size, or a
            keyframe is asked for where the case says how to start.
    """
    if case.bare:
        return beginning_of_file(model, asked)
    if asked.keyframe is not None:
        raise InputError(
            f"case '{case.name}' says where it starts, expected no keyframe ('{asked.keyframe}'), or the file alone"
        )
    start = case.file.start
    keys = [_key_name(model, index) for index in range(model.nkey)]
    key = keys.index(KEYFRAME) if KEYFRAME in keys else None
    if start.keyframe is not None and not (start.keyframe == NO_KEYFRAME and NO_KEYFRAME not in keys):
        key = keys.index(choose(f"keyframe in [start] of case '{case.name}'", start.keyframe, [*keys, NO_KEYFRAME]))
    elif start.keyframe is not None:
        key = None
    if asked.drives:
        laws, driven = driven_by(model, asked, key)
    else:
        laws = controls.written_out(case.file.drive, f"actuator in [drive] of case '{case.name}'")
        driven = "the case's own drive" if laws else "no drive" if model.nu else "no actuators"
    found = _from_key(model, key, f"the start of case '{case.name}'", laws, driven)
    _write_named(model, found.qpos, start.qpos, "qpos", case)
    _write_named(model, found.qvel, start.qvel, "qvel", case)
    return found


def along_run(model: mujoco.MjModel, begins: Beginning, asked: Motion, steps: int) -> Beginning:
    """A beginning with what a controller commands in so many steps of MuJoCo's own run from it, if there is one.

    Raises:
        InputError: as ``mechanics.controller.commanded``.
    """
    if asked.controller is None:
        return begins
    laws, driven = commanded(model, (begins.qpos, begins.qvel, begins.act), asked.controller, steps)
    return replace(begins, laws=laws, driven=driven)


def own_integrator(model: mujoco.MjModel) -> tuple[IntegratorName, str]:
    """The integrator of a file's runs, and why it is not the model's own; empty if it is."""
    own = integrator_of(model)
    if not own.runs:
        return SUBSTITUTE.name, f"{SUBSTITUTE} in place of {own}"
    if model.na and not own.takes_activations:
        return SUBSTITUTE.name, f"{SUBSTITUTE} in place of {own}, for the model has {model.na} actuator activation(s)"
    return own.name, ""


def driven_by(model: mujoco.MjModel, asked: Motion, key: int | None) -> tuple[Laws, str]:
    """The controls that are asked for, or those of the rule, as laws and in words.

    Args:
        model: whose actuators they are.
        asked: what is asked for. Actuators that neither a log nor ``control`` names keep the keyframe's controls, or 0.
        key: the keyframe of the start, if there is one.

    Raises:
        InputError: an unknown actuator, no keyframe to take controls from, or a log that is not as expected.
    """
    if model.nu == 0 and not asked.drives:
        return Laws({}), "no actuators"
    named = bool(asked.named) or asked.log is not None
    kind: Kind = "keyframe" if key is not None else "constant" if named else "random"
    for known in KINDS:
        kind = known if known == asked.controls else kind
    if kind == "keyframe" and key is None:
        raise InputError("the run starts from no keyframe, expected one for controls of kind 'keyframe'")
    found = controls.laws(model, kind, key, asked.seed, asked.named)
    said = {
        "keyframe": "the keyframe's controls, held",
        "constant": "constant controls",
        "random": f"a random smooth control of every actuator (seed {asked.seed})",
    }[kind]
    if asked.log is not None:
        log = ControlLog(asked.log, controls.columns(model))
        read = {name: law for name, law in log.laws().items() if name not in asked.named}
        found = Laws({**found, **dict.fromkeys(read, str(log))}, logs=read, held=True)
        said = f"controls of the {log}"
    if asked.named:
        given = ", ".join(f"{name} = {law}" for name, law in asked.named.items())
        bare = kind == "constant" and asked.log is None
        said = f"{'controls' if bare else f'{said}, but'} {given}"
    return found, said


def _from_key(model: mujoco.MjModel, key: int | None, begins: str, laws: Laws, driven: str) -> Beginning:
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, key)
        for body in range(model.nbody):  # every data that is made of the model then has them there
            if (mocap := int(model.body_mocapid[body])) >= 0:
                model.body_pos[body], model.body_quat[body] = data.mocap_pos[mocap], data.mocap_quat[mocap]
    controls.place_mocaps(model, laws)
    return Beginning(data.qpos.copy(), data.qvel.copy(), data.act.copy(), key, begins, laws, driven)


def _key_name(model: mujoco.MjModel, key: int) -> str:
    return element_name(model, mujoco.mjtObj.mjOBJ_KEY, key)


def _write_named(model: mujoco.MjModel, target: np.ndarray, values: dict, what: str, case: Case) -> None:
    joints = [model.joint(index).name for index in range(model.njnt)]
    sizes = {0: (7, 6), 1: (4, 3), 2: (1, 1), 3: (1, 1)}
    for name, value in values.items():
        index = joints.index(choose(f"joint in [start] {what} of case '{case.name}'", name, joints))
        size = sizes[int(model.jnt_type[index])][0 if what == "qpos" else 1]
        entries = np.atleast_1d(np.asarray(value, dtype=float))
        if len(entries) != size:
            raise InputError(
                f"[start] {what} of joint '{name}' in case '{case.name}' has {len(entries)} numbers, expected {size}"
            )
        if what == "qpos" and size > 1:
            norm = float(np.linalg.norm(entries[-4:]))
            if abs(norm - 1.0) > UNIT:
                raise InputError(
                    f"[start] qpos of joint '{name}' in case '{case.name}' has a quaternion of norm {norm:.4g}, "
                    "expected 1"
                )
            entries[-4:] /= norm
        address = model.jnt_qposadr[index] if what == "qpos" else model.jnt_dofadr[index]
        target[address : address + size] = entries
