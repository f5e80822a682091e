"""From the figures of a run to findings: why each equality drifts, what the loops cost, what would hold them."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from oarlock.base.errors import few
from oarlock.base.numbers import finite, percent
from oarlock.base.text import quoted
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.lint import locked
from oarlock.diagnosis.lint.view import Remark
from oarlock.diagnosis.loops.gaps import opening
from oarlock.diagnosis.loops.mobility import Mobility
from oarlock.diagnosis.runs.drifts import VISIBLE, Drift
from oarlock.diagnosis.runs.recipe import LOST, Recipe
from oarlock.diagnosis.runs.rotors import Rotors
from oarlock.diagnosis.runs.row_law import Share
from oarlock.diagnosis.runs.solving import Solving
from oarlock.diagnosis.runs.trials import Setting, Trial
from oarlock.diagnosis.runs.without import MOST, Without, starving
from oarlock.diagnosis.verdict.causes import CAUSE, IMPLICIT, Cause
from oarlock.diagnosis.verdict.findings import Finding, Severity, found
from oarlock.mechanics.names import element_name
from oarlock.mechanics.rows import closing_jacobian

SCALE = 3.0
"""Times softer than solimp says: below it the difference is one that a user would not notice."""

UNSURE = 0.25
"""Of the drift at its worst moment: a second cause with so large a part is named too."""

GENTLE = 0.5
"""Of the impedance at the end of a solimp: one that begins lower lets a closed row go."""

SAGS = 1.5
"""Times the largest sum of |f r|: a load that is let go takes f r once, and what overshoots is less than half of it. So
much work is that of a loop that sags, which is compliance, and no motion that fades."""

FEATHER = 0.01
"""Of the median mass of bodies: one of less, with what it carries, has a placeholder for a mass."""

SAME_COST = 0.15
"""Of a cost: less is not worth a word."""

_IMPLICIT = 0.5
"""Of the part of time stepping: the implicit damping behind it is what is named."""

_INSTANTS = 50

_NAMED = 3


def in_words(names: list[str]) -> str:
    """Names in quotes, the first few of them."""
    # "and 1 more" would be longer than the name.
    return few([quoted(name) for name in names], most=_NAMED if len(names) > _NAMED + 1 else _NAMED + 1)


def merged(findings: Iterable[Finding]) -> list[Finding]:
    """Findings with the same line as one, at the first one's element; the other elements are in ``also``."""
    kept: dict[tuple[str, str, str], list[Finding]] = {}
    for one in findings:
        kept.setdefault((one.code, one.severity, one.line), []).append(one)
    return [_with_others(alike[0], [one.element for one in alike[1:]]) for alike in kept.values()]


def _with_others(first: Finding, others: list[str]) -> Finding:
    if not others:
        return first
    line = f"{first.line}; the same of {in_words(others)}"
    return replace(first, line=line, figures={**first.figures, "also": others})


# Why.


