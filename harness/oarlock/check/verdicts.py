"""From figures to findings: what an examination amounts to, each with its place and its figures.

What a code means and how it is measured stands in ``findings.toml``; the bounds that decide are here.
"""

import math
from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.check.drifts import Drift
from oarlock.check.examination import Examination
from oarlock.check.findings import Finding, found, worst_first
from oarlock.check.gaps import opening
from oarlock.check.recipe import LOST
from oarlock.check.row_law import Share
from oarlock.check.trials import Trial
from oarlock.check.walking import dense_jacobian
from oarlock.mechanism import element_name

SCALE = 3.0
"""Times softer than solimp says: below it the difference is one that a user would not notice."""

UNSURE = 0.25
"""Of the drift at its worst moment: a second cause with so large a part is named too."""

_IMPLICIT = 0.5
"""Of the part of time stepping: the implicit damping behind it is what is named."""

MEANT = 0.05
"""Smallest singular value of a group that is locked, of the largest: above it no small error locked it."""

_INSTANTS = 50

_WORDS = {
    "compliance": ("D1", "softness"),
    "curvature": ("D2", "missing J̇v"),
    "stepping": ("D3", "time stepping"),
    "solver": ("D6", "what the solver left"),
    "start": ("S1", "the open start"),
}


def judge(examination: Examination, fail_above: float | None = None) -> list[Finding]:
    """All findings of the parts that are there, the worst first.

    Args:
        examination: as far as it has come.
        fail_above: bound on every equality's drift, m or rad; exceeding it is the error D7.
    """
    parts = (_loops, _start, _settings, _run, _drift, _energy, _remedy, _reactions, _motion)
    findings = [finding for part in parts for finding in part(examination)]
    if fail_above is not None:
        findings += _above(examination, fail_above)
    return worst_first(findings)


def _loops(exam: Examination) -> Iterator[Finding]:
    model, file = exam.model, exam.file
    data = mujoco.MjData(model)
    off = bool(model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    for index in np.flatnonzero(~data.eq_active.astype(bool) | off):
        name = element_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, int(index))
        yield found("L6", file, "it is switched off: nothing here counts it", element=name)
    if exam.pose is None:
        return
    loops = exam.pose.loops
    removable = [loop.name for loop in loops.loops if loop.removable]
    if len(removable) == len(loops.loops) > 1:
        yield found("L2", file, f"any one of the {len(removable)} equalities could be left out", rows=loops.rows)
    for loop in loops.loops:
        if loop.zero_rows:
            rows = ", ".join(loop.zero_rows)
            yield found("L3", file, f"{rows} of its {len(loop.rows)} rows hold nothing here", element=loop.name)
    for group in loops.groups:
        for one in group.dependencies:
            names = " and ".join(f"'{name}'" for name in one.equalities)
            rows = ", ".join(str(row) for row, _ in one.rows)
            if one.proportional:
                yield found("L4", file, f"{rows} say the same", element=one.equalities[0])
            elif len(one.equalities) > 1:
                yield found("L7", file, f"rows of {names} depend on one another: {rows}", element=one.equalities[0])
    for loop in loops.loops:
        if loop.removable and len(removable) < len(loops.loops):
            yield found("L7", file, "the mechanism moves the same way without it", element=loop.name)


def _start(exam: Examination) -> Iterator[Finding]:
    pose, file = exam.pose, exam.file
    if pose is None:
        return
    if not pose.closed:
        tilted = [f"the axis of '{one.joint}' is tilted by {one.radians:.3g} rad" for one in pose.tilts]
        for culprit in pose.culprits:
            said = "; ".join([str(culprit), *tilted])
            yield found("S2", file, said, element=culprit.equalities[0], gap=max(o.largest for o in culprit.openings))
        if not pose.culprits:
            worst = max(pose.left, key=lambda one: one.largest)
            yield found("S2", file, "; ".join([f"stays open by {worst}", *tilted]), element=worst.equality)
        return
    for one in pose.mobility:
        if one.locked:
            tilts = [f"the axis of '{tilt.joint}' is tilted by {tilt.radians:.3g} rad" for tilt in pose.tilts]
            frees = [f"it moves without {' or '.join(repr(name) for name in one.frees)}"] if one.frees else []
            said = "; ".join(["closed, and nothing of it can move", *tilts, *frees])
            # Rows that hold everything there is to move, and far from redundant: a lock that is meant.
            meant = not pose.tilts and one.kept > MEANT
            severity = "note" if meant else None
            yield found("S3", file, said, element=one.equalities[0], severity=severity, dof=one.dof, kept=one.kept)
    if pose.consistent:
        return
    worst = max(pose.openings, key=lambda one: one.largest)
    fastest = max(pose.speeds, key=lambda one: one.largest)
    if worst.largest > 0.0:
        moves = f"the nearest closed pose moves '{pose.moved_joint}' by {pose.moved:.3g}"
        said = f"stands open by {worst} at the start; {moves}"
        yield found("S1", file, said, element=worst.equality, opening=worst.largest, moved=pose.moved)
    else:
        said = f"comes apart at {fastest} per s at the start"
        yield found("S1", file, said, element=fastest.equality, speed=fastest.largest)


