"""``oarlock sample``: consistent states of a mechanism, as a file of arrays."""

from pathlib import Path
from typing import Annotated

import typer

from oarlock.cli.console import JsonOption, NoCodeOption, console, emit_json, ends, say, shown


@ends()
def sample(
    file: Annotated[str, typer.Argument(metavar="FILE.xml", help="MJCF with loops closed by equalities, or a MODEL.")],
    count: Annotated[int, typer.Option("--number", "-n", metavar="N", help="How many.")] = 1000,
    out: Annotated[Path | None, typer.Option("--out", "-o", metavar="POSES.npz", help="File for the arrays.")] = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Of all random numbers.")] = 0,
    speed: Annotated[
        float, typer.Option(metavar="RAD/S", help="Root mean square of the velocities at the start; 0: at rest.")
    ] = 1.0,
    branches: Annotated[str, typer.Option(metavar="WHICH", help="all, or start: only the start's own.")] = "all",
    keyframe: Annotated[
        str | None, typer.Option(metavar="NAME|none", help="Start here [default: the first; none: the own pose].")
    ] = None,
    report: Annotated[Path | None, typer.Option(metavar="DIR", help="A page with what was covered.")] = None,
    as_json: JsonOption = None,
    no_code: NoCodeOption = False,
) -> None:
    """Consistent states of a mechanism: closed positions inside of all ranges, and velocities that the loops admit."""
    from oarlock.base.numbers import short
    from oarlock.cli.tables import print_table
    from oarlock.diagnosis.sampling import sample as draw

    drawn = draw(file, count, seed, speed=speed, branches=branches, keyframe=keyframe)
    if as_json != "-":
        console().print(shown(drawn.said()), soft_wrap=True)
        for frame in (drawn.branches, drawn.coverage):
            print()
            head = [name.replace("_", " ") for name in frame.columns]
            print_table(head, [[short(value) for value in row] for row in frame.rows()])
    if out:
        say(f"oarlock: written: {drawn.save(out)}")
    if report:
        say(f"oarlock: written: {drawn.report(report)}")
    if as_json:
        emit_json(drawn.document(), as_json)
