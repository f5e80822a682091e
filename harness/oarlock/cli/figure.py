"""``oarlock figure``: the figures of a folder of results for print."""

from pathlib import Path
from typing import Annotated

import typer

from oarlock.base.errors import InputError
from oarlock.cli.console import ends


@ends()
def figure(
    results: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that 'oarlock run --out' wrote.")],
    to: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for the files [default: DIR/figures].")] = None,
    width: Annotated[str, typer.Option(metavar="MM", help="Width of a column: 86mm, or a number of mm.")] = "86mm",
    kind: Annotated[str, typer.Option("--format", metavar="FORMAT", help="pdf or svg.")] = "pdf",
) -> None:
    """Every figure of a folder of results at a journal's width, and the numbers behind each as CSV."""
    from oarlock.report.paper import figure_set

    try:
        width_mm = float(width.removesuffix("mm"))
    except ValueError:
        raise InputError(f"--width = {width}, expected a number of mm, such as 86mm") from None
    for path in figure_set(results, to or results / "figures", width_mm, kind):
        print(path)
