"""Couplings that are open since MuJoCo counts joints and tendons from the model's own pose, and what they can have."""

from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.base.text import quoted
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.loops.gaps import Culprits
from oarlock.diagnosis.symptoms import start_of
from oarlock.mechanics.coupled import coupled_ids
from oarlock.mechanics.names import element_name, equalities
from oarlock.poses.assembly import Assembly
from oarlock.stepping.closing import CONSISTENT

_SITE = mujoco.mjtObj.mjOBJ_SITE

FROM_ZERO = 0.02
"""Of what a coupling stands open by: with joints counted from 0 it is closed to that."""


def closing(exam: Examination) -> Iterator[str]:
    """The polynomial of the coupling that stands open most, where the ref of its joints is what opens it."""
    assert exam.pose is not None
    model, worst = exam.model, max(exam.pose.openings, key=lambda one: one.largest)
    for one in equalities(model):
        ids = coupled_ids(model, one.index) if one.kind.holds == "joints" else []
        zeros = [float(model.qpos0[model.jnt_qposadr[joint]]) for joint in ids]
        polynomial = model.eq_data[one.index, :5]
        if one.name != worst.equality or len(ids) != 2 or not any(zeros) or polynomial[2:].any():
            continue
        offset = float(polynomial[0] + polynomial[1] * zeros[1] - zeros[0])  # as if they were counted from 0
        places = [float(exam.qpos[model.jnt_qposadr[joint]]) for joint in ids]
        if abs(places[0] - polynomial[0] - polynomial[1] * places[1]) <= FROM_ZERO * worst.largest:
            yield (
                f"MuJoCo counts its joints from their ref ({zeros[0]:g} and {zeros[1]:g}), and counted from 0 it is "
                f'closed: polycoef="{offset:g} {polynomial[1]:g} 0 0 0"'
            )


def exchanged(exam: Examination) -> Iterator[str]:
    """Two equalities by sites that are closed at the start once their second sites are exchanged."""
    assert exam.pose is not None
    data = start_of(exam)
    mujoco.mj_kinematics(exam.model, data)
    wide = {one.equality: one.metres or 0.0 for one in exam.pose.openings}
    worst = max(wide, key=wide.__getitem__, default="")
    open_ = [one for one in equalities(exam.model) if one.sites is not None and wide.get(one.name, 0.0) > CONSISTENT]
    first = next((one for one in open_ if one.name == worst), None)
    for second in open_ if first is not None else ():
        assert first is not None
        mine, theirs = (data.site_xpos[[*one.sites]] if one.sites else np.zeros((2, 3)) for one in (first, second))
        apart = max(float(np.linalg.norm(mine[0] - theirs[1])), float(np.linalg.norm(theirs[0] - mine[1])))
        if second is not first and second.kind is first.kind and apart <= FROM_ZERO * wide[first.name]:
            names = [element_name(exam.model, _SITE, one.sites[1]) for one in (second, first) if one.sites]
            yield (
                f"with the second sites of {quoted(first.name)} and {quoted(second.name)} exchanged, "
                f'site2="{names[0]}" and site2="{names[1]}", both are closed as it starts'
            )


def reachable(exam: Examination, culprit: Culprits) -> Iterator[str]:
    """The polynomial that is met where a coupling that cannot be closed alone comes nearest."""
    pose, model = exam.pose, exam.model
    own = [one for one in equalities(model) if one.name == culprit.equalities[0]]
    if pose is None or not culprit.alone or not own or own[0].kind.holds not in ("joints", "tendons"):
        return
    assembly = Assembly(model, start_of(exam))
    if own[0].index not in [one.index for one in assembly.equalities]:
        return
    assembly.place(pose.qpos)
    place = [one.index for one in assembly.equalities].index(own[0].index)
    (left,) = assembly.residual()[assembly.rows_of(place)].tolist()
    polynomial = model.eq_data[own[0].index, :5].copy()
    polynomial[0] += left
    written = " ".join(f"{value + 0.0:.6g}" for value in polynomial)
    said = f'with polycoef="{written}" it is met there'
    ids = coupled_ids(model, own[0].index)
    if own[0].kind.holds == "tendons" and len(ids) == 1:
        zero = float(model.tendon_length0[ids[0]])
        asked = zero + float(model.eq_data[own[0].index, 0])
        said += f"; MuJoCo counts from the length that is drawn, {zero:.4g}, so that it asks for {asked:.4g} in all"
    yield said
