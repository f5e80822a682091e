"""``oarlock list``: the models that come along."""

import sys
from typing import Annotated

import typer

from oarlock.base.numbers import short
from oarlock.cli.console import emit_json, ends
from oarlock.cli.tables import print_table


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
    names = ["name", "title", "nq", "nv", "rows", "rank", "redundancy", "dof"]
    if not sys.stdout.isatty():
        names += ["reference", "tags"]  # longer than a terminal is wide
    rows = [[", ".join(v) if isinstance(v := entry[name], list) else short(v) for name in names] for entry in entries]
    print_table(names, rows, words=2)
