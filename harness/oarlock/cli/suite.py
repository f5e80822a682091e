"""``oarlock suite``: progress, what it says, and its exit status."""

import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any

import typer

from oarlock.base.cores import cores
from oarlock.base.errors import few
from oarlock.batch.pages import write_pages, write_sweep_pages
from oarlock.batch.suite import Suite, carry_out, failed, plan_suite, status_of
from oarlock.batch.sweep import parse_axes
from oarlock.batch.workers import LocalWorkers, Workers
from oarlock.cli.bar import bar
from oarlock.cli.console import JsonOption, emit_json, ends
from oarlock.tables.ledger import TABLE


@ends()
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
    fresh: Annotated[bool, typer.Option("--fresh", help="Do everything anew, also what is finished.")] = False,
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=A:B:N",
            help="Free runs at N values from A to B instead of the experiments: of timestep or solref (MuJoCo's time "
            "constant of the equalities), in s and spaced geometrically; of a parameter of the model; or of seed, "
            "which disturbs the start. Several make a grid.",
        ),
    ] = None,
) -> None:
    """Every model × its experiments, in parallel; resumes where it stopped, repeats what changed, writes the report."""
    target = to or out / "report"
    status, document = run_suite(
        models or [], jobs=jobs, scheduler=scheduler, out=out, report=target, fresh=fresh, sweep=sweep or ()
    )
    if as_json:
        emit_json(document, as_json)
    if status:
        raise typer.Exit(status)


def run_suite(
    models: Sequence[str],
    *,
    jobs: int | None,
    scheduler: str | None,
    out: Path,
    report: Path,
    fresh: bool,
    sweep: Sequence[str] = (),
) -> tuple[int, dict[str, Any]]:
    """Runs a suite, writes its report, says what did not hold; gives the exit status and the summary."""
    suite = plan_suite(models, out, parse_axes(sweep))
    for name, lacking in suite.skipped.items():
        _say(f"skipped: {name} has no parameter {few(lacking)}")
    units, pages = _workers(jobs, scheduler)
    with closing(pages), closing(units), bar(always=True) as progress:
        carry_out(suite, units, fresh=fresh, progress=progress)
        folders = [member.folder.path for member in suite.members]
        if suite.axes:
            unwritten = write_sweep_pages(out, folders, report, pages, progress)
        else:
            unwritten = write_pages(out, folders, report, pages, progress, every=not models)
    _say_what_failed(suite)
    for table in (member.folder.path / TABLE for member in suite.members if suite.axes):
        if table.is_file():
            _say(f"table: {table}")
    for message in unwritten:
        _say(f"page not written: {message}")
    return max(status_of(suite), 2 if unwritten else 0), suite.document()


def _workers(jobs: int | None, scheduler: str | None) -> tuple[Workers, Workers]:
    """Who does the units and who makes the pages, which are files here."""
    if scheduler is None:
        local = LocalWorkers(jobs or cores())
        return local, local
    from oarlock.batch.cluster import LOCAL, Cluster

    return Cluster(scheduler, jobs or (cores() if scheduler == LOCAL else None), _say), LocalWorkers(cores())


def _say(text: str) -> None:
    print(f"oarlock: {text}", file=sys.stderr)


def _say_what_failed(suite: Suite) -> None:
    for member in suite.members:
        if member.refused:
            _say(f"model refused: {member.name}: {member.refused}")
        for unit, why in failed(member).items():
            _say(f"run {why.status}: {member.name} {unit}: {why.message}")
        for verdict in member.failures:
            _say(f"gate failed: {member.name}: {verdict.line()}")
