"""Couplings whose softness is scaled by tiny inertias: what an armature on their joints leaves of a drift.

MuJoCo scales the softness of a row by the inverse inertia of what it couples, each joint taken by itself: links and
rotors of some grams make a coupling soft that holds a load of a kilogram. Real drives have the inertia of their rotor
times the gear ratio squared there. The armature that is tried is as large as the closed motion hardly notices,

    a = 0.05/max ‖v_S‖²/(vᵀ M v)    over the velocities v that the rows admit, v_S of the joints that get it,

which is far more than a tiny joint has, and next to nothing beside the load.
"""

import copy
import math
from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.gaps import Opening, opening, widest
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.mechanics.coupled import coupled, coupled_ids
from oarlock.mechanics.names import Equality, element_name
from oarlock.poses.assembly import Assembly

ADDED = 0.05
"""Of the inertia of a closed motion: an armature adds no more to any of them."""

LEAVES = 0.5
"""Of a drift: an armature is named where a run with it leaves less."""

_RANK = 1e-9
"""Of the largest singular value of the rows: below it a motion is closed."""

_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True)
class Rotors:
    """An armature that couplings lack.

    Attributes:
        joints: names of the joints that get it.
        unit: of armature and inertia, kg m² or kg.
        armature: what each gets.
        inertia: behind the lightest of them by itself.
        left: equality → its largest gap in a run with it.
    """

    joints: tuple[str, ...]
    unit: str
    armature: float
    inertia: float
    left: dict[str, Opening]


def find_rotors(recording: Recording, soft: Iterable[Equality]) -> Rotors | None:
    """Tries an armature on the joints of couplings that drift by their softness; None where it is no mend.

    Args:
        recording: MuJoCo's run as configured.
        soft: the equalities.
    """
    model = recording.model
    soft = [one for one in soft if one.kind.holds in ("joints", "tendons")]
    every = sorted({dof for one in soft for dof in coupled(one.kind).dofs(model, coupled_ids(model, one.index))})
    dofs, armature = _light(recording, every)
    if not dofs:
        return None
    changed = _with_armature(model, dofs, armature)
    worst = max(soft, key=lambda one: _gap(recording, one, recording.position).largest)
    if _softness(recording, changed, worst) > LEAVES * _softness(recording, model, worst):
        return None
    again = rerun(recording, changed)
    if again is None:
        return None
    left = {one.name: _gap(recording, one, again.position) for one in soft}
    if left[worst.name].largest > LEAVES * _gap(recording, worst, recording.position).largest:
        return None
    return Rotors(
        joints=tuple(element_name(model, mujoco.mjtObj.mjOBJ_JOINT, int(model.dof_jntid[dof])) for dof in dofs),
        unit="kg" if model.jnt_type[model.dof_jntid[dofs[0]]] == _SLIDE else "kg m²",
        armature=armature,
        inertia=1.0 / float(model.dof_invweight0[dofs].max()),
        left=left,
    )


def _light(recording: Recording, dofs: list[int]) -> tuple[list[int], float]:
    """Those of some degrees of freedom that are lighter than the armature that they may get, and that armature.

    Only hinges or only slides, for one number: whichever has the lightest.
    """
    model = recording.model
    kinds = model.jnt_type[model.dof_jntid]
    dofs = [dof for dof in dofs if kinds[dof] in (_HINGE, _SLIDE)]
    if not dofs:
        return [], 0.0
    lightest = max(dofs, key=lambda dof: model.dof_invweight0[dof])
    dofs = [dof for dof in dofs if kinds[dof] == kinds[lightest]]
    for _ in range(len(dofs)):
        armature = _unnoticed(recording, dofs)
        light = [dof for dof in dofs if armature * model.dof_invweight0[dof] > 1.0]
        if not light or light == dofs:
            return light, armature
        dofs = light
    return [], 0.0


def _unnoticed(recording: Recording, dofs: list[int]) -> float:
    """The largest armature on some degrees of freedom that a closed motion hardly notices, to one digit; 0: none."""
    model = recording.model
    assembly = Assembly(model, recording.restart(model))
    assembly.place(recording.qpos[0])
    rows = assembly.whitened(assembly.jacobian())
    _, sizes, right = np.linalg.svd(rows)
    rank = int((sizes > _RANK * sizes.max(initial=0.0)).sum())
    share = assembly.whitened(np.eye(model.nv)[dofs]) @ right[rank:].T  # Mv·v = 1 for each of the columns
    most = float(np.linalg.norm(share, 2)) ** 2 if share.shape[1] else 0.0
    if most <= mujoco.mjMINVAL:
        return 0.0
    unit = 10.0 ** math.floor(math.log10(ADDED / most))
    return float(f"{math.floor(ADDED / most / unit) * unit:.0e}")


def _with_armature(model: mujoco.MjModel, dofs: list[int], armature: float) -> mujoco.MjModel:
    changed = copy.deepcopy(model)
    changed.dof_armature[dofs] += armature
    mujoco.mj_setConst(changed, mujoco.MjData(changed))  # which softness is scaled by
    changed.eq_data[:] = model.eq_data
    return changed


def _softness(recording: Recording, model: mujoco.MjModel, one: Equality) -> float:
    """R of a coupling at the start."""
    data = recording.restart(model)
    mujoco.mj_fwdPosition(model, data)
    own = data.efc_R[: data.ne][data.efc_id[: data.ne] == one.index]
    return float(own.max(initial=0.0))


def _gap(recording: Recording, one: Equality, position: np.ndarray) -> Opening:
    """The largest gap of an equality in a run (steps, rows)."""
    place = [each.index for each in recording.layout.equalities].index(one.index)
    rows = position[:, recording.layout.of_equality(place)]
    return opening(recording.model, one, rows[widest(recording.model, one, rows)])