def _settings(exam: Examination) -> Iterator[Finding]:
    for one in exam.settings:
        if not one.stable:
            said = f"h²K d + 2hB = {one.number:.3g} under {one.integrator}: a step multiplies it by {one.growth:.3g}"
            yield found("T2", exam.file, said, element=one.name, number=one.number, growth=one.growth)
        given, used = one.settings.given, one.settings.effective
        if given != used:
            said = (
                f"solref {given[0]:g} {given[1]:g} is taken as {used[0]:g} {used[1]:g}, for h = {exam.timestep_s:g} s"
            )
            yield found("T4", exam.file, said, element=one.name, given=given[0], used=used[0])
    newton = exam.model.opt.solver == mujoco.mjtSolver.mjSOL_NEWTON
    if newton and mujoco.mj_isSparse(exam.model) and mujoco.__version__ == "4.0.0":
        yield found("V2", exam.file, f"{exam.model.nv} degrees of freedom: the Jacobian is sparse")


def _run(exam: Examination) -> Iterator[Finding]:
    recording = exam.recording
    if recording is None:
        return
    if recording.end.how == "diverged":
        yield found("R1", exam.file, recording.end.message, time_s=recording.end.time_s)
    if recording.others_active is not None:
        first, last = recording.others_active
        said = f"between t = {first:.4g} and {last:.4g} s"
        if exam.exact is not None and exam.exact.end.how == "refused":
            said += f"; the exact run ends at {exam.exact.end.time_s:.4g} s: {exam.exact.end.message}"
        yield found("R2", exam.file, said, first_s=first, last_s=last)


def _drift(exam: Examination) -> Iterator[Finding]:
    if exam.attribution is None or exam.recording is None:
        return
    attribution, scale = exam.attribution, exam.recording.scale
    for place, share in enumerate(attribution.shares):
        worst = _position(exam, share.name)
        if worst is None or worst.largest <= exam.wish.target or not math.isfinite(share.worst):
            continue
        code, words = _WORDS[share.leading]
        if share.leading == "stepping" and _implicit(exam, place) >= _IMPLICIT:
            code, words = "D4", "implicit damping"
        others = [
            f"{percent(part)} {_WORDS[cause][1]}"
            for cause, part in share.shares.items()
            if cause != share.leading and abs(part) >= UNSURE
        ]
        most = f"{percent(share.shares[share.leading])} of it is {words}"
        said = ", ".join([f"drifts {amount(exam, share)} at t = {share.time_s:.4g} s; {most}", *others])
        if code != "S1":  # the start has its own finding
            yield found(code, exam.file, said, element=share.name, severity=None, **_figures(share, worst))
        ratios = scale[exam.recording.layout.of_equality(place)]
        ratio = float(np.nanmax(ratios, initial=0.0))
        if share.leading == "compliance" and ratio > SCALE:
            said = f"a row is {ratio:.3g} times softer than solimp says"
            yield found("D5", exam.file, said, element=share.name, ratio=ratio)


def _figures(share: Share, worst: Drift) -> dict[str, float | str | None]:
    return {
        "drift_m": worst.metres,
        "drift_rad": worst.radians,
        "time_s": share.time_s,
        **{f"share_{cause}": value for cause, value in share.shares.items()},
        "work_j": share.work,
    }


def _position(exam: Examination, equality: str) -> Drift | None:
    return next((one for one in exam.drifts if one.equality == equality and one.level == "position"), None)


def amount(exam: Examination, share: Share) -> str:
    """The worst deviation of an equality in m and rad, for a line."""
    recording = exam.recording
    assert recording is not None
    place = next(index for index, one in enumerate(recording.layout.equalities) if one.name == share.name)
    step = int(np.abs(recording.time - share.time_s).argmin())
    rows = recording.position[step, recording.layout.of_equality(place)]
    return str(opening(exam.model, recording.layout.equalities[place], rows))


def percent(share: float) -> str:
    """A share in percent."""
    return f"{100.0 * share:.0f} %"


