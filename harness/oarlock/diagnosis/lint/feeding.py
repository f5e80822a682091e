"""A7: actuators that feed energy into a motion that the loops allow: damping or stiffness of the wrong sign.

An actuator with an affine bias or gain changes its force by −k l − c l̇ along its length l = rᵀq. With c < 0 it pushes
along with the velocity, with k < 0 away from where it stands; joints and tendons may damp and hold more than that.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.errors import few
from oarlock.diagnosis.lint.view import JOINT, Remark, View
from oarlock.mechanics.engine_version import full_mass, tendon_jacobian
from oarlock.mechanics.names import element_name
from oarlock.mechanics.rows import closing_jacobian
from oarlock.mechanics.servos import moments

GROWS = 1e-9
"""Relative, of the largest damping or stiffness: less is rounding."""

RANK_CUT = 1e-10
"""Relative, of singular values of the equality rows: those of smaller ones hold nothing at this pose."""


@dataclass(frozen=True)
class Coefficient:
    """What stands in front of a length or of its rate in the force of an actuator.

    Attributes:
        index: of the actuator; name: of it.
        direction: r (nv).
        value: k or c, without its sign in the file: below 0 it feeds.
        place: where it stands in the file, in words.
    """

    index: int
    name: str
    direction: np.ndarray
    value: float
    place: str


def look(view: View) -> Iterator[Remark]:
    """One remark, with all the actuators of which it is true: of their velocities first, then of their lengths."""
    model, data = view.model, view.data
    fed = [_coefficients(view, which) for which in (2, 1)]
    if not any(one.value < 0.0 for every in fed for one in every):
        return
    try:
        allowed = _allowed(model, data)
        for which, every, passive in zip((2, 1), fed, _passive(model, data), strict=True):
            own = [one for one in every if one.value < 0.0]
            if not own or not allowed.shape[1]:
                continue
            rate = _growth(allowed, every, passive)
            if rate <= 0.0 or _growth(allowed, [one for one in every if one.value >= 0.0], passive) > 0.0:
                continue  # they are damped or held by the rest, or it is not theirs
            whole = passive + sum(np.outer(one.direction, one.value * one.direction) for one in every)
            yield _remark(view, own, which, rate if which == 2 else math.sqrt(rate), whole)
            return
    except np.linalg.LinAlgError:  # numbers beyond all bounds: the run tells where they lead
        return


def _coefficients(view: View, which: int) -> list[Coefficient]:
    """Of the actuators that act back: of their lengths (1) or velocities (2), at the controls of the start."""
    model, data = view.model, view.data
    found = []
    for index, moment in enumerate(moments(model, data)):
        bias = gain = 0.0
        if model.actuator_biastype[index] == mujoco.mjtBias.mjBIAS_AFFINE:
            bias = float(model.actuator_biasprm[index, which])
        if model.actuator_gaintype[index] == mujoco.mjtGain.mjGAIN_AFFINE and not model.actuator_dyntype[index]:
            gain = float(model.actuator_gainprm[index, which] * data.ctrl[index])
        if not (bias or gain) or not moment.any():
            continue
        place = f"biasprm[{which}] = {bias:g}" if bias else f"gainprm[{which}] at its control"
        name = element_name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, index)
        found.append(Coefficient(index, name, moment, -(bias + gain), place))
    return found


def _passive(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Damping and stiffness of joints and tendons, (nv, nv) each."""
    dampers = np.diag(_first(model.dof_damping))
    springs = np.diag(_first(model.jnt_stiffness)[model.dof_jntid])
    if model.ntendon:
        rows = tendon_jacobian(model, data)
        dampers += rows.T @ (_first(model.tendon_damping)[:, None] * rows)
        springs += rows.T @ (_first(model.tendon_stiffness)[:, None] * rows)
    return dampers, springs


def _first(values: np.ndarray) -> np.ndarray:
    """What is linear, of numbers that may have coefficients of higher powers beside them."""
    return np.array(values if values.ndim == 1 else values[:, 0], dtype=float)


def _allowed(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Velocities (nv, f) that the equality rows allow, with a kinetic energy of one half each."""
    root = np.linalg.cholesky(full_mass(model, data))
    back = np.linalg.inv(root).T
    if not data.ne:
        return back
    rows = closing_jacobian(model, data) @ back
    _, sizes, turned = np.linalg.svd(rows)
    rank = int((sizes > RANK_CUT * sizes.max(initial=0.0)).sum())
    return back @ turned[rank:].T


def _growth(allowed: np.ndarray, every: list[Coefficient], passive: np.ndarray) -> float:
    """The rate at which the worst allowed motion is fed: of a damping 1/s, of a stiffness 1/s²; 0 of none."""
    whole = passive + sum(one.value * np.outer(one.direction, one.direction) for one in every)
    values = np.linalg.eigvalsh(allowed.T @ whole @ allowed)
    return max(0.0, -float(values[0])) if -values[0] > GROWS * np.abs(values).max() else 0.0


def _remark(view: View, own: list[Coefficient], which: int, rate: float, whole: np.ndarray) -> Remark:
    model = view.model
    first, *others = sorted(own, key=lambda one: one.value)
    names = [one.name for one in others]
    joints = sorted({int(model.dof_jntid[dof]) for one in own for dof in np.flatnonzero(one.direction)})
    pushes = "along with the velocity" if which == 2 else "further from where it stands, the further the more"
    others_too = f", as does {few([repr(name) for name in names])}" if names else ""
    said = (
        f"{first.place} pushes {pushes}{others_too}: {_left(view, first, which, whole)}the motion grows by e every "
        f"{1.0 / rate:.2g} s, whatever the timestep; the other sign was meant?"
    )
    figures = {"also": names, "rate": rate, "value": first.value, "loops": view.around(joints)}
    return Remark("A7", said, first.name, figures=figures)


def _left(view: View, one: Coefficient, which: int, whole: np.ndarray) -> str:
    """What is left with all that damps, or holds, the joint that an actuator is on; empty of several joints."""
    dofs = np.flatnonzero(one.direction)
    if len(dofs) != 1:
        return ""
    joint = int(view.model.dof_jntid[dofs[0]])
    slides = int(view.model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    unit = ("N" if slides else "N m") + (" s" if which == 2 else "") + ("/m" if slides else "/rad")
    what = "damping" if which == 2 else "stiffness"
    name = element_name(view.model, JOINT, joint)
    return f"joint {name!r} is left with a {what} of {whole[dofs[0], dofs[0]]:.3g} {unit}, and "
