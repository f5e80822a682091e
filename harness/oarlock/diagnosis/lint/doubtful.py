"""L8: a rank that hangs on a small number, with the axes that are off by about as much."""

from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import JOINT, Remark, View
from oarlock.diagnosis.loops.loops import Group
from oarlock.diagnosis.loops.rank import CUT, NEAR
from oarlock.mechanics.names import element_name


def look(view: View) -> Iterator[Remark]:
    """A remark a group of loops."""
    if not view.equalities or not view.loops.closed:
        return
    for group in view.loops.groups:
        spectrum = group.spectrum
        if not spectrum.doubtful:
            continue
        small = spectrum.dropped > CUT / NEAR
        what, value = ("zero", spectrum.dropped) if small else ("one that counts", spectrum.kept)
        said = f"rank {group.rank} takes a singular value of {value:.2g} of the largest for {what}"
        tilts = [
            f"the axis of {quoted(one.joint)} is tilted by {one.radians:.3g} rad"
            for one in view.tilts({*group.equalities})
        ]
        names = group.equalities
        figures = {"also": list(names[1:]), "singular_value": value}
        inertias = "" if small or tilts else _inertias(view, group)
        severity = "note" if inertias else None
        yield Remark("L8", "; ".join([*tilts, f"{said}{inertias}"]), names[0], severity, figures)


def _inertias(view: View, group: Group) -> str:
    """What is said where it is inertias that differ by orders, and no axis or length, that make a value small."""
    model, assembly = view.model, view.assembly
    number = view.loops.groups.index(group)
    rows, dofs = assembly.rows_of_all(view.loops.members(number)), view.loops.dofs(number)
    alone = assembly.jacobian()[rows][:, dofs]
    slides = model.jnt_type[model.dof_jntid[dofs]] == mujoco.mjtJoint.mjJNT_SLIDE
    sizes = np.linalg.svd(alone * np.where(slides, max(view.size, mujoco.mjMINVAL), 1.0), compute_uv=False)
    if not sizes[0] or sizes[group.rank - 1] < NEAR * CUT * sizes[0]:
        return ""
    lightest = dofs[int(model.dof_invweight0[dofs].argmax())]
    name, unit = element_name(model, JOINT, int(model.dof_jntid[lightest])), "kg m²"
    unit = "kg" if model.jnt_type[model.dof_jntid[lightest]] == mujoco.mjtJoint.mjJNT_SLIDE else unit
    inertia = 1.0 / float(model.dof_invweight0[lightest])
    return f", by its inertias alone: behind joint {quoted(name)} there are {inertia:.2g} {unit}"
