"""From figures to findings: what an examination amounts to, each with its place and its figures.

What a code means and how it is measured stands in ``findings.toml``; the bounds that decide are here and, for all that
a run shows, in ``blame``.
"""

from collections.abc import Iterable, Iterator, Sequence

import mujoco
import numpy as np

from oarlock.base.errors import few
from oarlock.base.numbers import figure, percent
from oarlock.base.text import called, quoted
from oarlock.cases.integrators import INTEGRATORS
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.lint.servo import UNSTABLE
from oarlock.diagnosis.loops.loops import Dependency, Group
from oarlock.diagnosis.runs.parted import Parted
from oarlock.diagnosis.runs.pushes import Push
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.stability import EqualityStability
from oarlock.diagnosis.verdict import blame, blown, motions, ranks, start, unmoved
from oarlock.diagnosis.verdict.blame import in_words, merged
from oarlock.diagnosis.verdict.cost import named, priced, withheld
from oarlock.diagnosis.verdict.findings import Finding, Severity, found, worst_first
from oarlock.mechanics import newton
from oarlock.mechanics.inequalities import may_act
from oarlock.mechanics.load import collected_warnings, takes_degrees
from oarlock.mechanics.names import element_name

_PAIRS = 3
"""So many pairs of rows that say the same are named."""

_TURN = 2.0 * np.pi
"""rad. Ranges of hinges that are written in radians are shorter."""

_EQUALITY = mujoco.mjtObj.mjOBJ_EQUALITY

_OFF = {
    '<flag equality="disable"/>': int(mujoco.mjtDisableBit.mjDSBL_EQUALITY),
    '<flag constraint="disable"/>': int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT),
}
"""What switches all equalities off."""


def judge(examination: Examination, fail_above: float | None = None) -> list[Finding]:
    """All findings of the parts that are there, the worst first.

    Equalities of which the same is to be said share a finding: it stands at one of them, and figure ``also`` has the
    others.

    Args:
        examination: as far as it has come.
        fail_above: bound on every equality's drift, m or rad; exceeding it is the error D7.
    """
    parts = (
        _lint,
        motions.dead_point,
        motions.branch,
        start.start,
        motions.lasting,
        _settings,
        _run,
        motions.still,
        motions.pace,
        motions.overdriven,
        unmoved.stuck,
        unmoved.targets,
        unmoved.undriven,
        unmoved.leverless,
        unmoved.missed,
        unmoved.throttled,
        unmoved.slips,
        unmoved.clipped,
        blame.drift,
        motions.unfed,
        blame.energy,
        blame.remedy,
        ranks.flips,
        _motion,
        _reactions,
        _loops,
    )
    findings = [finding for part in parts for finding in merged(_unsaid(examination, part(examination)))]
    if fail_above is not None:
        findings += blame.above(examination, fail_above)
    ordered = worst_first(priced(examination, findings))
    examination.withheld = withheld(ordered)
    return [one for one in ordered if one.code != "T1" or not examination.withheld]


# What is seen without a run.

_SAID = {
    "L9": ("S3",),
    "L10": ("S3",),
    "L12": ("L3",),
    "A2": ("S4", "C5", "S2"),
    "S7": ("S3", "S4"),
    "S5": ("S1", "S6"),
}
"""Code of a remark → those of findings which say the same of its equality, only less of it, or what comes of it."""


def _lint(exam: Examination) -> Iterator[Finding]:
    for remark in (one for remarks in exam.remarks.values() for one in remarks):
        line, severity, figures = remark.line, remark.severity, remark.figures
        if remark.code == "A1" and severity is None and exam.recording is not None:
            line, severity = _shaking(exam.recording, line)
        if remark.code in ("A4", "A7") and exam.recording is not None and exam.recording.end.how == "diverged":
            severity = "error"
        yield found(remark.code, exam.file, line, element=remark.element, severity=severity, **figures)


