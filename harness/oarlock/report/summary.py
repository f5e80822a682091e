"""The summary of all cases, as a pure function of their folders of results.

As in the report of one case, what changes from one occasion to the next is not in the tracked files (README.md,
summary.json, figures/*.svg) but in index.html and provenance.json beside them. Precision against time is therefore
drawn in the page only; the tracked figure counts solves.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from oarlock.base.errors import InputError
from oarlock.base.files import write_text
from oarlock.render.folder import require_same_page
from oarlock.render.page import Figure, drawable, page
from oarlock.render.template import render
from oarlock.report import summary_figures as figures
from oarlock.report.tables import Tables
from oarlock.tables.figures import TIMING_FIGURES
from oarlock.tables.folder import OCCASION, ResultFolder, believing
from oarlock.tables.ledger import Ledger

DIGITS = 6
"""Significant digits of the tracked summary.json: enough to compare, and stable when the last bits are not."""

EXACT = ("pinv", "cholesky", "sr1-tracked", "sr1")
"""Solvers whose free run with exact constraints stands for oarlock; the first that a case has."""

DOUBTFUL = 0.01
"""Share of unconverged solves above which mean iterations are marked, because they count giving up."""

_OF_CASE = ("case", "model_sha256", "case_sha256")


@dataclass(frozen=True)
class Place:
    """A figure and the run that has it, for naming the worst."""

    value: float
    line: "Line"
    row: dict[str, Any]
    unit: str = ""


class Line:
    """One case of the summary.

    Attributes:
        name: name of the case.
        slug: name of the folder of its results and of the folder of its page.
        refused: why it could not be run; empty if it could.
        failures: name of a unit that was not finished → why.
        tables: its results; None if there are none.
    """

    def __init__(self, path: Path):
        self.ledger = Ledger.read(path, strict=True)
        self.name, self.slug = self.ledger.case or path.name, path.name
        self.refused, self.failures = self.ledger.refused, self.ledger.failures()
        try:
            self.tables: Tables | None = Tables(ResultFolder(path))
        except InputError:
            if not self.refused and not self.failures:
                raise
            self.tables = None

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Summary rows of the runs."""
        return self.tables.rows if self.tables else []

    def gates(self, held: bool | None) -> list[dict[str, Any]]:
        """Returns the gates that held (True), that failed (False) or that were not checked (None)."""
        return [gate for gate in self.tables.gates if gate["held"] is held] if self.tables else []

    @property
    def verdict(self) -> str:
        """What became of the gates, in words."""
        if self.refused:
            return "**refused**"
        if self.failures:
            return f"**{len(self.failures)} not run**"
        failed = len(self.gates(False))
        if failed:
            return f"**{failed} of {failed + len(self.gates(True))} gates fail**"
        held = len(self.gates(True))
        return f"all {held} hold" if held else "no gates"

    def free(self, who: str) -> dict[str, Any] | None:
        """Returns the free run of ``default`` or ``stiff`` MuJoCo or of ``exact`` constraints, or None."""
        if self.tables is None:
            return None
        if who != "exact":
            return self.tables.pick(mode="free", solver="mujoco", settings=who)
        found = (self.tables.pick(mode="free", form="hard", solver=solver) for solver in EXACT)
        return next((row for row in found if row), None)

    def solving(self, who: str) -> dict[str, Any] | None:
        """Returns the run whose iterations stand for a solver; None if there is none.

        For solvers of oarlock it has exact constraints, along the exact trajectory if possible; for MuJoCo's ``cg``
        and ``pgs`` it is their own free run.
        """
        if self.tables is None:
            return None
        if who in ("cg", "pgs"):
            return self.tables.pick(mode="free", solver="mujoco", settings=who)
        found = self.tables.all(mode="lockstep", form="hard", solver=who)
        return min(found, key=lambda row: row["walker"] == "mujoco", default=None)

    def figure(self, row: dict[str, Any] | None, name: str) -> Any:
        """Returns a figure of a run; None if there is no run or it diverged."""
        return row[name] if row and row["status"] != "diverged" else None

    def doubtful(self, who: str) -> bool:
        """Tells whether more than ``DOUBTFUL`` of the solves of the run that ``solving`` returns did not converge."""
        row = self.solving(who)
        return bool(row) and (row["unconverged"] or 0) > DOUBTFUL * row["solves"]

    def cells(self) -> dict[str, Any]:
        """Returns what the tables of the summary show of the case."""
        drift = {who: self.figure(self.free(who), "drift_pos_max") for who in ("default", "stiff", "exact")}
        truth = {who: self.figure(self.free(who), "truth_error_max") for who in ("default", "stiff", "exact")}
        solving = {who: self.solving(who) for who in figures.SOLVERS.values()}
        iterations = {who: self.figure(row, "iterations_mean") for who, row in solving.items()}
        apart = {who: self.figure(solving[who], "min_norm_error_max") for who in ("sr1", "sr1-tracked")}
        doubtful = {who: self.doubtful(who) for who in solving}
        return {"drift": drift, "truth": truth, "iterations": iterations, "apart": apart, "doubtful": doubtful}


