"""``oarlock solvers``: the registry of the compiled core."""

from typing import Annotated

import typer

from oarlock.base import core
from oarlock.base.numbers import short
from oarlock.cli.console import emit_json, ends


@ends()
def solvers(
    as_json: Annotated[bool, typer.Option("--json", help="As JSON on standard output.")] = False,
) -> None:
    """The solvers, with what each is, its options and their defaults, as 'run --solver NAME:key=value' takes them."""
    every = core.solvers()
    if as_json:
        emit_json([{"name": name, "summary": said, "options": options} for name, (said, options) in every.items()], "-")
        return
    from oarlock.cli.tables import print_table

    rows = [
        (name, " ".join(f"{key}={_default(value)}" for key, value in options.items()), said)
        for name, (said, options) in every.items()
    ]
    print_table(("solver", "options", "what it is"), rows, words=3)


def _default(value: float | bool) -> str:
    """A default as the option takes it."""
    return str(int(value)) if isinstance(value, bool) else short(value)
