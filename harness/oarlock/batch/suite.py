"""Many cases at once: plans the units of all, has them done in parallel, resumes where it stopped, judges every case.

A case that cannot be run never stops the others. Its results land in a folder of its own, as ``oarlock run --out``
writes them, with the suite's ledger beside them.
"""

import json
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import polars as pl

from oarlock.base.answer import Answer, html_table
from oarlock.base.cores import cores
from oarlock.base.errors import InputError, choose, few, one_line
from oarlock.base.options import split_options
from oarlock.base.progress import Progress
from oarlock.batch import pages
from oarlock.batch.sweep import (
    Axis,
    flat,
    folder_name,
    missing,
    plan_sweep,
    same_swept,
    sweep_document,
    tasks_of,
    write_table,
)
from oarlock.batch.unit import Unit, plan_units, run_unit
from oarlock.batch.workers import LocalWorkers, Workers, dispatch
from oarlock.cases.case import Case, load_case, model_names, variant_names
from oarlock.cases.point import KEYS
from oarlock.experiments.description import case_document, expectations
from oarlock.experiments.holdings import others
from oarlock.experiments.laboratory import Laboratory
from oarlock.experiments.opening import open_case
from oarlock.experiments.outcome import Results
from oarlock.experiments.task import Task
from oarlock.tables.aggregate import Verdict, judge
from oarlock.tables.folder import OCCASION, ResultFolder
from oarlock.tables.ledger import NAME, TABLE, Failure, Ledger, Outcome
from oarlock.tables.provenance import inputs, occasion


@dataclass
class Member:
    """A case of a suite.

    Attributes:
        asked: what ``load_case`` takes.
        name: name of the case.
        case: None if it is refused.
        refused: why it cannot be run at all; empty if it can.
        units: what there is to do, finished or not.
        ledger: what was done.
        verdicts: what the case expects and its gates, once it was judged.
        lost: rows of the runs that ended neither ``done`` nor as the case expects, once it was judged.
        axes: what is swept; empty if it is the case's own experiments that are run.
    """

    asked: str
    name: str
    case: Case | None
    refused: str
    ledger: Ledger
    units: list[Unit] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    lost: list[dict[str, Any]] = field(default_factory=list)
    axes: tuple[Axis, ...] = ()

    @property
    def failures(self) -> list[Verdict]:
        """Gates that did not hold."""
        return [verdict for verdict in self.verdicts if verdict.held is False]

    @property
    def names(self) -> list[str]:
        """Names of its units."""
        return [unit.name for unit in self.units]

    @property
    def folder(self) -> ResultFolder:
        """Where its results lie."""
        return self.ledger.folder


COLUMNS = {"case": "case", "run": "run", "status": "status", "drift_pos_max": "drift", "truth_error_max": "truth error"}
"""Figure of the summary → title, of what is shown of a run of many at a glance."""


