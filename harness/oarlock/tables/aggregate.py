"""From steps to a row a run, and from rows to a verdict: pure functions of the tables."""

from dataclasses import asdict, dataclass
from itertools import islice
from typing import Any

from oarlock.base.errors import InputError
from oarlock.cases.case import Case
from oarlock.cases.judging import Gate
from oarlock.tables.figures import FIGURES
from oarlock.tables.reductions import Reduction
from oarlock.tables.schema import RunResult


def summarise(result: RunResult) -> dict[str, Any]:
    """The summary row of a run: its key, how it ended, and every figure of ``FIGURES``; None what does not apply."""
    steps, key = result.steps, result.key
    together = [(figure, figure.of) for figure in FIGURES if isinstance(figure.of, Reduction)]
    asked = [expression for _, reduction in together for expression in reduction.ask]
    answers = iter(steps.collect(*(one.alias(str(place)) for place, one in enumerate(asked))).row(0))
    found = {figure.name: reduction.make(*islice(answers, len(reduction.ask))) for figure, reduction in together}
    row: dict[str, Any] = {"run": key.slug, **asdict(key)}
    row.update(status=result.status, message=result.message, steps_done=len(steps))
    for figure in FIGURES:
        row[figure.name] = found[figure.name] if isinstance(figure.of, Reduction) else figure.of(steps)
    return row


@dataclass(frozen=True)
class Verdict:
    """A gate held against one run (or against nothing, if no run was picked)."""

    gate: Gate
    run: str | None
    value: float | str | None
    held: bool | None
    """None: not checked, for no run was picked."""

    def line(self) -> str:
        """One line with figure and limit."""
        value = "not measured" if self.value is None else self.value
        value = value if isinstance(value, str) else f"{value:.4g}"
        return f"{self.gate.figure} = {value} of {self.run or 'no run'}, expected {self.gate.limit} ({self.gate.cause})"


def judge(case: Case, rows: list[dict[str, Any]], *, complete: bool = False) -> list[Verdict]:
    """Holds every gate of a case against every run it picks.

    A gate that picks none is not checked; after a ``complete`` run of the case it has failed, for it can never hold.

    Raises:
        InputError: a gate names a figure or a key that no summary has.
    """
    verdicts = []
    for gate in case.file.gates:
        if rows:
            kind, wanted = (str, "in words") if gate.equal is not None else (int | float, "with a number")
            figures = {name for row in rows for name, value in row.items() if isinstance(value, kind)}
            if gate.figure in rows[0] and gate.figure not in figures and any(row[gate.figure] for row in rows):
                raise InputError(f"gate of case '{case.name}' bounds '{gate.figure}', expected a figure {wanted}")
            unknown = [name for name in (gate.figure, *gate.where) if name not in rows[0]]
            if unknown:
                raise InputError(
                    f"gate of case '{case.name}' names '{unknown[0]}', expected one of: {', '.join(rows[0])}"
                )
        picked = [row for row in rows if all(str(row[k]) == v for k, v in gate.where.items())]
        if not picked:
            verdicts.append(Verdict(gate, None, None, False if complete else None))
        for row in picked:
            value = row[gate.figure]
            whole = row["status"] != "diverged"  # what a run showed before it diverged proves nothing
            verdicts.append(Verdict(gate, row["run"], value, gate.holds(value) and whole))
    return verdicts
