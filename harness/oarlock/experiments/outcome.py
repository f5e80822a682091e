"""What the runs of a case gave, and how it is judged."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import polars as pl

from oarlock.base.answer import Answer, html_table
from oarlock.base.lock import locked
from oarlock.base.scratch import scratch_folder
from oarlock.cases.case import Case
from oarlock.experiments.description import case_document
from oarlock.tables.aggregate import Verdict
from oarlock.tables.folder import FILES, SUMMARY, ResultFolder, Sums
from oarlock.tables.promise import unexpected

COLUMNS = {
    "run": "run",
    "status": "status",
    "iterations_mean": "iterations",
    "min_norm_error_max": "min-norm error (rel)",
    "qacc_rel_diff_max": "qacc diff (rel)",
    "drift_pos_max": "drift (m, rad)",
    "energy_drift_rel": "energy drift (rel)",
    "error_estimate_max": "own error (m, rad)",
    "truth_error_max": "truth error (m, rad)",
}
"""Figure of the summary → title with its unit, of what is shown of a run at a glance."""

WORDS = 2
"""So many of ``COLUMNS`` hold words; the others hold figures."""


def glance(row: dict[str, Any]) -> list[Any]:
    """What ``COLUMNS`` show of a row of the summary: of a run that diverged no figures, for they prove nothing."""
    lost = row["status"] == "diverged"
    return [None if lost and name not in ("run", "status") else row[name] for name in COLUMNS]


@dataclass
class Results(Answer):
    """What a run gave.

    Attributes:
        summary: a row a run (polars).
        steps: a row a run and step (polars).
        rows: the summary as plain dictionaries.
        tables: the steps, a lazy table a run. A long run that is kept in a folder is read from there.
        verdicts: what the case expects and its gates, held against the model and the runs.
        provenance: versions, platform, commit, date.
        model: what the model turned out to be at its start.
        sketch: its drawing; None where no run took a step.
        truth: the outside truth at times of the steps, where there is one.
        folder: where all of it is kept; None: in memory only.
        motion: where the runs start and what drives them, in words.
        still: whether nothing moves: in the exact runs, or in the others where there are none.
    """

    FRAMES = ("summary", "steps")

    case: Case
    rows: list[dict[str, Any]] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    provenance: dict[str, Any] = field(default_factory=dict)
    tables: list[pl.LazyFrame] = field(default_factory=list)
    model: dict[str, Any] = field(default_factory=dict)
    sketch: dict[str, Any] | None = None
    truth: pl.DataFrame | None = None
    folder: Path | None = None
    motion: str = ""
    still: bool = False
    sums: Sums = field(default_factory=dict)
    """Name of a table in the folder → its checksum."""

    @property
    def summary(self) -> pl.DataFrame:
        """A row a run."""
        return pl.DataFrame(self.rows, infer_schema_length=None)

    @property
    def steps(self) -> pl.DataFrame:
        """A row a run and step."""
        return pl.concat(self.tables).collect() if self.tables else pl.DataFrame()

    @property
    def failures(self) -> list[Verdict]:
        """Gates that did not hold."""
        return [verdict for verdict in self.verdicts if verdict.held is False]

    @property
    def lost(self) -> list[dict[str, Any]]:
        """Rows of the runs that ended neither ``done`` nor as their case expects."""
        return [row for row in self.rows if unexpected(self.case, row)]

    @property
    def answer(self) -> str:
        """How the runs ended and whether the gates of the case hold, in one line."""
        ends = Counter(row["status"] for row in self.rows)
        said = [f"{len(self.rows)} runs: {', '.join(f'{count} {status}' for status, count in ends.items())}"]
        said[0] += f"; {len(self.lost)} not as expected" if self.lost else ""
        judged = [verdict for verdict in self.verdicts if verdict.held is not None]
        if judged:
            failed = len(self.failures)
            said.append(f"{failed} of {len(judged)} gates do not hold" if failed else f"all {len(judged)} gates hold")
        unchecked = len(self.verdicts) - len(judged)
        return "; ".join([*said, *([f"{unchecked} gates not checked"] if unchecked else [])])

    def document(self) -> dict[str, Any]:
        """The summary JSON: provenance, a dictionary a run, and the gates."""
        return {
            "provenance": self.provenance,
            "runs": self.rows,
            "gates": [
                {
                    **verdict.gate.model_dump(),
                    "run": verdict.run,
                    "value": verdict.value,
                    "held": verdict.held,
                }
                for verdict in self.verdicts
            ],
        }

    def kept(self) -> dict[str, Any]:
        """The document as folders keep it: with the checksums of the tables."""
        return {**self.document(), FILES: self.sums}

    def save(self, folder: str | Path) -> Path:
        """Keeps all of it in a folder, as a run with ``out`` and ``replace`` does; gives the folder.

        Raises:
            InputError: the folder cannot be written, or is in use.
        """
        with locked([Path(folder)], f"oarlock.run {self.case.name}", lambda _: None):
            return self._save(ResultFolder(Path(folder)))

    def _save(self, kept: ResultFolder) -> Path:
        kept.write_json("case.json", case_document(self.case, self.model))
        if self.truth is not None:
            self.sums |= kept.write_truth(self.truth)
        if self.sketch is not None:
            kept.write_json("sketch.json", self.sketch)
        for row, table in zip(self.rows, self.tables, strict=True):
            self.sums |= kept.write_table(row["run"], table)
        kept.write_json(SUMMARY, self.kept())
        kept.forget_steps_but([row["run"] for row in self.rows])
        return kept.path

    def report(self, folder: str | Path) -> Path:
        """Writes the page of the runs, as ``oarlock run --report``."""
        from oarlock.report.case_report import write_report

        if self.folder is not None:
            return write_report(self.folder, Path(folder))
        with scratch_folder() as temporary:
            return write_report(self.save(temporary / self.case.slug), Path(folder))

    def _repr_html_(self) -> str:
        held = sum(verdict.held is True for verdict in self.verdicts)
        failed = [f"gate failed: {verdict.line()}" for verdict in self.failures]
        head = f"{self.case.name}: {len(self.rows)} runs; {held} gates hold, {len(failed)} do not"
        return html_table(head, list(COLUMNS.values()), [glance(row) for row in self.rows], failed)
