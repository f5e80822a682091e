"""What the runs of a case gave, and how it is judged."""

from dataclasses import asdict, dataclass, field
from typing import Any

import polars as pl

from oarlock.cases.case import Case
from oarlock.cases.case_file import Gate
from oarlock.mechanics.names import coordinates, equalities
from oarlock.mechanics.reactions import verdict
from oarlock.stepping.prepared import PreparedCase
from oarlock.tables.aggregate import Verdict


@dataclass
class Results:
    """What a run gave.

    Attributes:
        summary: a row a run (polars).
        steps: a row a run and step (polars).
        rows: the summary as plain dictionaries.
        tables: the steps, a lazy table a run. A long run that is kept in a folder is read from there.
        frames: the same, each table in memory.
        verdicts: what the case expects and its gates, held against the model and the runs.
        provenance: versions, platform, commit, date.
    """

    case: Case
    rows: list[dict[str, Any]] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    provenance: dict[str, Any] = field(default_factory=dict)
    tables: list[pl.LazyFrame] = field(default_factory=list)

    @property
    def summary(self) -> pl.DataFrame:
        """A row a run."""
        return pl.DataFrame(self.rows, infer_schema_length=None)

    @property
    def steps(self) -> pl.DataFrame:
        """A row a run and step."""
        return pl.concat(self.tables).collect() if self.tables else pl.DataFrame()

    @property
    def frames(self) -> list[pl.DataFrame]:
        """The steps, a table a run."""
        return pl.collect_all(self.tables)

    @property
    def failures(self) -> list[Verdict]:
        """Gates that did not hold."""
        return [verdict for verdict in self.verdicts if verdict.held is False]

    def document(self) -> dict[str, Any]:
        """The summary JSON of the contract."""
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


def ending(row: dict[str, Any]) -> str:
    """Why the run of a row of the summary is not ``done``, in words."""
    if row["status"] == "unprojected":
        return f"{row['unprojected']} of {row['steps_done']} projections did not reach the constraints"
    return row["message"] or f"{row['unconverged']} of {row['solves']} solves did not converge"


def describe(setup: PreparedCase) -> dict[str, Any]:
    """What the model turns out to be at its consistent start."""
    start = setup.start
    return {
        "nq": int(setup.model.nq),
        "nv": int(setup.model.nv),
        "rows": start.rows,
        "rank": start.rank,
        "dof": start.dof,
        "closing_moved": start.moved,
        "unique_reactions": start.unique,
        "coordinates": coordinates(setup.model),
        "equalities": [asdict(equality) for equality in equalities(setup.model)],
    }


def case_document(case: Case, model: dict[str, Any]) -> dict[str, Any]:
    """The contents of ``case.json``: the case with the description of its model."""
    contents = {**case.file.model_dump(), "expect": case.expected(), "parameters": case.parameters}
    return {"name": case.name, "model": model, **contents}


def expectations(case: Case, model: dict[str, Any]) -> list[Verdict]:
    """What the case expects of its model, held against the model's description."""
    found = {**model, "reactions": verdict(model["unique_reactions"])}
    verdicts = []
    for name, expected in case.expected().items():
        bounds = {"equal": expected} if isinstance(expected, str) else {"min": expected, "max": expected}
        gate = Gate.model_validate({"figure": name, **bounds, "cause": "[expect] of the case"})
        verdicts.append(Verdict(gate, "start", found[name], gate.holds(found[name])))
    return verdicts
