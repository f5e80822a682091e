"""``oarlock diff``: what it prints, and its exit status."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from oarlock.cli.console import GATE_FAILED, JsonOption, console, emit, emit_json, ends, prints, say, shown
from oarlock.cli.tables import print_table

if TYPE_CHECKING:
    from oarlock.compare.compare import Difference

_COLOURS = {"worse": "red", "disappeared": "red", "better": "green", "changed": "yellow"}


@ends()
def diff(
    before: Annotated[Path, typer.Argument(metavar="A", help="Folder of results: of one model, or of a suite.")],
    after: Annotated[Path, typer.Argument(metavar="B", help="Another one, that is held against A.")],
    timings: Annotated[
        float | None, typer.Option(metavar="FACTOR", help="Judge timings too: they may grow by this factor.")
    ] = None,
    allow_missing: Annotated[bool, typer.Option("--allow-missing", help="What B does not have is no loss.")] = False,
    limit: Annotated[int, typer.Option(metavar="N", min=0, help="Print N changes at most; 0: all.")] = 50,
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write a page of what changed: Markdown and HTML.")
    ] = None,
    as_json: JsonOption = None,
    junit: Annotated[
        str | None, typer.Option(metavar="FILE|-", help="Write JUnit XML, a test case a run and group of figures.")
    ] = None,
) -> None:
    """What changed beyond its tolerance between two folders of results, worst first; status 1: something got worse."""
    from oarlock.compare.compare import diff as compare

    printing = prints({"--json": as_json, "--junit": junit})
    found = compare(before, after, timings=timings, allow_missing=allow_missing)
    if junit:
        from oarlock.compare.junit import junit as render

        emit(render(found), junit)
    if report:
        say(f"oarlock: written: {found.report(report) / 'README.md'}")
    if as_json:
        emit_json(found.document(), as_json)
    if printing:
        _print(found, limit)
    if found.worse:
        say(f"oarlock: {len(found.worse)} got worse; the first: {_place(found)}{found.worse[0].line()}")
        raise typer.Exit(GATE_FAILED)


def _place(found: "Difference") -> str:
    return " ".join(" ".join(part for part in (found.worse[0].case, found.worse[0].run) if part).split()) + ": "


def _print(found: "Difference", limit: int) -> None:
    from oarlock.compare.compare import COLUMNS, cells

    out = console()
    for origin in found.origins:
        out.print(shown(origin.line(found.matched)), soft_wrap=True)
    changes = found.changes[: limit or None]
    if changes:
        print_table(COLUMNS, [cells(one) for one in changes], 4, style=lambda row: _COLOURS.get(str(row[0]), ""))
    if len(found.changes) > len(changes):
        out.print(shown(f"and {len(found.changes) - len(changes)} more changes (--limit 0 prints all)"))
    for figure, factor in found.timings.items():
        out.print(shown(f"{figure}: × {factor:.3g}, median over runs; timings are not judged"), soft_wrap=True)
    out.print(shown(found.summary()), soft_wrap=True)