def _shaking(recording: Recording, line: str) -> tuple[str, Severity | None]:
    """A servo that a step at the start does not bear, and what became of it: no error where the run stays finite.

    Then the loops or the poses that follow hold it, and what a step at the start says of its cures may not be so.
    """
    if recording.end.how == "diverged":
        return line.replace(UNSTABLE, "the run diverges", 1), None
    bounds = line.partition("; stable with ")[0]
    return bounds.replace(UNSTABLE, f"{UNSTABLE} at the start, and this run stays finite", 1), "warning"


def _unsaid(exam: Examination, findings: Iterable[Finding]) -> Iterator[Finding]:
    """Findings but those of which a lint said the cause."""
    said = {
        (code, name)
        for remarks in exam.remarks.values()
        for one in remarks
        for code in _SAID.get(one.code, ())
        for name in (one.element, *one.figures.get("also", ()), *one.figures.get("loops", ()))
    }
    for one in findings:
        if (one.code, one.element) not in said:
            yield one


# The loops.


def _loops(exam: Examination) -> Iterator[Finding]:
    model, file = exam.model, exam.file
    data = mujoco.MjData(model)
    flag = next((name for name, bit in _OFF.items() if model.opt.disableflags & bit), "")
    idle = [int(index) for index in np.flatnonzero(~data.eq_active.astype(bool) | bool(flag))]
    for index in idle:
        own = "" if data.eq_active[index] else 'active="false"'
        by = " and ".join(part for part in (own, flag) if part)
        name = element_name(model, _EQUALITY, index)
        apart = next((one for one in exam.parted if one.equality == name and own and not flag), None)
        if apart is None:
            yield found("L6", file, f"is switched off by {by}: nothing here counts it", element=name)
        else:
            yield _parted(file, apart)
    if flag or not _rows(exam):
        yield found("L1", file, _no_row(model, idle, flag), equalities=model.neq)
        return
    if exam.pose is None:
        return
    loops = exam.pose.loops
    for loop in loops.loops:
        if loop.zero_rows:
            planar = loops.groups[loop.group].shape == "planar"
            yield found("L3", file, _zero(loop.zero_rows, len(loop.rows), planar), element=loop.name)
    if not loops.closed:  # what rows have in common at a pose where they contradict one another means nothing
        return
    removable = [loop.name for loop in loops.loops if loop.removable]
    every = len(removable) == len(loops.loops) > 1
    if every:
        said = f"any one of the {len(removable)} equalities could be left out, with the others in place"
        yield found("L2", file, said, equalities=len(removable), rows=loops.rows, rank=loops.rank)
    for number, group in enumerate(loops.groups):
        pairs = [one for one in group.dependencies if one.proportional]
        if pairs:
            said = ", ".join(" as ".join(str(row) for row, _ in one.rows) for one in pairs[:_PAIRS])
            more = f", and {len(pairs) - _PAIRS} more pairs" if len(pairs) > _PAIRS else ""
            yield found(
                "L4", file, f"the same is said by {said}{more}", element=pairs[0].equalities[0], pairs=len(pairs)
            )
        if every:
            continue
        own = [loop.name for loop in loops.loops if loop.group == number and loop.removable]
        stuck = any(one.locked and one.equalities == group.equalities for one in exam.pose.mobility)
        if own and not stuck:  # what rows do not hold at a pose may hold all around it, and lock it there (S3)
            one_of = f"; so could be {in_words(own[1:])}, one at a time" if own[1:] else ""
            said = f"could be left out, and the mechanism would move the same way{one_of}"
            yield found("L7", file, said, element=own[0], also=own[1:])
        yield from _dependent(exam, group, set(own))


def _rows(exam: Examination) -> bool:
    """Whether some row of an equality holds anything."""
    if exam.pose is not None:
        return exam.pose.loops.rank > 0
    data = mujoco.MjData(exam.model)
    data.qpos[:] = exam.qpos
    with collected_warnings():  # what MuJoCo's memory does not suffice for, the run tells
        mujoco.mj_fwdPosition(exam.model, data)
    return data.ne > 0  # MuJoCo leaves out an equality whose rows are zero