class Summary:
    """All cases, and what stands out among them."""

    def __init__(self, folders: Iterable[Path]):
        self.lines = [Line(path) for path in folders]

    def _largest(self, name: str, who: str) -> list[Place]:
        """Returns the largest value of a figure of a free run, one per unit: metres and radians do not compare."""
        worst: dict[str, Place] = {}
        for line in self.lines:
            row = line.free(who)
            value = line.figure(row, name)
            if value is None or row is None or line.tables is None:
                continue
            unit = line.tables.unit if name == "drift_pos_max" else line.tables.truth_unit
            if unit not in worst or value > worst[unit].value:
                worst[unit] = Place(value, line, row, unit)
        return [worst[unit] for unit in sorted(worst)]

    @property
    def worst(self) -> dict[str, list[Place]]:
        """Returns the worst values by figure, one per unit."""
        return {
            "Largest drift of MuJoCo with its default softness": self._largest("drift_pos_max", "default"),
            "Largest drift of exact constraints": self._largest("drift_pos_max", "exact"),
            "Largest distance from the truth of MuJoCo with its default softness": self._largest(
                "truth_error_max", "default"
            ),
            "Largest distance from the truth of exact constraints": self._largest("truth_error_max", "exact"),
        }

    @property
    def failing(self) -> list[tuple[Line, dict[str, Any]]]:
        """Returns the gates that failed, with their cases."""
        return [(line, gate) for line in self.lines for gate in line.gates(False)]

    @property
    def held(self) -> int:
        """Number of gates that held."""
        return sum(len(line.gates(True)) for line in self.lines)

    def ended(self, status: str) -> list[tuple[Line, dict[str, Any]]]:
        """Returns the runs that ended with a status, with their cases."""
        return [(line, row) for line in self.lines for row in line.rows if row["status"] == status]

    @property
    def inputs(self) -> dict[str, Any]:
        """Returns versions and kind of machine, as far as they are the same for all cases."""
        all_inputs = [line.tables.provenance for line in self.lines if line.tables]
        first = all_inputs[0] if all_inputs else {}
        names = [name for name in first if name not in (*OCCASION, *_OF_CASE)]
        return {name: first[name] if all(i.get(name) == first[name] for i in all_inputs) else "mixed" for name in names}

    @property
    def occasion(self) -> dict[str, Any]:
        """Returns the occasion of the newest results."""
        all_inputs = [line.tables.provenance for line in self.lines if line.tables]
        newest = max(all_inputs, key=lambda i: str(i.get("date")), default={})
        return {name: newest.get(name) for name in OCCASION}

    def document(self) -> dict[str, Any]:
        """Returns the contents of the tracked summary.json, without timings and occasion."""
        with_tables = [(line, line.tables) for line in self.lines if line.tables]
        cases = {line.name: {k: tables.provenance[k] for k in _OF_CASE[1:]} for line, tables in with_tables}
        return {
            "provenance": {**self.inputs, "cases": cases},
            "runs": [{**row, **dict.fromkeys(TIMING_FIGURES)} for line in self.lines for row in line.rows],
            "gates": [{"case": line.name, **gate} for line, tables in with_tables for gate in tables.gates],
            "failures": [
                {"case": line.name, "unit": unit, "message": str(why)}
                for line in self.lines
                for unit, why in ([(None, line.refused)] if line.refused else [*line.failures.items()])
            ],
        }


