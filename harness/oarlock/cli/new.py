"""``oarlock new``: what it says of a new case."""

import os
from pathlib import Path
from typing import Annotated

import typer

from oarlock.base.text import visible
from oarlock.cli.bar import bar
from oarlock.cli.console import ends


@ends()
def new(
    name: Annotated[str, typer.Argument(help="Name of the model and of its folder.")],
    file: Annotated[Path, typer.Argument(metavar="FILE.xml", help="Any MJCF file whose loops are closed.")],
    to: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder that gets the new one [default: the models of a checkout, or .]."),
    ] = None,
    outside: Annotated[
        bool, typer.Option("--outside", help="Copy files that it names outside its own folder, too.")
    ] = False,
) -> None:
    """Writes the case of a model: a folder with a self-contained copy, case.toml and README.md."""
    from oarlock.scaffold.scaffold import models_folder, new_model

    with bar() as progress:
        folder, scaffold = new_model(name, file, to, progress, outside=outside)
    for line in scaffold.lines():
        print(visible(line))
    listed = folder.parent == models_folder()
    print(f"\nwritten: {folder}{os.sep}")
    print(f"next:    oarlock run {name if listed else os.path.join(os.curdir, folder)}")
    if listed:
        print(f"then:    make run MODEL={name}    (publishes its report)")
