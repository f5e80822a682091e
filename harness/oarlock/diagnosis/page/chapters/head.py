"""What was looked at and how it was made to move: what stands before the first chapter."""

import numpy as np

from oarlock.base.text import one_line as plain
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.page.chapters.words import counted
from oarlock.mechanics.flexes import flex_names
from oarlock.mechanics.prepare import integrator_of


def head(exam: Examination) -> str:
    """What was run, in a sentence or two."""
    model = exam.model
    off = model.neq - int(np.count_nonzero(model.eq_active0))
    without = "it" if model.neq == 1 else "them"
    text = (
        f"{counted(model.neq, 'equality', 'equalities')}{f' ({off} switched off)' if off else ''}, "
        f"{counted(model.nv, 'degree')} of freedom without {without}."
    )
    if not exam.options.lint:
        text += (
            f" The run: {exam.duration_s:g} s in {counted(exam.steps, 'step')} of {exam.timestep_s:g} s, integrator "
            f"{integrator_of(model)}, from {exam.begins}; {exam.driven}."
        )
    if flexes := flex_names(model):
        names = ", ".join(f"'{name}'" for name in flexes)
        text += f" Left as MuJoCo has it, and not examined: flex {names}."
    return plain(f"{text} Left out: {exam.ignored}." if exam.ignored else text)
