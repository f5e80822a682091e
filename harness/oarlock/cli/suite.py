"""``oarlock suite``: progress, what it says, and its exit status."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oarlock.cli.bar import bar
from oarlock.cli.console import KEPT, JsonOption, NoCodeOption, QuietOption, emit_json, ends, say

if TYPE_CHECKING:
    from oarlock.base.progress import Progress
    from oarlock.batch.suite import Suite
    from oarlock.conformance.session import Matrix


@ends(KEPT)
def suite(
    models: Annotated[
        list[str] | None,
        typer.Argument(metavar="[MODEL…]", help="Models, variants or MJCF files [default: every model]."),
    ] = None,
    jobs: Annotated[int | None, typer.Option(metavar="N", min=1, help="Runs at once [default: one a core].")] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS|local",
            help="Run on a dask.distributed cluster: of that scheduler, tcp://HOST:PORT, or of processes here.",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for the results, a folder a model; what is there is kept.")
    ] = Path("results"),
    to: Annotated[
        Path | None, typer.Option("--report", metavar="DIR", help="Folder for the report [default: OUT/report].")
    ] = None,
    as_json: JsonOption = None,
    no_code: NoCodeOption = False,
    quiet: QuietOption = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="Do everything anew, also what is finished.")] = False,
    unit_timeout: Annotated[
        float,
        typer.Option(
            metavar="S",
            min=0.0,
            help="Time without a step after which a run's worker is ended and it is done once more, in s; 0: no limit.",
        ),
    ] = 3600.0,
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=A:B:N",
            help="Free runs at N values from A to B instead of the experiments: of timestep or solref (MuJoCo's time "
            "constant of the equalities), in s and spaced geometrically; of a parameter of the model; or of seed, "
            "which disturbs the start. Several make a grid.",
        ),
    ] = None,
    engine: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME[@VERSION]…",
            help="Ask this engine about every model as well, as 'oarlock conform' does: results in OUT/conform, page "
            "in the report's folder conform; may be repeated.",
        ),
    ] = None,
) -> None:
    """Every model × its experiments, in parallel; resumes where it stopped, repeats what changed, writes the report."""
    from oarlock.base.errors import InputError
    from oarlock.batch import session

    if sweep and engine:
        raise InputError("--sweep and --engine, expected one of them: engines are asked about the models as they are")
    if engine:
        from oarlock.conformance.session import require_engines

        require_engines(engine)

    wanted: dict[str, Any] = {
        "out": out,
        "report": to or out / "report",
        "jobs": jobs,
        "scheduler": scheduler,
        "fresh": fresh,
        "unit_timeout": unit_timeout,
    }
    with bar(always=True, quiet=quiet) as progress:
        if sweep:
            found = session.sweep(models or [], sweep, progress=progress, **wanted)
        else:
            found = session.suite(models or [], progress=progress, **wanted)
        matrix = _asked(found, engine, wanted, progress) if engine else None
    _say_motions(found)
    _say_what_failed(found)
    document, status = found.document(), found.status
    if matrix:
        document["engines"], status = matrix.document(), max(status, matrix.status)
        _say_engines(matrix, wanted["report"] / "conform")
    if as_json:
        emit_json(document, as_json)
    if status:
        raise typer.Exit(status)


def _asked(found: "Suite", engines: list[str], wanted: dict[str, Any], progress: "Progress") -> "Matrix":
    from oarlock.conformance.session import conform

    models = [member.asked for member in found.members if not member.refused]
    shared = {name: wanted[name] for name in ("jobs", "scheduler", "fresh")}
    silence = wanted["unit_timeout"]
    return conform(models, engines, out=wanted["out"] / "conform", engine_timeout=silence, progress=progress, **shared)


def _say_engines(matrix: "Matrix", folder: Path) -> None:
    from oarlock.cli.conform import say_failures
    from oarlock.conformance.page import write_page

    say_failures(matrix)
    say(f"oarlock: written: {write_page(matrix.document(), folder) / 'README.md'}")


def _say_motions(suite: "Suite") -> None:
    """Of models alone: of the others the case says it."""
    for member in suite.members:
        model = member.ledger.model()
        if model and "motion" in model:
            say(f"oarlock: {member.name}: {model['motion']}")


def _say_what_failed(suite: "Suite") -> None:
    from oarlock.batch.suite import Sweep, failed

    for member in suite.members:
        if member.refused:
            say(f"oarlock: model refused: {member.name}: {member.refused}")
        for unit, why in failed(member).items():
            say(f"oarlock: run {why.status}: {member.name} {unit}: {why.message}")
        for row in member.lost:
            say(f"oarlock: run {row['status']}: {member.name} {row['run']}: {row['message']}")
        for verdict in member.failures:
            say(f"oarlock: gate failed: {member.name}: {verdict.line()}")
    for table in suite.tables if isinstance(suite, Sweep) else ():
        say(f"oarlock: table: {table}")
    for message in suite.unwritten:
        say(f"oarlock: page not written: {message}")
