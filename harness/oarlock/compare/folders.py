"""One side of ``oarlock diff``: the runs, gates and provenance in a folder of results, of one case or many."""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from oarlock.base.errors import InputError
from oarlock.tables.folder import ResultFolder
from oarlock.tables.ledger import NAME as LEDGER
from oarlock.tables.ledger import Failure, Ledger

SUMMARY = "summary.json"

KEYS = (
    "case",
    "run",
    "mode",
    "walker",
    "solver",
    "form",
    "integrator",
    "settings",
    "stepping",
    "timestep_s",
    "steps",
    "stabilisation",
    "status",
)
"""Columns that every row of a summary must have; all but the last identify the run."""

_RELAXED = (
    (),
    ("stepping",),
    ("stepping", "steps"),
    ("stepping", "steps", "timestep_s"),
    ("stepping", "steps", "timestep_s", "stabilisation"),
    ("stepping", "steps", "timestep_s", "stabilisation", "integrator"),
)
"""Sets of keys in which counterparts may differ, tried in this order, if one run is left on either side."""

_EXPECTED = "expected a folder that 'oarlock run --out' or 'oarlock suite --out' wrote"


@dataclass(frozen=True)
class Run:
    """A run of a folder.

    Attributes:
        row: its row in the summary.
        folder: folder that may hold its steps.
        point: point of a sweep, in words; empty for the case as it is.
        sweep: name of the folder of a sweep that was asked for by ``--sweep``; another may have the same points.
    """

    row: dict[str, Any]
    folder: ResultFolder
    point: str = ""
    sweep: str = ""

    @property
    def case(self) -> str:
        """Name of the case."""
        return self.row["case"]

    @property
    def name(self) -> str:
        """Name of the run, unique within the case."""
        return f"{self.row['run']}-at-{self.point}" if self.point else self.row["run"]

    @property
    def steps(self) -> Path | None:
        """Path of the table of its steps; None if there is none."""
        path = self.folder.steps_path(self.row["run"])
        return path if not self.point and path.is_file() else None


@dataclass
class Side:
    """The contents of a folder of results.

    Attributes:
        path: the folder, as it was given.
        runs: its runs, in their order.
        gates: pairs of a case and the verdict of a gate.
        provenance: case → versions, platform, digests.
        cases: case → ``case.json``, where there is one.
        failures: case and unit (None for all units) → why it was not finished.
    """

    path: Path
    runs: list[Run] = field(default_factory=list)
    gates: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    provenance: dict[str, dict[str, Any]] = field(default_factory=dict)
    cases: dict[str, dict[str, Any]] = field(default_factory=dict)
    failures: dict[tuple[str, str | None], Failure] = field(default_factory=dict)

    def failure(self, run: Run) -> Failure | None:
        """Returns why this side lacks a run; None if it does not know."""
        return self.failures.get((run.case, run.name), self.failures.get((run.case, None)))


def read_side(path: Path) -> Side:
    """Reads a folder of results: of one case, of a suite, of a sweep, or a published one.

    Raises:
        InputError: the folder is missing or holds no results, or a file is damaged.
    """
    if not path.is_dir():
        raise InputError(f"no folder '{path}', {_EXPECTED}")
    side = Side(path)
    for folder in _folders(path):
        _read(side, ResultFolder(folder), top=folder == path)
    if not side.runs and not side.failures:
        raise InputError(f"no runs in '{path}', {_EXPECTED}")
    return side


def _folders(path: Path) -> Iterator[Path]:
    below = sorted(child for child in path.iterdir() if child.is_dir())
    single = (path / SUMMARY).is_file() or (path / LEDGER).is_file()
    for folder in [path] if single else below:
        sweeps = sorted(child for child in folder.glob("sweep-*") if child.is_dir())
        yield from (one for one in (folder, *sweeps) if (one / SUMMARY).is_file() or (one / LEDGER).is_file())


