"""What ``oarlock.check`` gives: an examination with its findings, and their tables.

It comes with every ``import oarlock``; what examines a model is imported where one is examined.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl
from threadpoolctl import threadpool_limits

from oarlock.diagnosis.wish import BUDGET_S, TARGET, Wish

if TYPE_CHECKING:
    from oarlock.diagnosis.examination import Examination
    from oarlock.diagnosis.verdict.findings import Finding


class Checked:
    """A model that was checked; in a notebook it shows itself.

    Attributes:
        examination: all that was found out, over time.
        found: the findings, the worst first.
    """

    def __init__(self, examination: "Examination", found: "list[Finding]"):
        self.examination, self.found = examination, found

    @property
    def findings(self) -> pl.DataFrame:
        """A row a finding, the worst first."""
        from oarlock.diagnosis.page.document import findings_table

        return findings_table(self.found)

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
        """Settings that hold, as MJCF to paste; empty where nothing has to change or nothing was found."""
        return self.examination.recipe.mjcf if self.examination.recipe else ""

    def document(self) -> dict[str, Any]:
        """As ``oarlock check --json``."""
        from oarlock.diagnosis.page.document import document

        return document(self.examination, self.found)

    def _repr_html_(self) -> str:
        from oarlock.diagnosis.page.page import html_fragment

        return html_fragment(self.examination, self.found)

    def __repr__(self) -> str:
        return "\n".join([f"checked {self.examination.file}", *(f"  {finding}" for finding in self.found)])


def check(
    file: str | Path,
    *,
    keyframe: str | None = None,
    controls: str | None = None,
    constant: dict[str, float] | None = None,
    seed: int = 0,
    duration_s: float | None = None,
    timestep_s: float | None = None,
    integrator: str | None = None,
    target: float = TARGET,
    budget_s: float = BUDGET_S,
    ignore_inequalities: bool = False,
    fail_above: float | None = None,
    progress: "Callable[[str, Examination], None] | None" = None,
) -> Checked:
    """Finds out why the loops of a model come apart, and what would hold them.

    Args:
        file: MJCF file, or name of a model that comes along.
        keyframe: name or number of the keyframe to start from; the first one, or the model's own pose.
        controls: ``keyframe``, ``constant`` or ``random``; chosen by what the model has if left out.
        constant: actuator → constant control.
        seed: of random controls.
        duration_s: of the run, s.
        timestep_s: in place of the model's, s.
        integrator: ``euler``, ``implicit``, ``implicitfast`` or ``rk4``, in place of the model's.
        target: wanted drift, m or rad.
        budget_s: time for the runs that look for settings, s; 0: none are looked for.
        ignore_inequalities: without contacts, limits and friction.
        fail_above: bound on the drift, m or rad; beyond it there is an error among the findings.
        progress: is told of every part as soon as it is there.

    Raises:
        InputError: no such file, malformed, no equality, or an argument that does not fit the model.
    """
    from oarlock.diagnosis.examination import begin, examine
    from oarlock.diagnosis.verdict.verdicts import judge

    wish = Wish(
        keyframe=keyframe,
        controls=controls,
        constant=constant or {},
        seed=seed,
        duration_s=duration_s,
        timestep_s=timestep_s,
        integrator=integrator,
        target=target,
        budget_s=budget_s,
        ignore_inequalities=ignore_inequalities,
    )
    # Many small matrices: threads of BLAS wait for one another longer than they work, and for whatever else is running.
    with threadpool_limits(1, user_api="blas"):
        examination = begin(str(file), wish)
        for part in examine(examination):
            if progress:
                progress(part, examination)
        return Checked(examination, judge(examination, fail_above))