@dataclass
class Suite(Answer):
    """Cases with what was asked of them.

    Attributes:
        members: the cases.
        out: folder of the results, a folder a case.
        every: whether these are all the models that there are.
        repeated: units that had to be done.
        summary: a row a run (polars).
        failures: a row for each case or unit that was not done (polars).
        unwritten: pages of the report that was asked for with it that could not be written, and why.
    """

    FRAMES = ("summary", "failures")

    members: list[Member]
    out: Path = Path()
    every: bool = False
    repeated: int = 0
    unwritten: list[str] = field(default_factory=list)

    @property
    def summary(self) -> pl.DataFrame:
        """A row a run."""
        return pl.DataFrame(self.document()["runs"], infer_schema_length=None)

    @property
    def failures(self) -> pl.DataFrame:
        """A row for each case that was refused and each unit that was not done: case, unit, message."""
        names = ("case", "unit", "message")
        return pl.DataFrame(self.document()["failures"], schema=dict.fromkeys(names, pl.String))

    @property
    def status(self) -> int:
        """As the exit status: 2 a model was refused or a page not written, 1 a gate or a unit failed, 0 neither."""
        return max(status_of(self), 2 if self.unwritten else 0)

    def document(self) -> dict[str, Any]:
        """The summary JSON over all cases."""
        documents = [_document(member) for member in self.members]
        documents = [document for document in documents if document]
        own = ("case", "model_sha256", "case_sha256")
        common: dict[str, Any] = {}
        for document in documents:
            common.update({k: v for k, v in document["provenance"].items() if k not in own})
        cases = {d["provenance"]["case"]: {k: d["provenance"][k] for k in own[1:]} for d in documents}
        return {
            "provenance": {**common, "cases": cases},
            "runs": [row for document in documents for row in document["runs"]],
            "gates": [{"case": d["provenance"]["case"], **gate} for d in documents for gate in d["gates"]],
            "failures": [
                {"case": member.name, "unit": unit, "message": str(why)}
                for member in self.members
                for unit, why in {**({None: member.refused} if member.refused else {}), **failed(member)}.items()
            ],
        }

    def report(self, folder: str | Path) -> Path:
        """Writes the page of every case and the summary, as ``oarlock suite --report``; what stands is not repeated."""
        with closing(LocalWorkers(cores())) as workers:
            unwritten = self.write_pages(Path(folder), workers, Progress())
        if unwritten:
            raise InputError(f"pages not written: {few(unwritten)}")
        return Path(folder)

    def write_pages(self, folder: Path, workers: Workers, progress: Progress) -> list[str]:
        """Writes the same; gives what could not be written, and why."""
        return pages.write_pages(
            self.out, [member.folder.path for member in self.members], folder, workers, progress, every=self.every
        )

    def _repr_html_(self) -> str:
        document = self.document()
        failures = [f"{one['case']} {one['unit'] or ''}: {one['message']}" for one in document["failures"]]
        failures += [
            f"gate failed: {member.name}: {verdict.line()}" for member in self.members for verdict in member.failures
        ]
        head = f"{len(self.members)} cases, {len(document['runs'])} runs"
        return html_table(head, *self._table(document), failures)

    def _table(self, document: dict[str, Any]) -> tuple[list[str], list[list[Any]]]:
        return list(COLUMNS.values()), [[row[name] for name in COLUMNS] for row in document["runs"]]


@dataclass
class Sweep(Suite):
    """Cases whose own runs were left for free runs at every point of a sweep.

    Attributes:
        axes: what is swept.
        skipped: name of a case → swept parameters that it does not have.
        summary: a row a run, its point in the first columns (polars).
    """

    axes: tuple[Axis, ...] = ()
    skipped: dict[str, list[str]] = field(default_factory=dict)

    @property
    def summary(self) -> pl.DataFrame:
        """A row a run, its point in the first columns."""
        rows = [flat(row["point"], row) for row in self.document()["runs"]]
        return pl.DataFrame(rows, infer_schema_length=None)

    @property
    def tables(self) -> list[Path]:
        """The tables as CSV, one a case, where there is one."""
        paths = [member.folder.path / TABLE for member in self.members]
        return [path for path in paths if path.is_file()]

    def document(self) -> dict[str, Any]:
        """The summary JSON over all cases, with what was swept."""
        document = super().document()
        return {
            "provenance": document.pop("provenance"),
            "sweep": [axis.document() for axis in self.axes],
            **document,
        }

    def report(self, folder: str | Path) -> Path:
        """Writes the page of every case's sweep, as ``oarlock suite --sweep``, and one that leads to them."""
        super().report(folder)
        pages.write_sweep_index([member.folder.path for member in self.members], Path(folder))
        return Path(folder)

    def write_pages(self, folder: Path, workers: Workers, progress: Progress) -> list[str]:
        """Writes the page of every case's sweep; no other page is touched. Gives what could not be written, and why."""
        sweeps = [member.folder.path for member in self.members]
        return pages.write_sweep_pages(self.out, sweeps, folder, workers, progress)

    def _table(self, document: dict[str, Any]) -> tuple[list[str], list[list[Any]]]:
        titles, rows = super()._table(document)
        keys = [axis.key for axis in self.axes]
        points = [[row["point"][key] for key in keys] for row in document["runs"]]
        return [*keys, *titles], [[*point, *row] for point, row in zip(points, rows, strict=True)]


def failed(member: Member) -> dict[str, Failure]:
    """Name of a unit of a case that was not done → why."""
    return member.ledger.failures()


