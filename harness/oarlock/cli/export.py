"""``oarlock export``: what it says of a file that it writes."""

from pathlib import Path
from typing import Annotated

import typer

from oarlock.base.text import visible
from oarlock.cli.console import GATE_FAILED, JsonOption, NoCodeOption, emit_json, ends


@ends()
def export(
    model: Annotated[str, typer.Argument(metavar="MODEL", help="A model, a variant or an MJCF file.")],
    reader: Annotated[str, typer.Option("--for", metavar="READER", help="pinocchio, drake or newton.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", metavar="OUT.xml", help="File for the MJCF.")] = None,
    engine: Annotated[
        str,
        typer.Option(
            metavar="NAME=PYTHON",
            help="Who reads it back, as for conform: pinocchio_reader, drake or newton, and an interpreter that has it "
            "[default: the reader's own, if its environment is there].",
        ),
    ] = "",
    as_json: JsonOption = None,
    no_code: NoCodeOption = False,
) -> None:
    """Writes a plain MJCF that another engine's reader gets right, and lists what it cannot have.

    One root where the reader takes one only, inertias of every body, connects and welds by bodies and anchors, defaults
    and replicas resolved. Where the engine is there it reads the file back: masses, places, velocities and rows are
    compared. Exit status 1: it reads something else.
    """
    from oarlock.export.session import export as write

    exported = write(model, reader, out, engine)
    if as_json != "-":
        for line in exported.lines():
            print(visible(line))
        if out is not None:
            print(f"\nwritten: {visible(str(out))}")
    if as_json:
        emit_json(exported.document(), as_json)
    if exported.differences:
        raise typer.Exit(GATE_FAILED)
