"""S3, as far as the rows of a closed pose tell: loops whose rows leave no motion there."""

from collections.abc import Iterator, Sequence
from typing import Literal

import mujoco

from oarlock.base.errors import few
from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import Remark, View
from oarlock.diagnosis.loops.loops import Loop
from oarlock.diagnosis.loops.mobility import Mobility, Tilt, rigidity
from oarlock.diagnosis.loops.poses import ClosedPose
from oarlock.diagnosis.loops.release import find_release
from oarlock.stepping.closing import CONSISTENT

MEANT = 0.05
"""Smallest singular value of a group that is locked, of the largest: above it no small error locked it."""


def look(view: View) -> Iterator[Remark]:
    """A remark a group, where no closed pose was looked for: a check finds those too that only snap back."""
    if not view.equalities or not view.loops.closed:
        return
    yield from _held(view)
    if view.posed:
        return
    for number, group in enumerate(view.loops.groups):
        if group.dof or not group.dofs:
            continue
        own = [view.loops.loops[member] for member in view.loops.members(number)]
        tilts = view.tilts({*group.equalities})
        frees = [loop.name for loop in own if loop.freed]
        figures = {"dof": 0, "kept": group.spectrum.kept}
        assembly, dofs = view.assembly, view.loops.dofs(number)
        stiff = rigidity(assembly, view.loops.members(number), dofs, assembly.data.qpos.copy())
        kept = max(group.spectrum.kept, stiff)
        severity = how_bad(view.model, own, tilts, kept, not _driven(view.model, dofs))
        slide = ""
        if severity == "warning" and len(own) == 1:
            (member,) = view.loops.members(number)
            slide = find_release(assembly, member, dofs, assembly.data.qpos.copy())
        yield Remark(
            "S3",
            sentence(tilts, group.equalities, frees, slide, severity == "note"),
            group.equalities[0],
            severity,
            figures,
        )


def _held(view: View) -> Iterator[Remark]:
    """S3 of what is driven, in a group that moves otherwise."""
    for one in view.held:
        group = view.loops.groups[one.group]
        if not group.dof:
            continue
        names = [view.loops.loops[member].name for member in one.members]
        joints = view.joints(one.dofs)
        held = few([quoted(name) for name in joints], last="and")
        said = f"{held}, which an actuator drives, cannot move although other joints of the loops can"
        said = "; ".join([said, *without(names, names)])
        figures = {"also": names[1:], "held": joints, "dof": group.dof, "kept": group.spectrum.kept}
        yield Remark("S3", said, names[0], None if names[1:] else "warning", figures)


def sentence(
    tilts: Sequence[Tilt], equalities: Sequence[str], frees: Sequence[str], slide: str = "", meant: bool = False
) -> str:
    """What is said of a group that is locked.

    Args:
        tilts: joints whose axes are off.
        equalities: of the group.
        frees: those without which it would move, one at a time.
        slide: along what its pin would have to slide; empty: no such thing is said.
        meant: whether it is a structure, in which nothing contradicts anything.
    """
    axes = [f"the axis of {quoted(one.joint)} is tilted by {one.radians:.3g} rad" for one in tilts]
    said = "; ".join(["closed, and nothing of its loop can move", *axes, *without(equalities, frees, meant)])
    return f"{said}, or if its pin slid {slide}, as in a slot" if slide else said


def without(equalities: Sequence[str], frees: Sequence[str], meant: bool = False) -> list[str]:
    """What of a locked group would have to go, as a part of a sentence, or nothing."""
    if not frees:
        return ["leaving out one of its equalities does not free it"] if len(equalities) > 1 else []
    names = few([quoted(name) for name in frees], last="or")
    alike = len(frees) == 2 and not meant
    both = f"{few([quoted(name) for name in frees])} contradict each other: " if alike else ""
    return [f"{both}it would move without {names}"]


def how_bad(
    model: mujoco.MjModel, own: Sequence[Loop], tilts: Sequence[Tilt], kept: float, idle: bool
) -> Literal["warning", "note"] | None:
    """How bad a lock is; None: as the catalogue has it.

    A note where it is meant, of a single joint or to a mocap body; where its rows are far from redundant, so that no
    small error made it, a warning, and a note of a structure: a truss, a frame or a strut.

    Args:
        model: the user's.
        own: the loops of the group.
        tilts: joints whose axes are off.
        kept: how far from redundant its rows are.
        idle: whether it is closed at the start, and nothing drives it.
    """
    if tilts:
        return None
    single = all(len(loop.path.joints) <= 1 for loop in own)
    mocap = any(model.body_mocapid[body] >= 0 for loop in own for body in loop.equality.bodies)
    if single or mocap:
        return "note"
    if kept <= MEANT:
        return None
    return "note" if idle else "warning"


def lock(model: mujoco.MjModel, pose: ClosedPose, one: Mobility) -> Literal["warning", "note"] | None:
    """The same of a group of a closed pose near the start: one that stands open there was not drawn as a structure."""
    own = [loop for loop in pose.loops.loops if loop.name in one.equalities]
    if any(each.equality in one.equalities and each.largest > CONSISTENT for each in pose.openings):
        return how_bad(model, own, pose.tilts, one.kept, False)
    return how_bad(model, own, pose.tilts, max(one.kept, one.rigid), not _driven(model, one.dofs))


def _driven(model: mujoco.MjModel, dofs: Sequence[int]) -> bool:
    """Whether an actuator moves one of some degrees of freedom; what is no joint's may move any."""
    joints = {int(model.dof_jntid[dof]) for dof in dofs}
    kinds = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    return any(
        int(model.actuator_trntype[index]) not in kinds or int(model.actuator_trnid[index, 0]) in joints
        for index in range(model.nu)
    )
