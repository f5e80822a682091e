"""What a run is made again without, one thing at a time, to see what it does: springs, dampers, drives, settings.

A suspect is something that stands in the file by a name, with a change that takes it away. What the run then lacks is
its part, measured; parts of several may add up to more than the whole, for they act on one another.
"""

import copy
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from oarlock.base.errors import few
from oarlock.base.text import quoted
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import Rerun, rerun
from oarlock.mechanics.names import Equality, element_name

Sort = Literal["weight", "spring", "damper", "friction", "limit", "drive", "softness", "refsafe", "scale"]

MOST = 40
"""Suspects of one model at most, and of one sort ``EACH``: of more it takes too long."""

EACH = 8

SOLREF, SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
"""MuJoCo's own, of an equality that says nothing."""

USUAL = 'solref="0.02 1" solimp="0.9 0.95 0.001"'
"""The same, as it is written."""

FINEST = 64
"""Parts of a timestep at most, where a solref of the file asks for finer ones."""

ROUNDS = 1e-9
"""Relative, of a timestep."""

LESSENED = 0.01
"""Times what several joints have together, damping or armature, in place of none: without any a run may blow up."""

SCALES = (1.0, 5.0, 20.0)
"""torquescales that are tried where one is below 1."""

_JOINT, _ACTUATOR, _TENDON = mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_ACTUATOR, mujoco.mjtObj.mjOBJ_TENDON
_BITS = mujoco.mjtDisableBit
_RATE, _SCALE = 2, 10
_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True)
class Suspect:
    """Something that a run may be made without.

    Attributes:
        sort: what it is.
        name: of its element; empty: the model as a whole.
        said: the same in words, with its figures.
        without: takes it away from a copy of the model.
        scaled: makes it so many times as large, where that is something to write.
        parts: steps of the run without it for one of the run.
        index: of an actuator; -1 of others.
        tried: what takes its place in the run without it, in words.
        on_joint: whether ``name`` is a joint's.
    """

    sort: Sort
    name: str
    said: str
    without: Callable[[mujoco.MjModel], None]
    scaled: Callable[[mujoco.MjModel, float], None] | None = None
    tried: str = "without it"
    parts: int = 1
    index: int = -1
    on_joint: bool = False


def model_without(recording: Recording, one: Suspect) -> mujoco.MjModel:
    """A copy of the model of a run without a suspect."""
    model = copy.deepcopy(recording.model)
    one.without(model)
    return model


def run_without(recording: Recording, one: Suspect, steps: int | None = None) -> Rerun | None:
    """The same run without a suspect; None where it does not stay finite."""
    return rerun(recording, model_without(recording, one), parts=one.parts, steps=steps)


def suspects(model: mujoco.MjModel, dofs: Iterable[int], own: Iterable[Equality] = ()) -> Iterator[Suspect]:
    """Those that act on some degrees of freedom, and the softness of some equalities."""
    dofs = sorted(set(dofs))
    yield from _softness(model, own)
    joints = sorted({int(model.dof_jntid[dof]) for dof in dofs})
    yield from list(_springs(model, joints))[:EACH]
    yield from list(_dampers(model, joints))[:EACH]
    yield from list(_limits(model, joints))[:EACH]
    if any(model.dof_frictionloss[dof] > 0.0 for dof in dofs):
        yield Suspect(
            "friction", "", "the friction loss of its joints", lambda copied: _zero(copied.dof_frictionloss, dofs)
        )
    if model.opt.gravity.any() and not model.opt.disableflags & _BITS.mjDSBL_GRAVITY:
        yield Suspect("weight", "", "the weight of what it carries", _weightless)


