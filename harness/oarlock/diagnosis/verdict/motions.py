"""From what a run does to findings: dead points, branches, steps that are too long, what lasts, starved solvers."""

import math
from collections.abc import Iterator

import numpy as np

from oarlock.base.errors import few
from oarlock.base.numbers import figure, percent
from oarlock.base.text import called, quoted
from oarlock.diagnosis.examination import starved
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.runs.drifts import VISIBLE
from oarlock.diagnosis.runs.overdriven import Overdriven
from oarlock.diagnosis.runs.solving import Solving
from oarlock.diagnosis.verdict.blame import behind, held, in_words
from oarlock.diagnosis.verdict.causes import CAUSE
from oarlock.diagnosis.verdict.findings import Finding, Severity, found
from oarlock.diagnosis.verdict.ranks import doubtful
from oarlock.stepping.state import STILL


def dead_point(exam: Examination) -> Iterator[Finding]:
    """U4: a joint that MuJoCo's run takes beyond what its loops admit."""
    one = exam.dead_point
    if one is None or doubtful(exam, one.equalities):
        return
    if any({each.equality, *each.others} & {*one.equalities} for each in exam.undriven):
        return  # a loop that nothing drives swings there (A8)
    turns = "" if one.turns_s is None else f" and turns back, as the exact motion does at t = {one.turns_s:.4g} s"
    said = (
        f"{called('joint', one.joint)} cannot pass {_coordinate(one.limit, one.unit)}: the mechanism comes to a dead "
        f"point there{turns}; MuJoCo goes on beyond it at t = {one.time_s:.4g} s, tears '{one.equality}' open by "
        f"{one.torn} and moves the joint at up to {one.speed:.3g} {one.unit}/s, in poses that the mechanism does not "
        "have"
    )
    if because := behind(exam, one.equality):
        said += f"; {because}"
    yield found(
        "U4",
        exam.file,
        said,
        element=one.equality,
        joint=one.joint,
        limit=one.limit,
        furthest=one.furthest,
        time_s=one.time_s,
        torn=one.torn.largest,
        also=[name for name in one.equalities if name != one.equality],
    )


def _coordinate(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}" + (f" ({math.degrees(value):.1f}°)" if unit == "rad" else "")


def branch(exam: Examination) -> Iterator[Finding]:
    """U5: MuJoCo's run ends on another assembly branch than the exact one."""
    one, recording = exam.branch, exam.recording
    loose = {name for each in exam.undriven for name in (each.equality, *each.others)}
    if one is not None and not loose.isdisjoint(one.equalities):
        return  # what falls where nothing drives it comes to many a branch (A8)
    if one is None or recording is None or recording.end.how == "diverged" or starved(exam):
        return  # the motion of a run that blows up, or of forces that nobody solved for, is on no branch
    said = (
        f"MuJoCo's run leaves the branch of the exact motion at t = {one.since_s:.4g} s and goes on along another one"
    )
    if one.line_s is not None:
        said = (
            f"at t = {one.line_s:.4g} s its links come into line, where two branches cross and nothing but what pushes "
            f"there decides along which of them the loop goes on; {said}"
        )
        by = "a second link, not in line with the first there, or a range that ends before"
        said += f"; {one.coupling.written} in <equality> keeps it on that" if one.coupling else ""
        said += f"; elsewhere {by} is there for that"
    else:
        said += f"; at the end of the run they are {one.apart:.3g} {one.unit} apart at {called('joint', one.joint)}"
        said += "; with the settings that hold the loop (T1) it stays on that of the exact motion" if one.kept else ""
    names = list(one.equalities)
    figures = {"time_s": one.since_s, "joint": one.joint, "apart": one.apart}
    figures |= {"line_s": one.line_s, "coupling": one.coupling.written if one.coupling else None}
    severity: Severity | None = "note" if one.kept and one.line_s is None else None
    yield found("U5", exam.file, said, element=names[0], severity=severity, also=names[1:], **figures)


def pace(exam: Examination) -> Iterator[Finding]:
    """D8: a step that is too long for the motion, where time stepping opens a loop."""
    one, recording = exam.pace, exam.recording
    if one is None or recording is None or recording.end.how != "finished" or exam.attribution is None:
        return
    if not one.too_fast:
        return
    drifting = {drift.equality for drift in exam.drifts if drift.level == "position" and drift.largest > exam.target}
    blamed = [share.name for share in exam.attribution.shares if share.leading == "stepping" and share.name in drifting]
    if not blamed:
        return
    said = (
        f"{called('joint', one.joint)} turns {one.per_step:.2g} rad a step ({one.rate:.3g} rad/s at "
        f"t = {one.time_s:.4g} s), and a step of {recording.integrator} follows a circle up to {one.bound:.2g} rad: "
        f"too far to keep {in_words(blamed)} closed"
    )
    if one.driver:
        said += f"; {one.driver} gives up to {one.force:.4g} {one.unit}"
    yield found(
        "D8",
        exam.file,
        said,
        element=blamed[0],
        joint=one.joint,
        per_step=one.per_step,
        bound=one.bound,
        rate=one.rate,
        time_s=one.time_s,
        driver=one.driver or None,
        force=one.force if one.driver else None,
        also=blamed[1:],
    )