def _parted(file: str, apart: Parted) -> Finding:
    wide, held = apart.opening, apart.held
    said = (
        f'is switched off by active="false": its sides, together at the start, part by {wide} at t = {apart.at_s:.4g} s'
    )
    if held is not None:
        said += f"; switched on it opens by at most {held}"
    figures = {"apart_m": wide.metres, "apart_rad": wide.radians, "time_s": apart.at_s}
    return found("L6", file, said, element=wide.equality, severity="warning", **figures)


def _no_row(model: mujoco.MjModel, idle: Sequence[int], flag: str) -> str:
    """Why no equality has a row, by those that are switched off and the flag that does it."""
    if not model.neq:
        return "the model has no equality"
    names = [quoted(element_name(model, _EQUALITY, index)) for index in range(model.neq)]
    one = model.neq == 1
    which = f"the only equality, {names[0]}," if one else f"all {model.neq} equalities, {few(names, last='and')},"
    if flag:
        return f"{which} {'is' if one else 'are'} switched off by {flag}: leave that out of <option>"
    if len(idle) == model.neq:
        return (
            f'{which} {"is" if one else "are"} switched off by active="false": write active="true" where it is to count'
        )
    said = f"no row of {which} holds anything"
    return f"{said}; {len(idle)} of them {'is' if len(idle) == 1 else 'are'} switched off" if idle else said


def _zero(rows: tuple[str, ...], count: int, planar: bool) -> str:
    if len(rows) == count:
        return "none of its rows holds anything here"
    plane = ", across the plane of its loop" if planar and len(rows) == 1 else ""
    holds = f"its row {rows[0]} holds" if len(rows) == 1 else f"its rows {', '.join(rows)} hold"
    return f"{holds} nothing{plane}"


def _dependent(exam: Examination, group: Group, removable: set[str]) -> Iterator[Finding]:
    """Rows that follow from several others, where that is not a matter of a whole equality that could go."""
    ones: list[Dependency] = [
        one
        for one in group.dependencies
        if not one.proportional and len(one.equalities) > 1 and not removable & set(one.equalities)
    ]
    if ones:
        names = list(dict.fromkeys(name for one in ones for name in one.equalities))
        rows = "one of the rows" if len(ones) == 1 else f"{len(ones)} of the rows"
        said = f"{rows} of {in_words(names)} {'follows' if len(ones) == 1 else 'follow'} from the others"
        yield found("L7", exam.file, said, element=names[0], also=names[1:], rows=len(ones))


# The settings and the run.


def _settings(exam: Examination) -> Iterator[Finding]:
    diverged = exam.recording is None or exam.recording.end.how == "diverged"
    for one in exam.settings:
        if not one.stable:
            said = f"a step multiplies its deviation by {one.growth:.3g}: {_limit(one)}"
            if not diverged:
                said += "; this run stays finite, for its softness damps"
            severity: Severity | None = None if diverged else "warning"
            figures = {"number": one.number, "growth": one.growth}
            yield found("T2", exam.file, said, element=one.name, severity=severity, **figures)
        given, used = one.settings.given, one.settings.effective
        if given != used:
            mixed = (given[0] > 0.0) != (given[1] > 0.0)
            why = "for its signs are mixed" if mixed else f"for it is below 2 h = {2 * exam.timestep_s:g} s"
            said = f"solref {given[0]:g} {given[1]:g} is taken as {used[0]:g} {used[1]:g}, {why}"
            yield found("T4", exam.file, said, element=one.name, given=given[0], used=used[0])
    if newton.is_doubtful(exam.model):
        said = f"{exam.model.nv} degrees of freedom: the Jacobian is sparse"
        if may_act(exam.model):
            yield found("V2", exam.file, f"{said}, and where limits, friction or contacts act the factor is not known")
        elif newton.errs(exam.model, exam.qpos, exam.qvel):
            yield found("V2", exam.file, f"{said}, and the answer at the start is no minimum")


