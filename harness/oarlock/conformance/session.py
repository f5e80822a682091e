"""A matrix from planning to figures: draws states, has every engine answer, compares, all in units that resume."""

from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import polars as pl

from oarlock.base.answer import Answer, html_table
from oarlock.base.arguments import require_count, require_number
from oarlock.base.errors import InputError, few, one_line
from oarlock.base.files import reading
from oarlock.base.forks import require_threads
from oarlock.base.lock import locked
from oarlock.base.progress import Progress
from oarlock.base.scratch import sweep_up
from oarlock.batch.session import workers_of
from oarlock.batch.workers import Workers, dispatch
from oarlock.cases.case import load_case
from oarlock.conformance.causes import FAILED, READER, UNEXPLAINED
from oarlock.conformance.states import Plan
from oarlock.conformance.units import ASK, STATES, Compare, DrawStates, Question, Work, do, slug
from oarlock.conformance.versions import changes
from oarlock.engines import environments
from oarlock.engines.asking import Files
from oarlock.engines.environments import Environment
from oarlock.engines.registry import Engine, parse_engine, programs
from oarlock.engines.running import SILENCE_S
from oarlock.tables import provenance
from oarlock.tables.ledger import Failure, Ledger, Outcome

MUJOCO = "mujoco"
"""Name of the engine that has versions to be asked."""

RESULTS = Path("results") / "conform"
"""Folder of the results unless another is given."""

KEPT = ("answers", "figures")
"""First words of the units of engines."""

STATES_DRAWN = 24
"""States that are drawn of a model unless something else is asked for."""


@dataclass
class Member:
    """A model of a matrix.

    Attributes:
        asked: what ``load_case`` takes.
        name: of the case.
        ledger: what was done.
        refused: why it cannot be asked about; empty if it can.
        plan: what is asked; None until its states are drawn.
        names: of its units so far.
    """

    asked: str
    name: str
    ledger: Ledger
    refused: str = ""
    plan: Plan | None = None
    names: list[str] = field(default_factory=list)

    def files(self, folder: str) -> Files:
        """The finished files in a folder of its results, by their names within it."""
        prefix = f"{folder}/"
        found = {}
        for entry in self.ledger.entries.values():
            for name in entry["files"]:
                if name.startswith(prefix):
                    with reading(self.ledger.folder.path / name) as path:
                        found[name.removeprefix(prefix)] = path.read_bytes()
        return found

    def marks(self, unit: str) -> dict[str, str]:
        """Checksums of the files of a unit."""
        return dict(self.ledger.entries[unit]["files"])


@dataclass
class Matrix(Answer):
    """Models × engines.

    Attributes:
        members: the models.
        engines: the engines, by name, in the order asked for.
        rows: a row of figures of every pair that was compared.
        failures: (model, engine) → why it has none.
        states: drawn of each model; seed: of all random numbers.
        tolerance: largest difference that passes; None where nothing but what is unexplained fails.
        repeated: units that were done, and not kept from before.
        offered: engines that come with oarlock, were not asked for and are not there.
    """

    FRAMES = ("figures",)

    members: list[Member]
    engines: dict[str, Engine]
    states: int
    seed: int
    tolerance: float | None
    rows: list[dict[str, Any]] = field(default_factory=list)
    failures: dict[tuple[str, str], Failure] = field(default_factory=dict)
    repeated: int = 0
    offered: tuple[str, ...] = ()

    def beyond(self, row: dict[str, Any]) -> str:
        """Why a row does not pass, in words; empty if it does."""
        difference = row["difference"]
        if row["cause"] == UNEXPLAINED and (self.tolerance is None or row["contradicted"]):
            return row["verdict"]
        if self.tolerance is None:
            return ""
        if difference is None and row["cause"] != READER:
            return f"nothing was compared, expected differences of at most {self.tolerance:g}: {row['verdict']}"
        if difference is not None and difference > self.tolerance:
            return f"q̈ differs by {difference:.3g}, allowed are {self.tolerance:g}"
        return ""

    @property
    def status(self) -> int:
        """Exit status: 2 a model was refused, 1 an engine failed or is beyond the tolerance, 0 else."""
        if any(member.refused for member in self.members):
            return 2
        return int(bool(self.failures) or any(map(self.beyond, self.rows)))

    @property
    def figures(self) -> pl.DataFrame:
        """A row a model and engine that were compared: figures, cause and verdict."""
        plain = [{key: value for key, value in row.items() if not isinstance(value, dict | list)} for row in self.rows]
        return pl.DataFrame(plain, infer_schema_length=None)

    def changes(self) -> list[str]:
        """What changed from one version of MuJoCo to the next, in words, where versions are what was asked."""
        return changes(self.rows)

    def report(self, folder: str | Path) -> Path:
        """Writes the page with the matrix, as ``oarlock conform --report``."""
        from oarlock.conformance.page import write_page

        return write_page(self.document(), Path(folder))

    def _repr_html_(self) -> str:
        from oarlock.conformance.page import COLUMNS

        rows = [[row[name] for name in ("model", "engine", *COLUMNS, "verdict")] for row in self.rows]
        notes = [f"{model} {engine}: {why}" for (model, engine), why in self.failures.items()]
        notes += [f"{member.name}: {member.refused}" for member in self.members if member.refused]
        head = f"{len(self.members)} models, {len(self.engines)} engines, {self.states} states of each model"
        return html_table(head, ["model", "engine", *COLUMNS.values(), "verdict"], rows, notes)

    def document(self) -> dict[str, Any]:
        """As ``oarlock conform --json``."""
        return {
            "provenance": {**provenance.versions(), **provenance.occasion()},
            "states": self.states,
            "seed": self.seed,
            "tolerance": self.tolerance,
            "models": [{"model": member.name, "refused": member.refused or None} for member in self.members],
            "engines": [{"engine": name, "title": engine.program.title} for name, engine in self.engines.items()],
            "rows": [{**row, "passed": not self.beyond(row)} for row in self.rows],
            "failures": [
                {"model": model, "engine": engine, "cause": FAILED, "message": str(why)}
                for (model, engine), why in self.failures.items()
            ],
        }