def stands(exam: Examination) -> bool:
    """Whether no joint of the loops moves in MuJoCo's run."""
    recording, pose = exam.recording, exam.pose
    if recording is None or pose is None or recording.steps < 2 or recording.end.how != "finished":
        return False
    dofs = sorted({dof for number in range(len(pose.loops.groups)) for dof in pose.loops.dofs(number)})
    ways = np.abs(recording.qvel[:, dofs]).sum(axis=0) * recording.timestep_s
    return bool(dofs) and float(ways.max()) <= STILL


def still(exam: Examination) -> Iterator[Finding]:
    """R4: a run in which nothing of the loops moves."""
    if stands(exam):
        yield found("R4", exam.file, "no joint of its loops moves in this run: how they hold in a motion is not seen")


def overdriven(exam: Examination) -> Iterator[Finding]:
    """A5: servos that are told what their loop cannot do."""
    for one in exam.overdriven:
        given, without = (figure(value, one.unit) for value in (one.drift, one.drift_without))
        freedom = "the one degree of freedom" if one.dof == 1 else f"the {one.dof} degrees of freedom"
        how = "stays open" if one.lasts else "opens"
        kept = "any one" if one.dof == 1 else f"any {one.dof}"
        when = "" if one.lasts else f" at t = {one.time_s:.4g} s"
        said = (
            f"{how} by {given}{when}, and by at most {without} with {kept} of its {len(one.servos)} servos alone: "
            f"{in_words(list(one.servos))} are told {few(list(one.told), last='and')}, more than {freedom} of the loop "
            f"can follow{_kept(one)}"
        )
        figures = {"drift": one.drift, "drift_without": one.drift_without, "unit": one.unit, "dof": one.dof}
        figures |= {"time_s": one.time_s, "keep": list(one.kept.servos) if one.kept else None}
        yield found("A5", exam.file, said, element=one.equality, also=list(one.others), **figures)


def _kept(one: Overdriven) -> str:
    """What becomes of the one that leads once the others let go, or ask for the same."""
    kept = one.kept
    if kept is None:
        return ""
    same = few([f"{quoted(name)} {control:.3g}" for name, control in kept.controls], last="and")
    return (
        f"; {quoted(kept.joint)} comes to {kept.before + 0.0:.3g} of {kept.told:.3g} {kept.unit}, and with "
        f"{in_words(list(kept.servos))} alone to {kept.after + 0.0:.3g}: remove {in_words(list(kept.others))}, or tell "
        f"{same}"
    )


def lasting(exam: Examination) -> Iterator[Finding]:
    """S4: what stays open for good when the open start has faded."""
    for one in exam.lasting:
        said = f"stays open by {one.left} when the start has faded; {percent(one.share)} of it is "
        said += CAUSE[one.cause].phrase
        if one.attribute:
            said += f'; with {one.attribute}="{one.value}" it is {one.after}'
            said += ", and the start is closed as it is given" if one.attribute == "polycoef" else ""
        severity = None if one.left.largest > VISIBLE else "note"
        after = one.after.largest if one.after is not None else None
        figures = {
            "left": one.left.largest,
            "share": one.share,
            "after": after,
            "value": one.value,
        }
        yield found("S4", exam.file, said, element=one.equality, severity=severity, **figures)


def unfed(exam: Examination) -> Iterator[Finding]:
    """D6: a solver that is not enough for stiff equalities, with what one that is makes of the same run."""
    one = exam.recipe.starved if exam.recipe is not None else None
    if exam.recording is not None and exam.recording.end.how == "diverged":
        yield from _lasts_fed(exam)
        return
    if one is None or starved(exam):  # which D6 says already, of the run as it is
        return
    given = Solving.of(exam.model)
    fed = one.fed.setting.solving
    said = (
        f"{given} is too little for stiff equalities: '{one.given.label}' at {one.given.setting.timestep_s:g} s gives "
        f"{held(one.given)}, and {held(one.fed)} with {fed}"
    )
    drift = one.given.drift if math.isfinite(one.given.drift) else None
    yield found("D6", exam.file, said, iterations=given.iterations, drift_before=drift, drift=one.fed.drift)


def _lasts_fed(exam: Examination) -> Iterator[Finding]:
    """D6 of a run that diverges, and does not with a solver that is enough."""
    given = Solving.of(exam.model)
    for one in exam.without:
        if one.cause == "solver" and one.left:
            worst = max(one.left.values(), key=lambda opening: opening.largest)
            said = (
                f"{given} is too little: the run diverges, and with {given.enough} it stays finite, and "
                f"{quoted(worst.equality)} opens by {worst} at most"
            )
            figures = {"iterations": given.iterations, "drift_before": None, "drift": worst.largest}
            yield found("D6", exam.file, said, element=worst.equality, severity="error", **figures)