def _document(member: Member) -> dict[str, Any] | None:
    try:
        return member.folder.read_json("summary.json") if member.ledger.rows(sweep=bool(member.axes)) else None
    except InputError:
        return None


def asked_for(models: Sequence[str]) -> list[tuple[str, Case | None, str]]:
    """What ``load_case`` takes, the case, and why there is none; variants after their model.

    Raises:
        InputError: no such model, or two of one name.
    """
    found: list[tuple[str, Case | None, str]] = []
    for model in models or model_names():
        text, given = (model, {}) if Path(model).exists() else split_options(model, "parameter")
        known = text in model_names()
        where = model if known else f"{Path(text).resolve()}{model[len(text) :]}"
        if not known and not Path(text).exists():
            load_case(model)  # says which models there are
        try:
            asked = [where] if given else variant_names(where)
            found += [(name, open_case(name), "") for name in asked]
        except InputError as error:
            found.append((where, None, one_line(error)))
    names: dict[str, str] = {}
    for asked, case, _ in found:
        slug = _slug(asked, case)
        if names.setdefault(slug, asked) != asked:
            raise InputError(f"'{names[slug]}' and '{asked}' are both called '{slug}', expected names of their own")
    return list({asked: (asked, case, refused) for asked, case, refused in found}.values())


def _slug(asked: str, case: Case | None) -> str:
    return case.slug if case else Path(asked).stem if asked.endswith((".xml", ".py")) else Path(asked).name


def plan_suite(models: Sequence[str], out: Path, axes: tuple[Axis, ...] = ()) -> Suite:
    """The suite of some models, or of all that there are, with what ``out`` holds of it.

    With ``axes`` it is the sweep of each that is planned, instead of its own experiments: in a folder within that of
    its results, so that neither knows of the other. Models that lack a parameter are left out, and so are variants
    that differ from a model before them in nothing but what is swept.

    Raises:
        InputError: no such model, two of one name, or a sweep that none of them can have. A case that is at fault is
            refused by itself.
    """
    sweep = Sweep([], out, not models, axes=axes)
    suite = sweep if axes else Suite([], out, not models)
    known, swept = dict.fromkeys(KEYS), set()
    for asked, case, refused in asked_for(models):
        slug = _slug(asked, case)
        if axes and case:
            known.update(dict.fromkeys(case.parameters))
            lacking, same = missing(case, axes), same_swept(case, axes)
            if lacking:
                sweep.skipped[case.name] = lacking
            if lacking or same in swept:
                continue
            swept.add(same)
        path = out / slug / folder_name(axes) if axes else out / slug
        member = Member(asked, case.name if case else slug, case, refused, Ledger.read(path), axes=axes)
        member.ledger.case = member.name
        tasks: list[Task] = []
        if case:
            try:
                member.units, tasks = ([], tasks_of(case)) if axes else (plan_units(asked, case), [])
            except InputError as error:
                member.refused = one_line(error)
        if case and tasks:
            member.units = plan_sweep(asked, case, axes, tasks)
        suite.members.append(member)
    if sweep.skipped and not any(member.case for member in suite.members):
        for key in (key for lacking in sweep.skipped.values() for key in lacking):
            choose("key of --sweep", key, list(known))
        raise InputError(f"no model here has {few([axis.key for axis in axes])}, expected keys that go together")
    return suite


def carry_out(suite: Suite, workers: Workers, *, fresh: bool = False, progress: Progress | None = None) -> None:
    """Does what is not finished, keeps each unit as soon as it is, and judges every case, also when interrupted.

    Raises:
        InputError: the results cannot be written.
    """
    progress = progress or Progress()
    owners: dict[Unit, Member] = {}
    total = 0
    for member in suite.members:
        if member.refused:
            continue
        member.ledger.settle(member.names)
        total += len(member.units)
        todo = [unit for unit in member.units if fresh or not member.ledger.finished(unit.name, unit.digest)]
        owners.update({_estimated(unit, member.ledger): member for unit in todo})
    suite.repeated = len(owners)
    progress.begin("running", total, total - len(owners))
    # The longest first: the last ones to finish are short.
    work = sorted(owners, key=lambda unit: -unit.cost)
    try:
        with closing(dispatch(run_unit, work, workers)) as all_done:
            for done in all_done:
                unit = done.item
                failure = None if done.error is None else Failure("failed", one_line(str(done.error)))
                outcome = Outcome(failure) if failure else done.result
                owners[unit].ledger.keep(unit.name, unit.digest, dict(unit.point.values), outcome)
                progress.advance(1)
                progress.finished(unit.label, outcome.seconds, str(outcome.failure or ""))
    finally:
        moment = occasion()
        for member in suite.members:
            collate(member, moment)