def available() -> list[Engine]:
    """The engines that come with oarlock and whose environments are there."""
    found = (parse_engine(name) for name in programs())
    return [engine for engine in found if environments.find(engine) is not None]


def require_engines(engines: Sequence[str]) -> list[Engine]:
    """Engines by name, each once and each there.

    Args:
        engines: ``NAME[@VERSION][:key=value,…][=PYTHON]``.

    Raises:
        InputError: no such engine, one that is not there, or one that is named twice.
    """
    chosen = _once(engines)
    for engine in chosen:
        if environments.find(engine) is None:
            raise _lacking(engine)
    return chosen


def _once(engines: Sequence[str]) -> list[Engine]:
    chosen = [parse_engine(text) for text in engines]
    if len({engine.name for engine in chosen}) < len(chosen):
        raise InputError(f"engines {few([engine.name for engine in chosen])}, expected each once")
    return chosen


def _lacking(engine: Engine) -> InputError:
    return InputError(f"engine '{engine.name}' is not installed: {environments.how_to(engine)}")


def conform(
    models: Sequence[str] | str,
    engine: Sequence[str] | str = (),
    *,
    states: int = STATES_DRAWN,
    seed: int = 0,
    tolerance: float | None = None,
    out: str | Path = RESULTS,
    jobs: int | None = None,
    scheduler: str | None = None,
    install: bool = False,
    fresh: bool = False,
    engine_timeout: float = SILENCE_S,
    progress: Progress | None = None,
) -> Matrix:
    """Has engines answer about the same states of models, and compares.

    Args:
        models: one or several models, variants or MJCF files.
        engine: one or several ``NAME[@VERSION][:key=value,…][=PYTHON]``; those that are there if there are none.
        states: drawn of each model, besides its start and some at rest.
        seed: of all random numbers.
        tolerance: largest relative difference of accelerations to the nearer of MuJoCo and the exact solution.
        out: folder for the results, a folder a model; what is there is kept.
        jobs: units at once; one a core if left out.
        scheduler: address of a dask.distributed scheduler, or ``local``.
        install: make the environments that are not there.
        fresh: do everything anew.
        engine_timeout: time that an engine may be silent, s; 0 for ever.
        progress: listens.

    Raises:
        InputError: no such model or engine, an engine that is not there, or results that cannot be written.
    """
    require_threads()
    require_count("states", states)
    require_number("tolerance", tolerance)
    require_number("engine_timeout", engine_timeout, unit="s")
    models, engines = ([one] if isinstance(one, str) else list(one) for one in (models, engine))
    progress = progress or Progress()
    chosen = _once(engines) or available()
    matrix = Matrix(_members(models, Path(out)), {engine.name: engine for engine in chosen}, states, seed, tolerance)
    homes = _homes(matrix, bool(engines), install, progress)
    folders = [member.ledger.folder.path for member in matrix.members]
    with (
        locked(folders, "oarlock conform", progress.note),
        workers_of(jobs, scheduler, None, progress) as (workers, _),
    ):
        if left := sweep_up(folders):
            progress.note(left)
        _carry_out(matrix, homes, workers, fresh, engine_timeout, progress)
    return matrix


def versions(models: Sequence[str] | str, mujoco: Sequence[str] | str, **options: Any) -> Matrix:
    """Asks versions of MuJoCo about models: ``changes`` of what it gives says what changed, at which one and why.

    Args:
        models: one or several models, variants or MJCF files.
        mujoco: versions, the oldest first: a list, or separated by commas, ``"3.6,4.0"``.
        options: as of ``conform``.

    Raises:
        InputError: as ``conform``, or no versions.
    """
    given = mujoco.split(",") if isinstance(mujoco, str) else mujoco
    named = [version.strip() for version in given if version.strip()]
    if not named:
        raise InputError(f"versions {mujoco!r}, expected some, such as 3.6,3.7")
    return conform(models, [f"{MUJOCO}@{version}" for version in named], **options)