def drift(exam: Examination) -> Iterator[Finding]:
    """D1 to D6, one a cause and independent group: of the equality that opens furthest, the others beside it."""
    if exam.attribution is None or exam.recording is None:
        return
    recording, groups = exam.recording, _groups(exam)
    beyond = beyond_repair(exam)
    causes: dict[tuple[str, int], list[tuple[Share, Drift, Part]]] = {}
    for share in exam.attribution.shares:
        worst = position(exam, share.name)
        if worst is None or worst.largest <= exam.target or not math.isfinite(share.worst):
            continue
        if share.name in beyond or share.leading == "start":  # the start has its own finding
            continue
        part = _part(exam, share, worst)
        if part is None:
            continue
        causes.setdefault((part.cause.code, groups.get(share.name, -1)), []).append((share, worst, part))
    for (code, _), members in causes.items():
        share, worst, part = max(members, key=lambda one: abs(one[0].worst))
        said = f"drifts {amount(exam, share)} at t = {share.time_s:.4g} s; {_in_parts(exam, share, part)}"
        also = {one.name: abs(one.worst) for one, *_ in members if one is not share}
        if also:
            said += f"; for the same reason also {in_words(list(also))}"
        if code == "D1":
            said += _gentle(exam, share)
        severity: Severity | None = None if worst.largest > VISIBLE else "note"
        figures = _figures(share, worst) | {"part": part.size} | ({"also": list(also)} if also else {})
        if code == "D1" and exam.rotors is not None and share.name in exam.rotors.left:
            rotors, own = exam.rotors, "a single joint" if len(exam.rotors.joints) == 1 else "single joints"
            said += f"; MuJoCo scales it by the inertia of {own}, {rotors.inertia:.2g} {rotors.unit}: "
            said += with_armature(rotors, share.name)
            figures |= {"armature": exam.rotors.armature, "joints": list(exam.rotors.joints)}
        if because := behind(exam, share.name):
            said += f"; {because}"
            assert exam.behind is not None
            figures |= {
                "behind": exam.behind.suspect.name if exam.behind.suspect else None,
                "behind_part": exam.behind.share,
            }
        yield found(code, exam.file, said, element=share.name, severity=severity, **figures)
        softer = {one.name: float(recording.scale[one.row]) for one, *_ in members if recording.scale[one.row] > SCALE}
        if code == "D1" and softer:
            name = max(softer, key=lambda name: softer[name])
            rest = [other for other in softer if other != name]
            label = next(one.label for one, *_ in members if one.name == name)
            said = f"the row that drifts most, {label}, is {softer[name]:.3g} times softer than solimp says"
            one = found("D5", exam.file, said, element=name, severity=severity, ratio=softer[name])
            yield _with_others(one, rest)


def behind(exam: Examination, equality: str) -> str:
    """What makes most of the drift of an equality, in words; empty where nothing that is named does."""
    one = exam.behind
    if one is None or one.equality != equality or one.suspect is None or one.left is None:
        return ""
    if one.suspect.sort == "limit" and any(each.equality == equality for each in exam.stopped):
        return ""  # of which C5 says more
    of = "it" if one.lasting is None else f"what stays open ({one.lasting})"
    said = f"{percent(one.share)} of {of} is made by {one.suspect.said}: {one.suspect.tried} {one.left} is left"
    if one.wanted is not None:
        said += f", and it goes from {one.wanted[0] + 0.0:.3g} to {one.wanted[1] + 0.0:.3g}"
    if one.factor and one.suspect.sort in ("spring", "damper"):
        said += f", and less than half of it with {one.factor:g} times that"
    if one.armature is not None:
        value, left = one.armature
        said += f', and {left} with armature="{value:g}" on that joint{_light(exam, one.suspect.name)}'
    return said


def _light(exam: Examination, joint: str) -> str:
    """What is said of a body that weighs next to nothing beside the others of its model."""
    model = exam.model
    names = [element_name(model, mujoco.mjtObj.mjOBJ_JOINT, one) for one in range(model.njnt)]
    body = int(model.jnt_bodyid[names.index(joint)])
    mass, others = float(model.body_subtreemass[body]), model.body_mass[1:]
    if mass > FEATHER * float(np.median(others[others > 0.0])):
        return ""
    name = element_name(model, mujoco.mjtObj.mjOBJ_BODY, body)
    return f", or a mass of its body {quoted(name)}, which has {mass:.2g} kg"


def _gentle(exam: Examination, share: Share) -> str:
    """What is said of a solimp that begins far below where it ends, so that a closed row holds next to nothing."""
    assert exam.attribution is not None
    equality = exam.attribution.recording.layout.equalities[_place(exam, share)]
    low, high, width = exam.model.eq_solimp[equality.index, :3].tolist()
    if not low < GENTLE * high:
        return ""
    return f"; its solimp begins at {low:g} and comes to {high:g} only where it is open by {width:g} {equality.unit}"