def refuse_others(suite: Suite) -> None:
    """Refuses folders that hold results of ``oarlock run`` other than those that the suite would write.

    Raises:
        InputError: there is such a folder.
    """
    for member in suite.members:
        path, case = member.folder.path, member.case
        if member.axes or case is None or member.refused or (path / NAME).exists() or not any(path.glob("*.json")):
            continue
        runs = [run for unit in member.units for run in unit.runs]
        try:
            setup = Laboratory(case).setup(member.units[0].task.integrator, member.units[0].task.settings)
        except InputError:
            continue  # its units say so
        held = others(path, case.name, runs, setup.timestep_s, setup.steps, setup.ignored, setup.told)
        if held:
            raise InputError(f"'{path}' holds {held} of 'oarlock run', expected another folder (--out), or none there")


def _estimated(unit: Unit, ledger: Ledger) -> Unit:
    """The unit with the time that it took before as its cost."""
    seconds = ledger.seconds(unit.name)
    return unit if seconds is None else replace(unit, cost=seconds)


def collate(member: Member, moment: dict[str, Any]) -> None:
    """Judges a case on its finished units and writes ``case.json`` and ``summary.json``, where they would change.

    Of a sweep, which no gate bounds, ``summary.json`` and the table.
    """
    ledger, case = member.ledger, member.case
    if case is not None and not member.refused:
        ledger.settle(member.names)
        try:
            if member.axes:
                _tabulate(member, case, moment)
            else:
                _judge(member, case, moment)
        except InputError as error:
            member.refused = one_line(error)
    if ledger.refused != member.refused or member.refused:
        ledger.refused = member.refused
        ledger.write()


def _tabulate(member: Member, case: Case, moment: dict[str, Any]) -> None:
    document = sweep_document(member.ledger, member.units, case, member.axes, {**inputs(case), **moment})
    if document["runs"] or document["failures"]:
        _write_changed(member.folder, "summary.json", document)
        write_table(document, member.ledger.failures(), member.folder.path / TABLE)


def _judge(member: Member, case: Case, moment: dict[str, Any]) -> None:
    ledger, rows, model = member.ledger, member.ledger.rows(), member.ledger.model()
    told = {"motion": model["motion"]} if model and "motion" in model else {}
    results = Results(case, rows=rows, provenance={**inputs(case), **told, **moment}, sums=ledger.sums())
    if model is not None:
        results.verdicts += expectations(case, model)
        _write_changed(ledger.folder, "case.json", case_document(case, model))
    complete = len(ledger.entries) == len(member.units) and not ledger.failures()
    if rows:
        # Bounds hold for the parameters that they were set for.
        results.verdicts += judge(case, rows if case.listed else [], complete=complete and case.listed)
        _write_changed(ledger.folder, "summary.json", results.kept())
        ledger.folder.forget_steps_but([row["run"] for row in rows])
    member.verdicts, member.lost = results.verdicts, results.lost


def _write_changed(folder: ResultFolder, name: str, document: dict[str, Any]) -> None:
    """Writes a document, unless the one that is there differs in nothing but its occasion."""
    try:
        if _timeless(folder.read_json(name)) == _timeless(json.loads(json.dumps(document))):
            return
    except InputError:
        pass
    folder.write_json(name, document)


def _timeless(document: dict[str, Any]) -> dict[str, Any]:
    provenance = {k: v for k, v in document.get("provenance", {}).items() if k not in OCCASION}
    return {**document, "provenance": provenance}


def status_of(suite: Suite) -> int:
    """Exit status: 2 a model was refused, 1 a gate failed or a unit did, or a run ended otherwise than expected."""
    if any(
        member.refused or any(why.status == "refused" for why in failed(member).values()) for member in suite.members
    ):
        return 2
    return int(any(member.failures or member.lost or failed(member) for member in suite.members))
