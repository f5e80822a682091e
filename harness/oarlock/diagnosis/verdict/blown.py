"""Why a run does not stay finite, and what makes it last."""

from collections.abc import Iterator

from oarlock.base.text import quoted
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.runs.behind import largest_force
from oarlock.diagnosis.runs.without import FINEST, PARTS

WHOLE = 0.05
"""Of the size of the loops: one that opens by less holds, and a run with shorter steps in which it does is a remedy."""

ROUNDS = 1e-9
"""Relative, of a timestep."""

_PARTS = {PARTS: "quarter", FINEST: "sixteenth"}


def reasons(exam: Examination) -> Iterator[str]:
    """What makes a run diverge, unless shorter steps are all that it lacks, and what those make of it."""
    if not _healed(exam):
        yield from _lasts_without(exam)
    yield from _lasts_finer(exam)


def _healed(exam: Examination) -> bool:
    """Whether shorter steps are all that a run which diverges lacks."""
    every = [each for one in exam.without if one.cause == "stepping" for each in one.left.values()]
    return bool(every) and max(each.largest for each in every) <= WHOLE * exam.size


def _lasts_without(exam: Examination) -> Iterator[str]:
    """What makes a run diverge, by a run without it."""
    one = exam.behind
    if one is None or one.equality or one.suspect is None:
        return
    said = f"without {one.suspect.said} it stays finite"
    if one.suspect.sort == "drive" and exam.recording is not None:
        force = largest_force(exam.model, exam.recording, one.suspect.index)
        said = f"{one.suspect.said} gives {force:.3g} N or N m, and without it the run stays finite"
    if one.factor:
        said += f", and with {one.factor:g} times that"
    yield said


def _lasts_finer(exam: Examination) -> Iterator[str]:
    """What shorter steps make of a run that diverges."""
    for one in exam.without:
        if one.cause == "stepping" and one.left:
            worst = max(one.left.values(), key=lambda opening: opening.largest)
            shorter, recipe = exam.timestep_s / one.parts, exam.recipe
            said = f"with a timestep of {shorter:g} s, a {_PARTS[one.parts]} of it, it stays finite"
            # Stiffer rows hold it with no shorter steps than that.
            chosen = recipe.chosen if recipe is not None and recipe.chosen.drift <= exam.target else None
            soft = chosen is not None and chosen.setting.timestep_s >= (1.0 - ROUNDS) * shorter
            softly = ", for it is too soft as well" if soft and worst.largest > exam.target else ""
            yield f"{said}, and {quoted(worst.equality)} opens by {worst}{softly}"