def with_armature(one: Rotors, equality: str) -> str:
    """What an armature leaves of a coupling whose softness tiny inertias scale."""
    return f'with armature="{one.armature:g}" on {in_words(list(one.joints))} it opens by {one.left[equality]}'


@dataclass(frozen=True)
class Part:
    """What a drift is mostly made of.

    Attributes:
        cause: in words, with its code.
        size: of the whole, 0 to 1: what taking it away saves, or where that is not measured, its part by the row law;
            None where a run without it is not to be had, and the row law does not tell it from others.
        left: what is left without it, in words; empty where that is not measured.
    """

    cause: Cause
    size: float | None
    left: str = ""


def _part(exam: Examination, share: Share, worst: Drift) -> Part | None:
    """None where the row law has time stepping lead, and a run without it shows that most comes from elsewhere."""
    whole = min(1.0, share.shares[share.leading])
    fed = starving(exam.without, share.name, worst.largest)
    if fed is not None:
        with_enough = Solving.of(exam.model).enough
        return Part(
            CAUSE["solver"],
            fed.part(share.name, worst.largest) or 0.0,
            f"with {with_enough} {_left(fed, share)} is left",
        )
    if share.leading != "stepping":
        return Part(CAUSE[share.leading], whole)
    measured = {one.cause: one for one in exam.without}
    stepping, implicit = (
        measured[name].part(share.name, worst.largest) if name in measured else None
        for name in ("stepping", "implicit")
    )
    if implicit is not None and implicit >= max(_IMPLICIT * (whole if stepping is None else stepping), MOST):
        return Part(IMPLICIT, implicit, f"without it {_left(measured['implicit'], share)} is left")
    lost = "implicit" in measured and implicit is None
    if lost and _implicit(exam, _place(exam, share)) >= _IMPLICIT:
        return Part(IMPLICIT, None, "how much of it is not known: without it the run diverges")
    if stepping is None:
        return Part(CAUSE["stepping"], whole)
    second = max((size, cause) for cause, size in share.shares.items() if cause != "stepping")
    if second[0] >= UNSURE and stepping < 1.0 - stepping:  # a shorter step leaves most of it: it is the other's
        return Part(CAUSE[second[1]], 1.0 - stepping)
    if stepping < MOST:
        return None
    return Part(
        CAUSE["stepping"], stepping, f"at a quarter of the timestep {_left(measured['stepping'], share)} is left"
    )


def _left(one: Without, share: Share) -> str:
    return str(one.left[share.name])


def measured_shares(exam: Examination, share: Share) -> dict[str, float]:
    """The parts of a drift by cause, of the whole: by the row law, but where a run without a cause says otherwise.

    What is measured of a cause is its part then, and the others share the rest as the row law has them.
    """
    worst = position(exam, share.name)
    part = None if worst is None else _part(exam, share, worst)
    if part is None or part.size is None:
        return share.shares
    own = next((cause for cause in CAUSE if CAUSE[cause] is part.cause), "stepping")  # of which implicit damping is one
    others = {cause: max(0.0, size) for cause, size in share.shares.items() if cause != own}
    rest, whole = 1.0 - part.size, sum(others.values())
    if not part.left and part.size == min(1.0, share.shares[own]):
        return share.shares
    if not whole:
        others, whole = {cause: float(cause == "compliance") for cause in others}, 1.0
    return {cause: part.size if cause == own else rest * others[cause] / whole for cause in share.shares}


