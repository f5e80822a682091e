"""What ``oarlock.check`` gives: an examination with its findings, and their tables.

It comes with every ``import oarlock``; what examines a model is imported where one is examined.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from oarlock.base.answer import Answer
from oarlock.base.arguments import complete, takes
from oarlock.base.cores import one_thread
from oarlock.base.forks import require_threads
from oarlock.base.progress import Progress
from oarlock.diagnosis.options import CheckOptions
from oarlock.mechanics.fatal import mujoco_ends_in_a_line

if TYPE_CHECKING:
    from oarlock.diagnosis.examined import Examination
    from oarlock.diagnosis.fix.fix import Fix
    from oarlock.diagnosis.verdict.findings import Finding
    from oarlock.mechanics.given import Model


class Checked(Answer):
    """A model that was checked.

    Attributes:
        examination: all that was found out, over time.
        verdict: the findings as objects, the worst first.
        fixed: what the last ``fix`` made; None: there was none.
    """

    FRAMES = ("findings", "drift", "causes", "accelerations", "trials")

    def __init__(self, examination: "Examination", verdict: "list[Finding]"):
        self.examination, self.verdict = examination, verdict
        self.fixed: Fix | None = None

    @property
    def answer(self) -> str:
        """What is worst, why, and what would mend it, in one sentence."""
        from oarlock.diagnosis.verdict.answer import answer

        return answer(self.examination, self.verdict)

    @property
    def findings(self) -> pl.DataFrame:
        """A row a finding, the worst first."""
        from oarlock.diagnosis.page.document import findings_table

        return findings_table(self.verdict)

    @property
    def drift(self) -> pl.DataFrame:
        """A row an equality and level: largest deviations, m and rad and their rates, MuJoCo's and the exact ones."""
        from oarlock.diagnosis.page.document import drift_table

        return drift_table(self.examination)

    @property
    def causes(self) -> pl.DataFrame:
        """A row an equality and cause: its part of the drift."""
        from oarlock.diagnosis.page.document import causes_table

        return causes_table(self.examination)

    @property
    def accelerations(self) -> pl.DataFrame:
        """A row a cause: how MuJoCo's acceleration differs by it from the exact one at the same states."""
        from oarlock.diagnosis.page.document import accelerations_table

        return accelerations_table(self.examination)

    @property
    def trials(self) -> pl.DataFrame:
        """A row a run that was made to find what holds."""
        from oarlock.diagnosis.page.document import trials_table

        return trials_table(self.examination)

    @property
    def mjcf(self) -> str:
        """Settings that hold, as MJCF to paste.

        Empty where nothing has to change, nothing was found, or something else has to be mended first.
        """
        exam = self.examination
        return exam.recipe.mjcf if exam.recipe and not exam.withheld else ""

    def document(self) -> dict[str, Any]:
        """As ``oarlock check --json``."""
        from oarlock.diagnosis.page.document import document

        return {**document(self.examination, self.verdict), "fix": self.fixed.document() if self.fixed else None}

    def fix(self, out: str | Path) -> "Fix":
        """Writes one file with everything that helps, as ``oarlock check --fix``, and checks it.

        Args:
            out: the file; what is there is replaced.

        Raises:
            InputError: the model is no MJCF file, or the file is the model itself or cannot be written.
        """
        from oarlock.diagnosis.fix.fix import fix_model

        with one_thread(), mujoco_ends_in_a_line(self.examination.file):
            self.fixed = fix_model(self.examination, self.verdict, Path(out))
        return self.fixed

    def report(self, folder: str | Path) -> Path:
        """Writes the page of the check, as ``oarlock check --report``, with a chapter on the last ``fix``."""
        from oarlock.diagnosis.page.page import write_page

        fix = self.fixed.document() if self.fixed else None
        return write_page(self.examination, self.verdict, Path(folder), fix)

    def _repr_html_(self) -> str:
        from oarlock.diagnosis.page.page import html_fragment

        return html_fragment(self.examination, self.verdict)

    def __repr__(self) -> str:
        return "\n".join(
            [f"checked {self.examination.file}", f"  {self.answer}", *(f"  {finding}" for finding in self.verdict)]
        )


def begun(model: "Model", options: CheckOptions) -> "Examination":
    """An examination of which only the model is loaded.

    Raises:
        InputError: as ``check``.
    """
    require_threads()
    from oarlock.diagnosis.beginning import begin
    from oarlock.mechanics.given import as_given, path_of

    file = path_of(model)
    with one_thread(), mujoco_ends_in_a_line(file):
        begun = begin(str(file), options)
    begun.file = as_given(begun.file)
    return begun


def parts(examination: "Examination") -> Iterator[str]:
    """Looks at the model; gives the name of every part of the examination as soon as it is there."""
    from oarlock.diagnosis.examination import examine

    with one_thread(), mujoco_ends_in_a_line(examination.file):
        yield from examine(examination)


def judged(examination: "Examination") -> Checked:
    """The answer to an examination that is complete."""
    from oarlock.diagnosis.verdict.verdicts import judge

    with mujoco_ends_in_a_line():
        return Checked(examination, judge(examination, examination.options.fail_above))


@takes(CheckOptions)
def check(
    model: "Model", options: CheckOptions | None = None, *, progress: Progress | None = None, **keywords: Any
) -> Checked:
    """Finds out why the loops of a model come apart, and what would hold them.

    With ``lint=True`` only what can be seen without a run: findings alone, in milliseconds.

    Args:
        model: path of an MJCF file, name of a model that comes along, MJCF as text, an ``MjModel`` or an ``MjSpec``.
        options: what is asked for.
        progress: listens: ``finished`` gets the name of every part of the examination that is there.
        keywords: the fields of ``CheckOptions``, one by one, as of ``oarlock check``: ``duration=1.0, budget=0``.

    Raises:
        InputError: no such file, malformed, no equality, or an option that does not fit the model.
    """
    from oarlock.diagnosis.examination import PARTS

    progress = progress or Progress()
    options = complete(CheckOptions, options, keywords)
    progress.begin("checking", 0 if options.lint else len(PARTS))
    examination = begun(model, options)
    for part in parts(examination):
        progress.advance(1)
        progress.finished(part)
    return judged(examination)
