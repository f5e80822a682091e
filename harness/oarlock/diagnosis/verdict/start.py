"""From the closed pose near the start to findings: what cannot close, what is locked, what stands open."""

from collections.abc import Iterator

import mujoco

from oarlock.base.text import quoted
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.lint import locked, opened
from oarlock.diagnosis.loops.mobility import Mobility
from oarlock.diagnosis.loops.poses import ClosedPose
from oarlock.diagnosis.verdict import blame, references
from oarlock.diagnosis.verdict.findings import Finding, found
from oarlock.diagnosis.verdict.short import short_along
from oarlock.mechanics.coupled import coupled_ids
from oarlock.mechanics.names import element_name, equalities

_JOINT = mujoco.mjtObj.mjOBJ_JOINT


def start(exam: Examination) -> Iterator[Finding]:
    """S1, S2 and S3."""
    pose, file = exam.pose, exam.file
    if pose is None:
        return
    tilts = [f"the axis of {quoted(one.joint)} is tilted by {one.radians:.3g} rad" for one in pose.tilts]
    if not pose.closed:
        for culprit in pose.culprits:
            said = "; ".join(
                [culprit.of_first(), *short_along(exam, culprit), *references.reachable(exam, culprit), *tilts]
            )
            if any(one.equality in culprit.equalities for one in exam.targets):
                continue  # S8
            yield found("S2", file, said, element=culprit.equalities[0], gap=max(o.largest for o in culprit.openings))
        if not pose.culprits:
            worst = max(pose.left, key=lambda one: one.largest)
            said = "; ".join([f"stays open by {worst}", *tilts])
            yield found("S2", file, said, element=worst.equality, gap=worst.largest)
        return
    for one in pose.mobility:
        if one.locked:
            severity = blame.lock(exam, one)
            slide = one.slide if severity == "warning" else ""
            said = _of_one(exam, one) or locked.sentence(
                pose.tilts, one.equalities, one.frees, slide, severity == "note"
            )
            figures = {"also": list(one.equalities[1:]), "dof": one.dof, "kept": one.kept}
            yield found("S3", file, said, element=one.equalities[0], severity=severity, **figures)
    if not pose.consistent:
        yield _inconsistent(exam, pose)


def _of_one(exam: Examination, one: Mobility) -> str:
    """Of a coupling that names one joint alone: it holds that at a constant, whatever else was meant."""
    own = [each for each in equalities(exam.model) if each.name in one.equalities]
    ids = coupled_ids(exam.model, own[0].index) if len(own) == 1 and own[0].kind.holds == "joints" else []
    if len(ids) != 1:
        return ""
    joint, constant = element_name(exam.model, _JOINT, ids[0]), float(exam.model.eq_data[own[0].index, 0])
    return (
        f"names no joint2, and so holds joint {quoted(joint)} at {constant:g} from the model's own pose: to follow "
        "another joint it needs that as joint2"
    )


def _inconsistent(exam: Examination, pose: ClosedPose) -> Finding:
    held, exchanged = list(_as_it_starts(exam)), list(references.exchanged(exam))[:1]
    more = [*exchanged, *(said for said, _ in held)]
    if pose.moved_joint and not more:
        more.append(f"the nearest closed pose moves {quoted(pose.moved_joint)} by {pose.moved:.3g} {pose.moved_unit}")
    if pose.outside:
        more.append(f"it is beyond the {pose.outside[0].limit} by {pose.outside[0].by:.3g}")
    one = opened.of(pose.openings, pose.speeds, [*more, *references.closing(exam)])
    figures = {**one.figures, "moved": pose.moved, "relpose": held[0][1] if held else None}
    figures["meant"] = bool(held or exchanged)
    severity = "note" if one.element in offsets(exam) else one.severity
    return found("S1", exam.file, one.line, element=one.element, severity=severity, **figures)


def _as_it_starts(exam: Examination) -> Iterator[tuple[str, str]]:
    """What is said of the welds that hold the pose of the model's own, with the relpose that holds that of the start.

    Nothing, where it is another equality that stands open most.
    """
    assert exam.pose is not None
    worst = max(exam.pose.openings, key=lambda one: one.largest)
    own = [
        one
        for one in exam.remarks.get("defined", [])
        if f"keyframe {quoted(one.figures['keyframe'])}" == exam.begins and "wanted" in one.figures
    ]
    own.sort(key=lambda one: one.element != worst.equality)
    if not own or own[0].element != worst.equality:
        return
    for one in own:
        wanted, whose = one.figures["wanted"], "it" if one is own[0] else quoted(one.element)
        why = "without a relpose it holds that of the model's own pose: " if one is own[0] else ""
        yield f'{why}relpose="{wanted}" holds {whose} as it starts', wanted


def offsets(exam: Examination) -> set[str]:
    """Couplings whose offset is what opens the start, so that it is the coupling that has to be mended (S4)."""
    return {one.equality for one in exam.lasting if one.attribute == "polycoef"}
