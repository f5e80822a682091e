"""``oarlock report``: the page of a folder of results."""

from pathlib import Path
from typing import Annotated

import typer

from oarlock.cli.console import ends


@ends()
def report(
    results: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that 'oarlock run --out' wrote.")],
    to: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for the report [default: DIR/report].")] = None,
) -> None:
    """Writes the report of a folder of results: Markdown with SVG figures, and one self-contained HTML page."""
    from oarlock.report.case_report import write_report

    target = write_report(results, to or results / "report")
    print(target / "README.md")
