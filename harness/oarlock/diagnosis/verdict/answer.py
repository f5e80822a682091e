"""The answer to a check in one sentence: what is worst, why, and what would mend it."""

from collections.abc import Sequence

from oarlock.base.errors import few
from oarlock.base.numbers import figure, percent
from oarlock.base.text import quoted
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.runs.drifts import VISIBLE, Drift
from oarlock.diagnosis.runs.recipe import Recipe
from oarlock.diagnosis.runs.solving import Solving
from oarlock.diagnosis.verdict.blame import behind, held, with_armature
from oarlock.diagnosis.verdict.cost import named, widest
from oarlock.diagnosis.verdict.findings import Finding, worst_first
from oarlock.diagnosis.verdict.motions import stands

_BECAUSE = {
    "D1": "MuJoCo's constraints are springs, and the load pulls it apart",
    "D2": "MuJoCo leaves the bend of its row (J̇v) out",
    "D3": "within a step the velocity runs straight, and the loop bends",
    "D4": "the integrator treats damping implicitly, after the constraint forces",
    "D5": "its row is softer than solimp says",
    "T4": "its solref is below twice the timestep, and is taken as that",
    "E1": "its own springs and dampers take energy",
}
"""Code → why an equality opens. Of all others the finding's own line is the answer."""

BEYOND = (
    "A2",
    "A3",
    "A5",
    "A6",
    "A7",
    "A8",
    "A9",
    "A10",
    "A11",
    "C3",
    "C4",
    "C5",
    "C6",
    "L6",
    "L9",
    "L10",
    "L13",
    "L15",
    "S2",
    "S3",
    "S5",
    "S7",
    "S8",
    "U4",
    "U5",
)
"""What no settings mend: something else in the file has to be another one."""

UNMOVED = ("A2", "A3", "A6", "A7", "A8", "A9", "A10", "A11", "C6", "L6", "L13", "L15", "S5")
"""What is wrong however well the loops hold: the mechanism does not do what it is told, or drawn, to do."""

WEIGHT = 0.5
"""Of a drift: with more of it gone without gravity, it is the weight of the mechanism that opens the loop."""

MOST_COORDINATES = 10
"""Of a pose that is written out in the answer; of more, --write-keyframe writes it."""

_PREDICATES = ("names ", "is ", "opens ", "stands ", "stays ", "cannot ", "gives ")
"""How a line begins of which the element is the subject."""


def answer(exam: Examination, findings: Sequence[Finding]) -> str:
    """One sentence on top of everything else; which run and which start it is about stands beside it."""
    ordered = worst_first(findings)
    bad = [one for one in ordered if one.severity != "note" and one.code not in ("D7", "T3", "T5")]
    if exam.options.lint:
        return _own(bad[0]) if bad else "Nothing is wrong that can be seen without a run."
    worst = widest(exam)
    if worst is None:
        return _own(ordered[0]) if ordered else "Nothing is known of its loops."
    holds = worst.largest <= exam.target
    if bad and (not holds or bad[0].severity == "error" or bad[0].code in UNMOVED):
        why = bad[0] if bad[0].code in UNMOVED else _cause(worst, bad)
        because = behind(exam, worst.equality) if why.code in _BECAUSE else ""
        said = _own(why) if why.code not in _BECAUSE else f"{_opens(worst)}: {because or _load(exam, why.code)}"
        if why.code == "D8" and exam.calmer is not None:
            factor, left = exam.calmer
            said += f", and with {factor:g} times that (its gain, or gear) {quoted(left.equality)} opens by {left}"
        if why.code in ("S2", "S3"):
            said += _straight(exam)
        if why.code == "D6" and why.element and "drift_m" in why.figures:
            said += f"; the solver is {Solving.of(exam.model)}"
        if why.code == "D1" and exam.rotors is not None and worst.equality in exam.rotors.left:
            said += f"; {with_armature(exam.rotors, worst.equality)}"
        if why.code == "A1" and why.severity != "note":
            said = said.replace(": ", f" is too stiff for a timestep of {exam.timestep_s:g} s: ", 1)
        said += _closed_start(exam) if why.code == "S1" and not why.figures.get("meant") else ""
        one = exam.behind.suspect if because and exam.behind is not None else None
        given = one is not None and one.sort in ("limit", "scale")  # which has a remedy of its own
        return said if given or why.code in BEYOND else f"{said}{_mended(exam, 'it' if why.element else 'no loop')}"
    if holds and stands(exam):
        if (single := _single(ordered)) is not None:
            return _own(single)
        return (
            "Nothing of its loops moves in this run, so that how they hold is not seen: give it a start with a "
            "velocity (--keyframe), or controls (--controls, --control)"
        )
    if holds:
        return f"Every loop holds the wanted {figure(exam.target)} m or rad: {_opens(worst, 'at most ')}"
    if worst.largest <= VISIBLE and not any(one.code == "D7" for one in ordered):
        return (
            f"The loops hold: {_opens(worst, 'at most ')}, which is more than the wanted {figure(exam.target)} m or "
            f"rad and less than what is seen{_mended(exam)}"
        )
    return f"{_opens(worst)}{_mended(exam)}"


