"""``oarlock suite``: progress, what it says, and its exit status."""

import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar

from oarlock.base.cores import cores
from oarlock.base.errors import few
from oarlock.batch.pages import write_pages, write_sweep_pages
from oarlock.batch.suite import Listener, Suite, carry_out, failed, plan_suite, status_of
from oarlock.batch.sweep import parse_axes
from oarlock.batch.workers import LocalWorkers, Workers
from oarlock.tables.ledger import TABLE


class _BarListener(Listener):
    """One bar on standard error, and a line for everything that is finished."""

    def __init__(self, bar: Bar):
        self._bar = bar
        self._task = bar.add_task("")

    def begin(self, what: str, total: int, kept: int) -> None:
        self._bar.reset(self._task, description=what, total=total, completed=kept)
        if kept:
            self._print(f"{what}: {kept} of {total} kept from before")

    def finished(self, label: str, seconds: float | None, message: str) -> None:
        self._bar.advance(self._task)
        took = "" if seconds is None else f"  {seconds:.1f} s"
        self._print(f"  {label}{took}" + (f"  [{message}]" if message else ""))

    def _print(self, text: str) -> None:
        self._bar.console.print(text, highlight=False, markup=False, soft_wrap=True)


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
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with (
        closing(pages),
        closing(units),
        Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar,
    ):
        listener = _BarListener(bar)
        carry_out(suite, units, fresh=fresh, listener=listener)
        folders = [member.folder.path for member in suite.members]
        if suite.axes:
            unwritten = write_sweep_pages(out, folders, report, pages, listener)
        else:
            unwritten = write_pages(out, folders, report, pages, listener, every=not models)
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
