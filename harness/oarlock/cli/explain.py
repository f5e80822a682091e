"""``oarlock explain``: what the codes of findings mean."""

import shutil
import sys
from typing import Annotated

import typer

from oarlock.cli.console import emit_json, ends


@ends()
def explain(
    code: Annotated[
        str | None, typer.Argument(metavar="[CODE]", help="Code or name of a finding [default: the list].")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON on standard output.")] = False,
) -> None:
    """What a finding of 'oarlock check' means, how it is measured, and what to do about it."""
    from oarlock.diagnosis.verdict.findings import WIDTH, catalogue, look_up

    entry = None if code is None else look_up(code)
    if as_json:
        emit_json([one.document() for one in catalogue().values()] if entry is None else entry.document(), "-")
    elif entry is not None:
        print(entry.text(shutil.get_terminal_size().columns if sys.stdout.isatty() else WIDTH))
    else:
        from oarlock.cli.tables import print_table

        head = ("code", "name", "severity", "what is the matter")
        print_table(head, [(one.code, one.name, one.severity, one.title) for one in catalogue().values()], len(head))
