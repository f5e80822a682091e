"""``oarlock versions``: what a loop does under other versions of MuJoCo."""

from pathlib import Path
from typing import Annotated, Any

import typer

from oarlock.cli.bar import bar
from oarlock.cli.conform import (
    FreshOption,
    InstallOption,
    JobsOption,
    OutOption,
    ReportOption,
    SeedOption,
    StatesOption,
    finish,
)
from oarlock.cli.console import JsonOption, NoCodeOption, QuietOption, console, ends, shown


@ends()
def versions(
    models: Annotated[list[str], typer.Argument(metavar="MODEL…", help="Models, variants or MJCF files.")],
    mujoco: Annotated[
        str,
        typer.Option("--mujoco", metavar="V,V,…", help="Versions of MuJoCo, the oldest first, such as 3.3.7,3.6,4.0."),
    ],
    states: StatesOption = 24,
    seed: SeedOption = 0,
    out: OutOption = Path("results/conform"),
    report: ReportOption = None,
    jobs: JobsOption = None,
    install: InstallOption = False,
    fresh: FreshOption = False,
    as_json: JsonOption = None,
    no_code: NoCodeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Runs models under versions of MuJoCo: the largest gap of their loops, what changed for them, when and why."""
    from oarlock.conformance import session
    from oarlock.conformance.versions import table

    with bar(always=True, quiet=quiet) as progress:
        matrix = session.versions(
            models,
            mujoco,
            states=states,
            seed=seed,
            out=out,
            jobs=jobs,
            install=install,
            fresh=fresh,
            progress=progress,
        )
    if as_json != "-":
        _print(table(matrix.rows))
        for line in matrix.changes():
            console().print(shown(line), soft_wrap=True)
    finish(matrix, as_json, report, None)


def _print(rows: dict[str, dict[str, Any]]) -> None:
    from rich.table import Table

    from oarlock.base.numbers import short

    models = list(dict.fromkeys(model for row in rows.values() for model in row))
    printed = Table(box=None, header_style="bold", pad_edge=False)
    printed.add_column("MuJoCo", no_wrap=True)
    for model in models:
        printed.add_column(shown(model), justify="right", no_wrap=True)
    for version, row in rows.items():
        printed.add_row(version, *(short(row.get(model)) for model in models))
    console().print("largest |efc_pos|, m or rad")
    console().print(printed)