def _limit(one: EqualityStability) -> str:
    if not INTEGRATORS[one.integrator].holds_force:
        h = one.settings.timestep_s
        return f"h²K = {h * h * one.settings.spring:.3g} and hB = {h * one.settings.damping:.3g} under {one.integrator}"
    return f"h²K + 2hB = {one.number:.3g} under {one.integrator}, stable below 4"


def _run(exam: Examination) -> Iterator[Finding]:
    recording = exam.recording
    if recording is None:
        return
    if recording.end.how == "diverged":
        said = "; ".join([recording.end.message, *blown.reasons(exam)])
        yield found("R1", exam.file, said, time_s=recording.end.time_s)
    if astray := recording.astray:
        yield found("R3", exam.file, astray, strayed=recording.strayed)
    if recording.pushes:
        first = min(push.first_s for push in recording.pushes)
        last = max(push.last_s for push in recording.pushes)
        said = f"in MuJoCo's run {_pushes(recording.pushes)}"
        if exam.model.opt.noslip_iterations:
            said += "; noslip changes MuJoCo's forces after its solver, and not those of the exact solution"
        yield found("R2", exam.file, said, first_s=first, last_s=last)
    yield from _fights(exam)


def _pushes(pushes: tuple[Push, ...]) -> str:
    """The strongest of each kind, with the number of the others."""
    said = []
    for kind in ("limit", "friction", "contact"):
        own = sorted((push for push in pushes if push.kind == kind), key=lambda push: -push.largest)
        if own:
            unit = own[0].unit
            more = f" and {len(own) - 1} more" if len(own) > 1 else ""
            first = min(push.first_s for push in own)
            said.append(f"{own[0].name}{more} from t = {first:.4g} s, up to {own[0].largest:.4g} {unit}")
    return "; ".join(said)


def _fights(exam: Examination) -> Iterator[Finding]:
    """What limits, contacts and friction do to the loops."""
    if exam.fight is not None:
        fight = exam.fight
        said = (
            f"{few(list(fight.others), last='')} push{'es' if len(fight.others) == 1 else ''} against "
            f"{in_words(list(fight.equalities))} alone in the exact run, since t = {fight.first_s:.4g} s, with up to "
            f"{fight.largest:.4g} {fight.unit}"
        )
        yield found("C1", exam.file, said, first_s=fight.first_s, largest=fight.largest)
    yield from _stopped(exam)
    for lag in exam.lags:
        joints = in_words(list(lag.joints))
        said = (
            f"stays open by {lag.given:.4g} {lag.unit}, by {lag.without:.3g} {lag.unit} without the friction loss of "
            f"{joints}, which holds in {percent(lag.stuck)} of the steps"
        )
        figures = {"given": lag.given, "without": lag.without, "unit": lag.unit}
        yield found("C2", exam.file, said, element=lag.equality, **figures)
    # With such an offset the closed start is another one; and of ranges that do not meet more is said already.
    if exam.stops is not None and not start.offsets(exam) and not exam.remarks.get("ranges"):
        whole = "the one degree of freedom" if exam.stops.dof == 1 else f"all {exam.stops.dof} degrees of freedom"
        said = f"{few(list(exam.stops.limits))} take{'s' if len(exam.stops.limits) == 1 else ''} {whole} left"
        yield found("C3", exam.file, said, dof=exam.stops.dof)