def _in_parts(exam: Examination, share: Share, part: Part) -> str:
    """The parts in a sentence: together no more than the whole, and what opposes it by name only."""
    if part.size is None:
        return f"it is {part.cause.phrase} ({part.left})"
    said = [f"{percent(part.size)} of it is {part.cause.phrase}"]
    if part.cause is CAUSE["solver"] and part.left:  # which the row law takes for time stepping
        return f"{said[0]} ({part.left})"
    known = (part.cause, IMPLICIT if part.cause is CAUSE["stepping"] else CAUSE["stepping"])
    known = known if part.cause in (IMPLICIT, CAUSE["stepping"]) else (part.cause,)
    every = measured_shares(exam, share) if part.left else share.shares
    others = {cause: size for cause, size in every.items() if CAUSE[cause] not in known and abs(size) >= UNSURE}
    rest = 1.0 - part.size
    said += [
        f"{percent(min(size, rest))} {CAUSE[cause].phrase}" for cause, size in others.items() if size > 0.0 and rest
    ]
    against = [CAUSE[cause].phrase for cause, size in others.items() if size < 0.0]
    if against:
        said.append(f"which {' and '.join(against)} {'opposes' if len(against) == 1 else 'oppose'}")
    return ", ".join(said) + (f" ({part.left})" if part.left else "")


def _groups(exam: Examination) -> dict[str, int]:
    return {loop.name: loop.group for loop in exam.pose.loops.loops} if exam.pose else {}


def beyond_repair(exam: Examination) -> set[str]:
    """Equalities whose drift says nothing: of groups that cannot be closed or are torn, and of runs that diverge."""
    groups, found_ = _groups(exam), set()
    if not exam.closed and exam.pose is not None:
        stuck = {groups.get(name) for culprit in exam.pose.culprits for name in culprit.equalities}
        found_ |= {name for name, group in groups.items() if group in stuck or not stuck}
    if exam.recording is not None and exam.recording.end.how == "diverged":
        unstable = {groups.get(one.name) for one in exam.settings if not one.stable}
        # Where no row is unstable by itself, something else blew the run up, and figures of such a run have no cause.
        found_ |= {name for name, group in groups.items() if group in unstable or not unstable}
        if any(one.severity != "note" for one in exam.remarks.get("servo", [])):  # no row makes a servo diverge
            found_ |= set(groups)
    if exam.dead_point is not None:  # torn: all that follows is the motion of another mechanism
        found_ |= set(exam.dead_point.equalities)
    contradict = {groups.get(name) for one in _wrong(exam) for name in (one.element, *one.figures["also"])}
    return found_ | {name for name, group in groups.items() if group in contradict}


def _wrong(exam: Examination) -> list[Remark]:
    """What no stiffness cures: couplings and pins that lock their loops."""
    lints = ("contradictory", "opposed", "pin")
    return [one for lint in lints for one in exam.remarks.get(lint, []) if one.severity is None]


def _figures(share: Share, worst: Drift) -> dict[str, float | str | None]:
    return {
        "drift_m": worst.metres,
        "drift_rad": worst.radians,
        "time_s": share.time_s,
        **{f"share_{cause}": value for cause, value in share.shares.items()},
        "work_j": share.work,
    }


def position(exam: Examination, equality: str) -> Drift | None:
    """The drift of an equality at the level of positions."""
    return next((one for one in exam.drifts if one.equality == equality and one.level == "position"), None)


def _place(exam: Examination, share: Share) -> int:
    assert exam.attribution is not None
    names = [one.name for one in exam.attribution.recording.layout.equalities]
    return names.index(share.name)


def amount(exam: Examination, share: Share) -> str:
    """The worst deviation of an equality in m and rad, for a line."""
    assert exam.attribution is not None
    recording = exam.attribution.recording
    place = _place(exam, share)
    step = int(np.abs(recording.time - share.time_s).argmin())
    rows = recording.position[step, recording.layout.of_equality(place)]
    return str(opening(exam.model, recording.layout.equalities[place], rows))