def draw(summary: Summary) -> tuple[list[Figure], list[Figure]]:
    """Draws the tracked figures, and those that hold timings."""
    cells = {line.name: line.cells() for line in summary.lines}
    drifts = {name: c["drift"] for name, c in cells.items() if any(c["drift"].values())}
    counts = {
        name: {who: (count, c["doubtful"][who]) for who, count in c["iterations"].items() if count is not None}
        for name, c in cells.items()
    }
    counts = {name: known for name, known in counts.items() if known}
    tracked, timed = [], []
    if drifts:
        caption = (
            "How far the loops stand open at most, in free runs. MuJoCo default: the softness that a model has if "
            "nothing is said; stiff: the case's stiffest; exact: our solver on exact constraints."
        )
        tracked.append(Figure("drift", caption, figures.drift(drifts)))
    if counts:
        caption = (
            f"Mean iterations a solve; those below {figures.FLOOR:g} are drawn there. The solvers of this project on "
            "exact constraints in lockstep, MuJoCo's CG and PGS in its own free run. Pale: more than one solve in a "
            "hundred did not converge."
        )
        tracked.append(Figure("iterations", caption, figures.iterations(counts)))
    sweeps = {line.name: line.ledger.rows(sweep=True) for line in summary.lines}
    sweeps = {name: rows for name, rows in sweeps.items() if any(row["truth_error_max"] for row in rows)}
    if sweeps:
        caption = (
            "Work against precision: largest distance from the outside truth (rad or m) against the solves a simulated "
            "second, over the timesteps that the case names. Runge–Kutta makes four solves a step. A thin curve on a "
            "wide one: the two agree. Runs that diverged are left out."
        )
        tracked.append(Figure("work", caption, figures.work(sweeps, "solves")))
        caption = "The same against the time that a simulated second takes on this machine."
        timed.append(Figure("time", caption, figures.work(sweeps, "time")))
    return tracked, timed


def write_summary(folders: Sequence[Path], target: Path) -> Path:
    """Writes README.md, summary.json and figures/*.svg and, not to be tracked, index.html and provenance.json.

    Pages of single cases are expected beside them, in folders named like those of the results. Other files stay.

    Args:
        folders: folders of results of the cases.
        target: folder of the summary.

    Raises:
        InputError: results are damaged, or the target cannot be written.
    """
    with believing(folders[0].parent if folders else target):
        summary = Summary(folders)
        tracked, timed = map(drawable, draw(summary))
        text = render("summary.md.j2", summary=summary, figures=tracked, solvers=figures.SOLVERS)
    require_same_page(target / "README.md", text)
    for figure in tracked:
        write_text(target / "figures" / f"{figure.name}.svg", figure.svg())
    write_text(target / "README.md", text)
    write_text(target / "summary.json", _lines(summary.document()))
    more = "".join(f"\n![{figure.name}](figures/{figure.name}.svg)\n\n*{figure.caption}*\n" for figure in timed)
    write_text(target / "index.html", page("oarlock", text + more, [*tracked, *timed], summary.occasion))
    write_text(target / "provenance.json", json.dumps({**summary.inputs, **summary.occasion}, indent=1) + "\n")
    return target


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, dict):
        return {key: _rounded(entry) for key, entry in value.items()}
    return [_rounded(entry) for entry in value] if isinstance(value, list) else value


def _lines(document: dict[str, Any]) -> str:
    """Renders JSON with one line per run and per gate, so that a difference shows which one changed."""
    parts = []
    for key, value in _rounded(document).items():
        if isinstance(value, list):
            entries = ",\n  ".join(json.dumps(entry, ensure_ascii=False, allow_nan=False) for entry in value)
            parts.append(f'"{key}": [\n  {entries}\n ]' if value else f'"{key}": []')
        else:
            parts.append(f'"{key}": {json.dumps(value, ensure_ascii=False, allow_nan=False)}')
    return "{\n " + ",\n ".join(parts) + "\n}\n"