def _stopped(exam: Examination) -> Iterator[Finding]:
    """C5: a limit that stops a joint short of where an equality wants it, and that does not contradict it (C1)."""
    fight, told = exam.fight, set[str]()
    for one in exam.stopped:
        if one.equality in told:
            continue  # among the others of the first
        told.add(one.equality)
        name = f"limit of {called('joint', one.joint)}"
        if fight is not None and name in fight.others and one.equality in fight.equalities:
            continue
        given, without = (figure(value, one.drift_unit) for value in (one.drift, one.drift_without))
        limits = f"that limit and {_limits(one.others)}" if one.others else "that limit"
        said = (
            f"the {name} ({one.limit:.4g} {one.unit}) stops it where "
            f"{quoted(one.equality)} wants up to {one.wanted:.4g} {one.unit}: it opens by {given}, by {without} "
            f"without {limits}"
        )
        if _meant_radians(one.limit, one.wanted) and one.unit == "rad" and takes_degrees(exam.path):
            said += (
                f"; its range ends at {np.degrees(one.limit):.4g} degrees, and as radians that would let it: "
                'angle="radian" in <compiler>, or the range in degrees'
            )
        yield found(
            "C5",
            exam.file,
            said,
            element=one.equality,
            joint=one.joint,
            limit=one.limit,
            wanted=one.wanted,
            drift=one.drift,
            drift_without=one.drift_without,
            unit=one.drift_unit,
            others=list(one.others),
        )


def _limits(joints: tuple[str, ...]) -> str:
    return f"{'those' if joints[1:] else 'that'} of {few([quoted(name) for name in joints])}"


def _meant_radians(limit: float, wanted: float) -> bool:
    """Whether a limit that was read in degrees (rad here) would admit what is wanted (rad), had it been radians."""
    return 0.0 < abs(limit) < abs(wanted) < abs(np.degrees(limit)) < _TURN


# Forces.


def _reactions(exam: Examination) -> Iterator[Finding]:
    if exam.reactions is None or not exam.closed:
        return
    together = {name for one in exam.reactions.together if one.unique for name in one.names}
    hanging = ranks.hanging(exam)
    for one in exam.reactions.equalities:
        if one.unique:
            continue
        parts = [("force", one.force), ("torque", one.torque)]
        said = [f"its {name} is {part}" for name, part in parts if part is not None and part.free]
        if one.coupled is False:
            said = ["its multiplier is not unique"]
        if together & set(one.names):
            said.append("the sum with those between the same bodies is unique")
        if hanging & set(one.names):
            said.append("it hangs on a small number (L8)")
        yield found("U1", exam.file, "; ".join(said), element=one.names[0], verdict=one.verdict)
    for beside in exam.recording.beside if exam.recording else ():
        said = f"not unique beside {few(list(beside.others), last='')}"
        yield found("U3", exam.file, said, element=beside.equality, time_s=beside.time_s)


def _motion(exam: Examination) -> Iterator[Finding]:
    if exam.history is None:
        return
    flipping = {name for one in ranks.flips(exam) for name in named(one)}  # no pose is singular there (L14)
    events = [event for event in exam.history.events if flipping.isdisjoint(event.equalities)]
    singular = [event for event in events if event.kind == "singular"]
    for event in singular[:1]:
        more = {0: "", 1: " and once more"}.get(len(singular) - 1, f" and {len(singular) - 1} more times")
        others = f"with {in_words(list(event.equalities[1:]))}, " if event.equalities[1:] else ""
        said = f"{others}rank {exam.history.rank} falls to {event.rank}"
        said += f" at t = {event.time_s:.6g} s{more}"
        times = ", ".join(f"{one.time_s:.10g}" for one in singular)
        yield found("L5", exam.file, said, element=event.equalities[0], also=list(event.equalities[1:]), times_s=times)
    near = [event for event in events if event.kind == "near"]
    for event in sorted(near, key=lambda event: event.smallest)[:1]:
        said = f"at t = {event.time_s:.4g} s the smallest singular value falls to {event.smallest:.2g} of its median"
        if len(near) > 1:
            said += f", the least of {len(near)} such moments"
        names = list(event.equalities)
        yield found("U2", exam.file, said, element=names[0], also=names[1:], smallest=event.smallest)