def drives(model: mujoco.MjModel, dofs: Iterable[int]) -> Iterator[Suspect]:
    """The actuators on joints with some degrees of freedom, or on tendons."""
    joints = {int(model.dof_jntid[dof]) for dof in dofs}
    for index in range(model.nu):
        kind, target = int(model.actuator_trntype[index]), int(model.actuator_trnid[index, 0])
        on_joint = kind in (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
        if not on_joint or target in joints:
            name = element_name(model, _ACTUATOR, index)
            yield Suspect("drive", name, f"actuator {quoted(name)}", _undriven(index), _driven(index), index=index)


def _undriven(index: int) -> Callable[[mujoco.MjModel], None]:
    def without(model: mujoco.MjModel) -> None:
        model.actuator_gainprm[index] = model.actuator_biasprm[index] = 0.0

    return without


def _driven(index: int) -> Callable[[mujoco.MjModel, float], None]:
    def scaled(model: mujoco.MjModel, factor: float) -> None:
        model.actuator_gainprm[index] *= factor
        model.actuator_biasprm[index] *= factor

    return scaled


def _softness(model: mujoco.MjModel, own: Iterable[Equality]) -> Iterator[Suspect]:
    own, h = list(own), float(model.opt.timestep)
    guarded = not model.opt.disableflags & _BITS.mjDSBL_REFSAFE
    for one in own:
        constant = float(model.eq_solref[one.index, 0])
        if guarded and 0.0 < constant < (1.0 - ROUNDS) * 2.0 * h:
            parts = min(FINEST, math.ceil(2.0 * h / constant))
            said = f'its solref="{constant:g} {model.eq_solref[one.index, 1]:g}", which is taken as {2.0 * h:g}: '
            said += f"MuJoCo takes no time constant below two timesteps of {h:g} s"
            fine = max(0.5 * constant, h / FINEST)
            tried = f"with a timestep of {fine:g} s"
            yield Suspect("refsafe", one.name, said, _fitted(fine), tried=tried, parts=parts)
            continue
        refs, imps = model.eq_solref[one.index], model.eq_solimp[one.index]
        given = []
        if not np.allclose(refs, SOLREF):
            given.append(f'solref="{" ".join(f"{value:g}" for value in refs)}"')
        if not np.allclose(imps, SOLIMP):
            given.append(f'solimp="{" ".join(f"{value:g}" for value in imps[:3])}"')
        if given:
            said = f"its {few(given, last='and')}"
            yield Suspect("softness", one.name, said, _usual(one.index), tried=f"with MuJoCo's own {USUAL}")
        if one.kind.turns and 0.0 < one.torque_scale(model) < 1.0:
            said = f'its torquescale="{one.torque_scale(model):g}"'
            for scale in SCALES:
                tried = f'with torquescale="{scale:g}"'
                yield Suspect("scale", one.name, said, _evenly(one.index, scale), tried=tried)


def alike(model: mujoco.MjModel, dofs: Iterable[int], fields: tuple[str, ...]) -> Suspect | None:
    """The damping, the armature or both of all joints with some degrees of freedom; None: fewer than two have one."""
    dofs, said, places = sorted(set(dofs)), [], list[list[int]]()
    for field in fields:
        values = getattr(model, f"dof_{field}").reshape(model.nv, -1)[:, 0]
        having = [dof for dof in dofs if values[dof] > 0.0]
        if len(having) < 2:
            return None
        low, high = min(values[having]), max(values[having])
        said.append(f"{field} ({low:g}" + (f" to {high:g})" if high > low else " each)"))
        places.append(having)
    joints = {int(model.dof_jntid[dof]) for having in places for dof in having}

    def lessened(copied: mujoco.MjModel) -> None:
        for field, having in zip(fields, places, strict=True):
            getattr(copied, f"dof_{field}").reshape(model.nv, -1)[having] *= LESSENED
        mujoco.mj_setConst(copied, mujoco.MjData(copied))

    of = f"what {len(joints)} joints of its loops have together, {few(said, last='and')},"
    return Suspect("damper", "", of, lessened, tried=f"with {LESSENED:g} times that")


def _fitted(timestep_s: float) -> Callable[[mujoco.MjModel], None]:
    def without(model: mujoco.MjModel) -> None:
        model.opt.timestep /= math.ceil(model.opt.timestep / timestep_s * (1.0 - ROUNDS))

    return without


def _usual(index: int) -> Callable[[mujoco.MjModel], None]:
    def without(model: mujoco.MjModel) -> None:
        model.eq_solref[index], model.eq_solimp[index] = SOLREF, SOLIMP

    return without


def _evenly(index: int, scale: float) -> Callable[[mujoco.MjModel], None]:
    def without(model: mujoco.MjModel) -> None:
        model.eq_data[index, _SCALE] = scale

    return without


def _limits(model: mujoco.MjModel, joints: list[int]) -> Iterator[Suspect]:
    for joint in joints:
        if model.jnt_limited[joint] and model.jnt_type[joint] in (_HINGE, _SLIDE):
            name = element_name(model, _JOINT, joint)
            low, high = model.jnt_range[joint].tolist()
            unit = "m" if model.jnt_type[joint] == _SLIDE else "rad"
            said = f"the range of joint {quoted(name)} ({low:.4g} to {high:.4g} {unit})"
            yield Suspect("limit", name, said, _unlimited(joint))


def _unlimited(joint: int) -> Callable[[mujoco.MjModel], None]:
    def without(model: mujoco.MjModel) -> None:
        model.jnt_limited[joint] = 0

    return without


def _springs(model: mujoco.MjModel, joints: list[int]) -> Iterator[Suspect]:
    stiffness = model.jnt_stiffness.reshape(model.njnt, -1)
    for joint in joints:
        if stiffness[joint, 0] > 0.0 and model.jnt_type[joint] in (_HINGE, _SLIDE):
            name = element_name(model, _JOINT, joint)
            rest, unit = float(model.qpos_spring[model.jnt_qposadr[joint]]), "rad"
            unit = "m" if model.jnt_type[joint] == _SLIDE else unit
            said = (
                f"the spring of joint {quoted(name)} (stiffness {stiffness[joint, 0]:g}, at rest at {rest:.3g} {unit})"
            )
            yield Suspect("spring", name, said, _unsprung(joint), _sprung(joint))
    for tendon in range(model.ntendon):
        if model.tendon_stiffness.reshape(model.ntendon, -1)[tendon, 0] > 0.0:
            name = element_name(model, _TENDON, tendon)
            yield Suspect("spring", name, f"the spring of tendon {quoted(name)}", _slack(tendon))


def _unsprung(joint: int) -> Callable[[mujoco.MjModel], None]:
    return lambda model: _sprung(joint)(model, 0.0)


def _sprung(joint: int) -> Callable[[mujoco.MjModel, float], None]:
    def scaled(model: mujoco.MjModel, factor: float) -> None:
        model.jnt_stiffness.reshape(model.njnt, -1)[joint] *= factor

    return scaled


def _slack(tendon: int) -> Callable[[mujoco.MjModel], None]:
    def without(model: mujoco.MjModel) -> None:
        model.tendon_stiffness.reshape(model.ntendon, -1)[tendon] = 0.0

    return without


def _dampers(model: mujoco.MjModel, joints: list[int]) -> Iterator[Suspect]:
    damping = model.dof_damping.reshape(model.nv, -1)
    every = []
    for joint in joints:
        first = int(model.jnt_dofadr[joint])
        if damping[first, 0] > 0.0:
            every.append((float(damping[first, 0] * model.dof_invweight0[first]), joint))
    for _, joint in sorted(every, reverse=True):
        name, value = element_name(model, _JOINT, joint), float(damping[int(model.jnt_dofadr[joint]), 0])
        said = f"the damping of joint {quoted(name)} ({value:g})"
        yield Suspect("damper", name, said, _undamped(joint), _damped(joint), on_joint=True)
    on = {int(model.dof_jntid[dof]) for dof in range(model.nv)} & set(joints)
    for index in range(model.nu):
        kv = -float(model.actuator_biasprm[index, _RATE])
        if kv > 0.0 and int(model.actuator_trnid[index, 0]) in on:
            name = element_name(model, _ACTUATOR, index)
            yield Suspect(
                "damper", name, f"the kv of actuator {quoted(name)} ({kv:g})", _rateless(index), _rated(index)
            )


def _undamped(joint: int) -> Callable[[mujoco.MjModel], None]:
    return lambda model: _damped(joint)(model, 0.0)


def _damped(joint: int) -> Callable[[mujoco.MjModel, float], None]:
    def scaled(model: mujoco.MjModel, factor: float) -> None:
        own = model.dof_jntid == joint
        model.dof_damping.reshape(model.nv, -1)[own] *= factor

    return scaled


def _rateless(index: int) -> Callable[[mujoco.MjModel], None]:
    return lambda model: _rated(index)(model, 0.0)


def _rated(index: int) -> Callable[[mujoco.MjModel, float], None]:
    def scaled(model: mujoco.MjModel, factor: float) -> None:
        model.actuator_biasprm[index, _RATE] *= factor
        if model.actuator_gaintype[index] == mujoco.mjtGain.mjGAIN_AFFINE:
            model.actuator_gainprm[index, _RATE] *= factor

    return scaled


def _weightless(model: mujoco.MjModel) -> None:
    model.opt.gravity[:] = 0.0


def _zero(array: np.ndarray, places: list[int]) -> None:
    array[places] = 0.0