def _implicit(exam: Examination, place: int) -> float:
    """How much of the part of time stepping is J ((vₙ₊₁ − vₙ)/h − qacc) against the row's spring; rms over the run."""
    recording, attribution = exam.recording, exam.attribution
    assert recording is not None
    assert attribution is not None
    if not recording.holds_force or recording.steps < 2:
        return 0.0
    own = recording.layout.of_equality(place)
    update = np.diff(recording.qvel, axis=0) / recording.timestep_s - recording.qacc[:-1]
    if not np.isfinite(update).all():
        return 0.0
    data = mujoco.MjData(recording.model)
    recording.layout.activate(data)
    spring = recording.stiffness * recording.impedance
    pushed, parts = [], []
    for step in np.unique(np.linspace(0, recording.steps - 2, _INSTANTS).astype(int)):
        data.qpos[:] = recording.qpos[step]
        mujoco.mj_fwdPosition(recording.model, data)
        rows = closing_jacobian(recording.model, data)
        if len(rows) != recording.layout.rows:
            continue
        pushed.append((rows[own] @ update[step]) / np.maximum(spring[step, own], mujoco.mjMINVAL))
        parts.append(attribution.position[-1, step, own])
    total = float(np.linalg.norm(parts)) if parts else 0.0
    return float(np.linalg.norm(pushed)) / total if total else 0.0


def lock(exam: Examination, one: Mobility) -> Severity | None:
    """How bad a lock is; None: as the catalogue has it."""
    assert exam.pose is not None
    return locked.lock(exam.model, exam.pose, one)


def _jammed(exam: Examination) -> bool:
    return exam.pose is not None and any(one.locked and lock(exam, one) is None for one in exam.pose.mobility)


# At what price.


def energy(exam: Examination) -> Iterator[Finding]:
    """E1: what the rows themselves take or give, beyond what they hold back while they stand open under a load."""
    recording, attribution = exam.recording, exam.attribution
    if recording is None or attribution is None or not attribution.shares or recording.end.how == "diverged":
        return
    if exam.dead_point is not None:
        return
    if (
        not exam.closed
        or exam.pose is None
        or not exam.pose.consistent
        or any(one.locked for one in exam.pose.mobility)
    ):
        return  # rows that pull a loop together or hold a lock do work, and that is not the matter with them
    if not recording.holds_force and recording.others_active:
        return  # an impact is a jump, of which the power cannot be told from two sides
    taken, kinetic = float(attribution.work[-1].sum()), float(recording.energy[:, 1].max())
    held_back = float(np.abs(recording.force * recording.position).sum(axis=1).max())
    if kinetic <= 0.0 or abs(taken) <= max(LOST * kinetic, SAGS * held_back):
        return
    most = max(attribution.shares, key=lambda share: abs(share.work))
    said = f"the loops {'take' if taken < 0 else 'add'} {abs(taken):.3g} J of a kinetic energy of up to {kinetic:.3g} J"
    if len(attribution.shares) > 1:
        said += f", {quoted(most.name)} {abs(most.work):.3g} J of it"
    error = float(recording.energy_error[-1])
    figures = {"work_j": taken, "kinetic_j": kinetic, "energy_error_j": error}
    open_ = any(one.level == "position" and one.largest > VISIBLE for one in exam.drifts)
    severity: Severity | None = None if open_ else "note"  # of loops that hold, their energy is not what is the matter
    yield found("E1", exam.file, said, element=most.name, severity=severity, **figures)


# What to do.


