"""All chapters of an examination in their order."""

from collections.abc import Callable

from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.page.blocks import Chapter
from oarlock.diagnosis.page.chapters.causes import causes
from oarlock.diagnosis.page.chapters.drift import drift
from oarlock.diagnosis.page.chapters.forces import forces
from oarlock.diagnosis.page.chapters.loops import loops
from oarlock.diagnosis.page.chapters.remedy import remedy
from oarlock.diagnosis.page.chapters.start import start

CHAPTERS: dict[str, Callable[[Examination], Chapter]] = {
    "loops": loops,
    "start": start,
    "run": drift,
    "causes": causes,
    "remedy": remedy,
    "forces": forces,
}
"""Part of an examination → its chapter, which can be made as soon as the part is there."""


def chapters(exam: Examination) -> list[Chapter]:
    """All of them; of what is missing they say why."""
    return [make(exam) for make in CHAPTERS.values()]
