"""``oarlock new``: what it says of a new case."""

import os
from pathlib import Path
from typing import Annotated

import typer

from oarlock.base.text import visible
from oarlock.cases.motion import Motion
from oarlock.cli.bar import bar
from oarlock.cli.console import QuietOption, ends
from oarlock.cli.motion import ControlOption, KeyframeOption, SeedOption, given_controls


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
    keyframe: KeyframeOption = None,
    controls: Annotated[
        str | None,
        typer.Option(
            metavar="KIND",
            help="keyframe, constant or random (smooth) [default: the keyframe's, where it starts from one, else "
            "random].",
        ),
    ] = None,
    control: ControlOption = None,
    seed: SeedOption = 0,
    quiet: QuietOption = False,
) -> None:
    """Writes the case of a model: a folder with a self-contained copy, case.toml and README.md."""
    from oarlock.scaffold.scaffold import models_folder, new_model

    with bar(quiet=quiet) as progress:
        asked = Motion(keyframe, controls, given_controls(control), seed)
        folder, scaffold = new_model(name, file, to, progress, outside=outside, asked=asked)
    for line in scaffold.lines():
        print(visible(line))
    listed = folder.parent == models_folder()
    print(f"\nwritten: {folder}{os.sep}")
    print(f"next:    oarlock run {name if listed else os.path.join(os.curdir, folder)}")
    if listed:
        print(f"then:    make run MODEL={name}    (publishes its report)")