def _single(findings: Sequence[Finding]) -> Finding | None:
    """A coupling that holds one joint alone: a note, and why nothing moves."""
    return next((one for one in findings if one.line.startswith("names no joint2")), None)


def unsettled(exam: Examination, findings: Sequence[Finding]) -> tuple[Finding, str] | None:
    """What the answer is of, where no settings mend it, with what is said of it; None: the answer is of the drift."""
    said, ordered = answer(exam, findings), worst_first(findings)
    beyond = [one for one in ordered if one.code in BEYOND and (one.severity != "note" or one is _single(ordered))]
    return next(((one, said) for one in beyond if said.startswith(_own(one))), None)


def _load(exam: Examination, code: str) -> str:
    """Why an equality opens, with what pulls at it where that is no more than its weight."""
    one = exam.behind
    if code == "D1" and one is not None and one.weight is not None and one.weight > WEIGHT:
        return f"MuJoCo's constraints are springs, and the weight of the links makes {percent(one.weight)} of it"
    return _BECAUSE[code]


def _own(finding: Finding) -> str:
    if not finding.element:
        return finding.line
    colon = "" if finding.line.startswith(_PREDICATES) else ":"
    return f"{quoted(finding.element)}{colon} {finding.line}"


def _cause(worst: Drift, bad: Sequence[Finding]) -> Finding:
    """The worst finding, unless it is a softer one of another equality than the one that opens furthest."""
    if bad[0].severity == "error":
        return bad[0]
    own = [one for one in bad if worst.equality in named(one)]
    return max((*own[:1], bad[0]), key=lambda one: one.cost)


def _straight(exam: Examination) -> str:
    """How the axes would be parallel of which it is said that they are not."""
    tilts = exam.pose.tilts if exam.pose is not None else ()
    axes = [
        f'axis="{" ".join(f"{value + 0.0:.6g}" for value in one.axis)}" of {quoted(one.joint)}'
        for one in tilts
        if one.axis
    ]
    return f"; with {few(axes, last='and')} it is parallel to the others" if axes else ""


def _closed_start(exam: Examination) -> str:
    """The nearest closed pose, as a keyframe of few coordinates has it."""
    pose = exam.pose
    if pose is None or pose.consistent or not pose.moved or len(pose.qpos) > MOST_COORDINATES:
        return ""
    return f'; a keyframe with qpos="{" ".join(f"{value + 0.0:.6g}" for value in pose.qpos)}" is closed'


def _opens(worst: Drift, most: str = "") -> str:
    return f"{quoted(worst.equality)} opens by {most}{worst.at}"


def _mended_alone(exam: Examination, what: str) -> str:
    """What holds from the user's own start, and not from disturbed ones."""
    recipe = exam.recipe
    if recipe is None or recipe.outcome != "not-reached" or not recipe.chosen.drift <= recipe.target:
        return ""
    setting = recipe.chosen.setting
    solref = "" if setting.solref is None else f'solref "{setting.solref[0]:g} {setting.solref[1]:g}" and '
    most = "opens by at most" if what == "it" else "opens by more than"
    whence = "from its own start alone" if exam.pose is None or exam.pose.consistent else "from the closed start alone"
    return f"; {whence}, with {solref}a timestep of {setting.timestep_s:g} s {what} {most} {held(recipe.chosen)}"


def _mended(exam: Examination, what: str = "it") -> str:
    recipe = exam.recipe
    if exam.withheld:
        return ""
    if recipe is None or recipe.outcome != "reached":
        return _mended_alone(exam, what)
    left = max([recipe.chosen, *recipe.verified], key=lambda one: one.drift)
    whence = "from the closed start, " if exam.pose is not None and not exam.pose.consistent else ""
    most = "opens by at most" if what == "it" else "opens by more than"
    untried = f", {recipe.untried}" if recipe.untried else ""
    return f"; {whence}with {recipe.reason}{_written(recipe)} {what} {most} {held(left)}{untried}"


def _written(recipe: Recipe) -> str:
    """The numbers of stiffer equalities, unless the reason has them."""
    given = recipe.chosen.setting.equality_attributes()
    said = [f'{name}="{value}"' for name, value in given.items() if f'{name} "{value}"' not in recipe.reason]
    return f" ({' '.join(said)})" if said else ""