def _members(models: Sequence[str], out: Path) -> list[Member]:
    members: dict[str, Member] = {}
    for asked in models:
        case = load_case(asked)
        if case.slug in members and members[case.slug].asked != asked:
            raise InputError(f"'{members[case.slug].asked}' and '{asked}' are both called '{case.slug}'")
        members[case.slug] = Member(asked, case.name, Ledger.read(out / case.slug, case.name))
        members[case.slug].ledger.case = case.name
    return list(members.values())


def _homes(matrix: Matrix, named: bool, install: bool, progress: Progress) -> dict[str, Environment]:
    """The environments of the engines; one that is not there and was asked for is an error."""
    homes: dict[str, Environment] = {}
    for name, engine in matrix.engines.items():
        found = environments.make(engine, progress.note) if install else environments.find(engine)
        if found is None and named:
            raise _lacking(engine)
        if found is not None:
            homes[name] = found
    if not named:
        matrix.offered = tuple(name for name in programs() if name not in matrix.engines)
    return homes


def _carry_out(
    matrix: Matrix,
    homes: dict[str, Environment],
    workers: Workers,
    fresh: bool,
    silence_s: float,
    progress: Progress,
) -> None:
    todo = _Todo(matrix, workers, fresh, progress)
    todo.carry_out("drawing states", _drawings(matrix))
    for member in matrix.members:
        entry = member.ledger.entries.get(STATES)
        if entry is None or entry["status"] != "done":
            member.refused = member.refused or (entry["message"] if entry else "its states were not drawn")
        else:
            member.plan = Plan.read(entry["model"])
    asked = {member.name: member.files(ASK) for member in matrix.members if member.plan}
    todo.carry_out("asking engines", _questions(matrix, homes, asked, silence_s))
    todo.carry_out("comparing", _comparisons(matrix, homes, asked))
    for member in matrix.members:
        # Engines that are not asked this time keep what they answered.
        others = [name for name in member.ledger.entries if name.partition(" ")[0] in KEPT]
        member.ledger.settle(list(dict.fromkeys([*member.names, *others])))
        for name in homes:
            entries = (member.ledger.entries.get(f"{kind} {name}") for kind in ("answers", "figures"))
            failed = next((one for one in entries if one and one["status"] != "done"), None)
            if failed:
                matrix.failures[member.name, name] = Failure(failed["status"], failed["message"])
            elif figures := member.ledger.entries.get(f"figures {name}"):
                matrix.rows += figures["rows"]


def _drawings(matrix: Matrix) -> "Iterable[tuple[Member, Work]]":
    for member in matrix.members:
        try:
            yield member, DrawStates.of(member.asked, member.name, matrix.states, matrix.seed)
        except InputError as error:
            member.refused = one_line(error)


def _questions(
    matrix: Matrix, homes: dict[str, Environment], asked: dict[str, Files], silence_s: float
) -> "Iterable[tuple[Member, Work]]":
    for member in matrix.members:
        if member.plan is not None:
            for name, home in homes.items():
                engine, files = matrix.engines[name], asked[member.name]
                marks = member.marks(STATES)
                yield member, Question.of(member.asked, engine, home, member.plan, files, marks, silence_s)


def _comparisons(
    matrix: Matrix, homes: dict[str, Environment], asked: dict[str, Files]
) -> "Iterable[tuple[Member, Work]]":
    for member in matrix.members:
        for name in homes if member.plan is not None else ():
            entry = member.ledger.entries.get(f"answers {name}")
            if entry is None or entry["status"] != "done" or member.plan is None:
                continue
            files = member.files(f"answers/{slug(f'answers {name}')}")
            marks = member.marks(STATES) | member.marks(f"answers {name}")
            engine = matrix.engines[name]
            yield member, Compare.of(member.asked, engine, member.plan, asked[member.name], files, marks)


class _Todo:
    """Does units that are not finished and keeps each as soon as it is."""

    def __init__(self, matrix: Matrix, workers: Workers, fresh: bool, progress: Progress):
        self._matrix, self._workers, self._fresh, self._progress = matrix, workers, fresh, progress

    def carry_out(self, what: str, planned: "Iterable[tuple[Member, Work]]") -> None:
        """Does a stage of the work."""
        owners: dict[int, Member] = {}
        work: list[Work] = []
        total = 0
        for member, unit in planned:
            total += 1
            member.names.append(unit.name)
            if self._fresh or not member.ledger.finished(unit.name, unit.digest):
                owners[id(unit)] = member
                work.append(unit)
        self._progress.begin(what, total, total - len(work))
        self._matrix.repeated += len(work)
        work.sort(key=lambda unit: -(owners[id(unit)].ledger.seconds(unit.name) or unit.cost))
        with closing(dispatch(do, work, self._workers)) as finished:
            for done in finished:
                unit: Any = done.item
                failure = None if done.error is None else Failure("failed", one_line(str(done.error)))
                outcome = Outcome(failure) if failure else done.result
                owners[id(unit)].ledger.keep(unit.name, unit.digest, {}, outcome)
                self._progress.advance(1)
                self._progress.finished(unit.label, outcome.seconds, str(outcome.failure or ""))
