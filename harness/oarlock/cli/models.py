"""``oarlock list``: the models that come along."""

import sys
from typing import Annotated

import typer
from rich.table import Table

from oarlock.base.numbers import short
from oarlock.cli.console import console, emit_json, ends, shown


@ends()
def list_models(
    as_json: Annotated[bool, typer.Option("--json", help="As JSON on standard output.")] = False,
) -> None:
    """The models that come with oarlock. Files, pipes and --json get their references and tags as well."""
    from oarlock.experiments.catalogue import catalogue

    entries = catalogue()
    if as_json:
        emit_json(entries, "-")
        return
    table = Table(box=None, header_style="bold", pad_edge=False)
    names = ["name", "title", "nq", "nv", "rows", "rank", "redundancy", "dof"]
    if not sys.stdout.isatty():
        names += ["reference", "tags"]  # longer than a terminal is wide
    for name in names:
        table.add_column(name, no_wrap=name != "title")
    for entry in entries:
        table.add_row(*(shown(", ".join(v) if isinstance(v := entry[name], list) else short(v)) for name in names))
    console().print(table)