def remedy(exam: Examination) -> Iterator[Finding]:
    """T1, T3 or T5."""
    recipe = exam.recipe
    if recipe is None or recipe.outcome == "holds":
        return
    # From disturbed starts too: they may be what asks for other settings.
    authored = [trial for trial in recipe.trials if trial.setting == Setting.authored(exam.model)]
    before = max([recipe.authored, *authored], key=lambda trial: trial.drift)
    after = max([recipe.chosen, *recipe.verified], key=lambda trial: trial.drift)
    chosen = recipe.chosen
    figures = {
        "target": recipe.target,
        "drift_before": finite(before.drift),
        "drift": finite(after.drift),
        "cost": chosen.cost,
        "energy_error_before_j": finite(recipe.authored.energy_error),
        "energy_error_j": finite(chosen.energy_error),
    }
    if recipe.outcome == "undecided":
        said = f"not decided whether {recipe.target:g} can be held: {recipe.reason}"
        yield found("T5", exam.file, said, **figures)
        return
    if not recipe.reached:
        best = f", at best {held(after)}" if chosen.drift > recipe.target else " from every start"
        said = f"the target of {recipe.target:g} is not reached{best}: {recipe.reason}"
        yield found("T3", exam.file, said, element=after.equality.name, **figures)
        return
    whence = "" if before.start == recipe.authored.start else ", from a disturbed start"
    if exam.pose is not None and not exam.pose.consistent and not whence:
        whence = ", both from the closed start and not from the open one that is given (S1)"
    parts = [f"no loop opens by more than {held(after)} in place of {held(before)}{whence}"]
    if recipe.authored.end.how == "finished" and np.isfinite(chosen.energy_error):
        parts.append(f"energy error {chosen.energy_error:.2g} J in place of {recipe.authored.energy_error:.2g} J")
    parts.append(f"at {_cost(chosen)}")
    said = f"{recipe.reason}: {', '.join(parts)}"
    if coarser := _alone(recipe):
        said += f"; its own start alone is held with {coarser.setting.timestep_s:g} s, {held(coarser)}"
    if recipe.conserving is not None:
        least = recipe.conserving
        said += f"; {least.label} leaves an energy error of {least.energy_error:.2g} J, at {_cost(least)}"
    if recipe.untried:
        said += f"; {recipe.untried}"
    if _jammed(exam):
        said += "; what is locked (S3) then stands still"
    elif codes := sorted({one.code for one in _wrong(exam)}):
        said += f"; what contradicts itself ({few(codes)}) then stands still"
    yield found("T1", exam.file, said, **figures)


def _alone(recipe: Recipe) -> Trial | None:
    """A cheaper trial that holds, but not from the disturbed starts."""
    enough = [
        trial
        for trial in recipe.trials
        if trial.start == recipe.chosen.start
        and trial.setting.integrator == recipe.chosen.setting.integrator
        and trial.setting.timestep_s > recipe.chosen.setting.timestep_s
        and trial.drift <= recipe.target
    ]
    return max(enough, key=lambda trial: trial.setting.timestep_s, default=None)


def _cost(trial: Trial) -> str:
    cost = trial.cost or 1.0
    return "the same cost" if abs(cost - 1.0) <= SAME_COST else f"{cost:.2g} times the cost"


def held(trial: Trial) -> str:
    """The drift of a trial, for a line."""
    return f"{trial.drift:.2g} {trial.unit}" if math.isfinite(trial.drift) else "a run that diverges"


def above(exam: Examination, bound: float) -> Iterator[Finding]:
    """D7: whatever exceeds the user's own bound, or cannot be shown to keep it; what drifts furthest comes first."""
    expected = f"expected at most {bound:g} (m, rad)"
    for one in sorted(exam.drifts, key=lambda one: one.largest if one.largest == one.largest else np.inf, reverse=True):
        if one.level == "position" and not one.largest <= bound:
            parts = [(one.metres, "m", one.metres_s), (one.radians, "rad", one.radians_s)]
            beyond = [
                (f"{value:.3g} {unit}", time) for value, unit, time in parts if value is not None and value > bound
            ]
            said = " and ".join(f"{value} at t = {time:.4g} s" for value, time in beyond)
            line = f"drifts {said or f'beyond all numbers at t = {one.time_s:.4g} s'}, {expected}"
            yield found("D7", exam.file, line, element=one.equality, drift=finite(one.largest), bound=bound)
    if exam.recording is None:
        yield found(
            "D7", exam.file, f"there is no run to measure: {exam.missing.get('run', '')}, {expected}", bound=bound
        )
    elif exam.recording.end.how == "diverged":
        yield found("D7", exam.file, f"the run diverges, {expected}", bound=bound)