def _read(side: Side, folder: ResultFolder, *, top: bool) -> None:
    ledger = Ledger.read(folder.path, strict=True)
    swept: list[dict[str, Any]] = []
    if (folder.path / SUMMARY).is_file():
        document = folder.read_json(SUMMARY, bare=True)
        _require_summary(folder.path / SUMMARY, document)
        provenance = document["provenance"]
        if "cases" not in provenance:
            folder.read_json(SUMMARY)  # only what is published, over several cases, is without a checksum
        shared = {key: value for key, value in provenance.items() if key not in ("case", "cases")}
        if "cases" in provenance and not top:
            return  # the page of a whole suite repeats the runs of its cases
        swept = document["runs"] if "sweep" in document else []
        for case, own in provenance.get("cases", {provenance.get("case"): {}}).items():
            if case in side.provenance and "sweep" not in document:
                raise InputError(f"'{side.path}' holds results of '{case}' twice, expected one folder a case")
            side.provenance.setdefault(case, {**shared, **own})
        sweep = folder.path.name if swept else ""
        side.runs += [Run(row, folder, _point(row), sweep) for row in document["runs"]]
        side.gates += [(str(gate.get("case", provenance.get("case"))), gate) for gate in document["gates"]]
        if (folder.path / "case.json").is_file():
            told = folder.read_json("case.json")
            told.pop("model_file", None)  # where it was is no condition; its checksum is in the provenance
            side.cases[provenance.get("case")] = told
    if not swept:
        side.runs += [Run(row, folder, _point(row)) for row in ledger.rows(sweep=True)]
    if ledger.refused:
        side.failures[ledger.case, None] = Failure("refused", ledger.refused)
    side.failures |= {(ledger.case, unit): failure for unit, failure in ledger.failures().items()}


def _point(row: dict[str, Any]) -> str:
    return ",".join(f"{key}={value!r}" for key, value in row.get("point", {}).items())


def _require_summary(path: Path, document: Any) -> None:
    kinds = {"provenance": dict, "runs": list, "gates": list}
    for key, kind in kinds.items():
        if not isinstance(document.get(key), kind):
            raise InputError(f"'{path}' has no {key}, {_EXPECTED}")
    for row in document["runs"]:
        lacking = [key for key in KEYS if not isinstance(row, dict) or key not in row]
        if lacking:
            raise InputError(f"'{path}' has a run without '{lacking[0]}': another schema, {_EXPECTED}")
    for gate in document["gates"]:
        lacking = [key for key in ("figure", "where", "run", "value", "held") if key not in gate]
        if lacking:
            raise InputError(f"'{path}' has a gate without '{lacking[0]}': another schema, {_EXPECTED}")


# Which run is which.


def match(before: list[Run], after: list[Run]) -> tuple[list[tuple[Run, Run]], list[Run], list[Run]]:
    """Matches runs: returns pairs of counterparts, and the runs that are left over on either side."""
    pairs: list[tuple[Run, Run]] = []
    single = len({run.case for run in before}) == len({run.case for run in after}) == 1
    for without in (*_RELAXED, *([("case", *_RELAXED[-1])] if single else [])):
        here, there = _by_identity(before, without), _by_identity(after, without)
        for identity, runs in here.items():
            others = there.get(identity, [])
            if len(runs) == len(others) == 1:
                pairs.append((runs[0], others[0]))
        taken = {id(run) for pair in pairs for run in pair}
        before = [run for run in before if id(run) not in taken]
        after = [run for run in after if id(run) not in taken]
    return pairs, before, after


def _by_identity(runs: Iterable[Run], without: tuple[str, ...]) -> dict[tuple[Any, ...], list[Run]]:
    found: dict[tuple[Any, ...], list[Run]] = defaultdict(list)
    keys = [key for key in KEYS if key not in (*without, "run", "status")]
    for run in runs:
        found[*(run.row[key] for key in keys), run.point, run.sweep].append(run)
    return found


def require_same_schema(one: Side, other: Side, pairs: list[tuple[Run, Run]]) -> None:
    """Checks that counterparts have the same figures.

    Raises:
        InputError: two of them have not; the message names the first figure.
    """
    for before, after in pairs:
        for left, right, lacks, has in ((before, after, other, one), (after, before, one, other)):
            missing = [key for key in left.row if key not in right.row]
            if missing:
                raise InputError(
                    f"'{lacks.path}' has no figure '{missing[0]}', which '{has.path}' has, expected results of one "
                    "version of oarlock"
                )