def _implicit(exam: Examination, place: int) -> float:
    """How much of the part of time stepping is J ((vₙ₊₁ − vₙ)/h − qacc) against the row's spring; rms over the run."""
    recording, attribution = exam.recording, exam.attribution
    assert recording is not None
    assert attribution is not None
    if recording.integrator == "rk4" or recording.steps < 2:
        return 0.0
    own = recording.layout.of_equality(place)
    update = np.diff(recording.qvel, axis=0) / recording.timestep_s - recording.qacc[:-1]
    if not np.isfinite(update).all():
        return 0.0
    data = mujoco.MjData(recording.model)
    spring = recording.stiffness * recording.impedance
    pushed, parts = [], []
    for step in np.unique(np.linspace(0, recording.steps - 2, _INSTANTS).astype(int)):
        data.qpos[:] = recording.qpos[step]
        mujoco.mj_fwdPosition(recording.model, data)
        rows = dense_jacobian(recording.model, data)[: data.ne]
        if len(rows) != recording.layout.rows:
            continue
        pushed.append((rows[own] @ update[step]) / np.maximum(spring[step, own], mujoco.mjMINVAL))
        parts.append(attribution.position[-1, step, own])
    total = float(np.linalg.norm(parts)) if parts else 0.0
    return float(np.linalg.norm(pushed)) / total if total else 0.0


def _energy(exam: Examination) -> Iterator[Finding]:
    recording, attribution = exam.recording, exam.attribution
    if recording is None or not recording.steps or recording.end.how == "diverged" or recording.others_active:
        return  # an impact is a jump, of which the power cannot be told from two sides
    lost, kinetic = float(recording.energy_error[-1]), float(recording.energy[:, 1].max())
    if kinetic <= 0.0 or abs(lost) <= LOST * kinetic:
        return
    said = f"{abs(lost):.3g} J {'lost' if lost < 0 else 'gained'} of a kinetic energy of up to {kinetic:.3g} J"
    element, work = "", None
    if attribution is not None and len(attribution.shares):
        most = max(attribution.shares, key=lambda share: abs(share.work))
        element, work = most.name, most.work
        said += f"; the work of '{most.name}' is {most.work:.3g} J"
    yield found("E1", exam.file, said, element=element, energy_error_j=lost, kinetic_j=kinetic, work_j=work)


def _remedy(exam: Examination) -> Iterator[Finding]:
    recipe = exam.recipe
    if recipe is None or recipe.outcome == "holds":
        return
    chosen = recipe.chosen
    figures = {
        "target": recipe.target,
        "drift_before": _finite(recipe.authored.drift),
        "drift": _finite(chosen.drift),
        "cost": chosen.cost,
        "energy_error_before_j": _finite(recipe.authored.energy_error),
        "energy_error_j": _finite(chosen.energy_error),
    }
    if recipe.reached:
        said = (
            f"{recipe.reason}: {held(chosen)} in place of {held(recipe.authored)}, at {chosen.cost:.2g} times the cost"
        )
        yield found("T1", exam.file, said, element="", severity=None, **figures)
    else:
        said = f"the target of {recipe.target:g} is not reached, at best {held(chosen)}: {recipe.reason}"
        yield found("T3", exam.file, said, element=chosen.row, severity=None, **figures)


def held(trial: Trial) -> str:
    """The drift of a trial, for a line."""
    return f"{trial.drift:.2g} {trial.unit}" if math.isfinite(trial.drift) else "a run that diverges"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _reactions(exam: Examination) -> Iterator[Finding]:
    if exam.reactions is None:
        return
    together = {name for one in exam.reactions.together if one.unique for name in one.names}
    for one in exam.reactions.equalities:
        if one.unique:
            continue
        parts = [("force", one.force), ("torque", one.torque)]
        said = [f"its {name} is {part}" for name, part in parts if part is not None and part.free]
        if one.coupled is False:
            said = ["its multiplier is not unique"]
        if together & set(one.names):
            said.append("the sum with those between the same bodies is unique")
        yield found("U1", exam.file, "; ".join(said), element=one.names[0], verdict=one.verdict)


def _motion(exam: Examination) -> Iterator[Finding]:
    if exam.history is None:
        return
    singular = [event for event in exam.history.events if event.kind == "singular"]
    for event in singular[:1]:
        more = f" and {len(singular) - 1} more times" if len(singular) > 1 else ""
        said = f"rank {exam.history.rank} falls to {event.rank} at t = {event.time_s:.6g} s{more}"
        times = ", ".join(f"{one.time_s:.6g}" for one in singular)
        yield found("L5", exam.file, said, element=", ".join(event.equalities), times_s=times)
    near = [event for event in exam.history.events if event.kind == "near"]
    for event in near[:1]:
        said = f"at t = {event.time_s:.4g} s the smallest singular value falls to {event.smallest:.2g} of its median"
        yield found("U2", exam.file, said, element=", ".join(event.equalities), smallest=event.smallest)


def _above(exam: Examination, bound: float) -> Iterator[Finding]:
    for one in exam.drifts:
        if one.level == "position" and not one.largest <= bound:
            said = f"drifts {one.largest:.3g} at t = {one.time_s:.4g} s, expected at most {bound:g}"
            yield found("D7", exam.file, said, element=one.equality, drift=_finite(one.largest), bound=bound)
    if exam.recording is not None and exam.recording.end.how == "diverged":
        yield found("D7", exam.file, f"the run diverges, expected a drift of at most {bound:g}", bound=bound)
