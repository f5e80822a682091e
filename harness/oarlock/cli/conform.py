"""``oarlock conform``: whether a loop means the same to other engines."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from oarlock.cli.bar import bar
from oarlock.cli.console import KEPT, JsonOption, NoCodeOption, QuietOption, emit_json, ends, say

if TYPE_CHECKING:
    from oarlock.conformance.session import Matrix

StatesOption = Annotated[int, typer.Option("--states", metavar="N", min=1, help="States to draw of each model.")]
SeedOption = Annotated[int, typer.Option(metavar="N", min=0, help="Of all random numbers.")]
JobsOption = Annotated[int | None, typer.Option(metavar="N", min=1, help="Units at once [default: one a core].")]
OutOption = Annotated[
    Path, typer.Option(metavar="DIR", help="Folder for the results, a folder a model; what is there is kept.")
]
FreshOption = Annotated[bool, typer.Option("--fresh", help="Do everything anew, also what is finished.")]
InstallOption = Annotated[
    bool, typer.Option("--install", help="Make environments of engines that are not there, each in the user's cache.")
]
ReportOption = Annotated[Path | None, typer.Option("--report", metavar="DIR", help="A page with the matrix.")]
SilenceOption = Annotated[
    float,
    typer.Option(
        "--engine-timeout",
        metavar="S",
        min=0.0,
        help="Time that an engine may be silent before it is ended, in s; 0: any.",
    ),
]


@ends(KEPT)
def conform(
    models: Annotated[
        list[str] | None, typer.Argument(metavar="MODEL…", help="Models, variants or MJCF files.")
    ] = None,
    engine: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME[@VERSION][:key=value,…][=PYTHON]",
            help="An engine, or the path of a program; may be repeated. VERSION is that of its package, PYTHON an "
            "interpreter that has it [default: every engine that is there].",
        ),
    ] = None,
    states: StatesOption = 24,
    seed: SeedOption = 0,
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="X",
            min=0.0,
            help="Exit with 1 if accelerations differ by more than X, relatively, from MuJoCo's and from exact ones "
            "alike [default: if a difference is unexplained].",
        ),
    ] = None,
    out: OutOption = Path("results/conform"),
    report: ReportOption = None,
    badge: Annotated[Path | None, typer.Option(metavar="FILE.svg", help="A badge of how many agree.")] = None,
    jobs: JobsOption = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS|local", help="Ask on a dask.distributed cluster.")
    ] = None,
    install: InstallOption = False,
    fresh: FreshOption = False,
    silence: SilenceOption = 900.0,
    as_json: JsonOption = None,
    no_code: NoCodeOption = False,
    quiet: QuietOption = False,
    list_engines: Annotated[
        bool, typer.Option("--list", help="List the engines, what each can express, and whether it is there.")
    ] = False,
) -> None:
    """Asks engines about the same closed states of models, one step and a free run, and tells why answers differ."""
    from oarlock.base.errors import InputError
    from oarlock.conformance.session import conform as carry_out

    if list_engines:
        _list_engines(as_json)
        return
    if not models:
        raise InputError("no model, expected one or several, or --list for the engines")
    with bar(always=True, quiet=quiet) as progress:
        matrix = carry_out(
            models,
            engine or (),
            states=states,
            seed=seed,
            tolerance=tolerance,
            out=out,
            jobs=jobs,
            scheduler=scheduler,
            install=install,
            fresh=fresh,
            engine_timeout=silence,
            progress=progress,
        )
    if as_json != "-":
        print_matrix(matrix)
    finish(matrix, as_json, report, badge)


def _list_engines(as_json: str | None) -> None:
    from oarlock.cli.tables import print_table
    from oarlock.engines import environments
    from oarlock.engines.registry import expressions, parse_engine

    rows = [{**row, "there": environments.find(parse_engine(row["engine"])) is not None} for row in expressions()]
    if as_json:
        emit_json(rows, as_json)
    if as_json == "-":
        return
    listed = []
    for row in rows:
        asked = ", ".join(row["questions"]) or "what its reader keeps"
        kinds = "–" if row["equalities"] is None else ", ".join(row["equalities"])
        there = "yes" if row["there"] else "no"
        listed.append((row["engine"], there, row["title"], asked, ", ".join(row["precisions"]), kinds))
    print_table(("engine", "there", "title", "can be asked", "precision", "equalities"), listed, words=6)


def finish(matrix: "Matrix", as_json: str | None, report: Path | None, badge: Path | None) -> None:
    """Says what is not as it should be, writes what was asked for, and exits with the status."""
    from oarlock.base.files import write_text
    from oarlock.conformance.badge import badge as drawn
    from oarlock.conformance.page import write_page

    say_failures(matrix)
    document = matrix.document()
    if as_json:
        emit_json(document, as_json)
    if report:
        say(f"oarlock: written: {write_page(document, report) / 'README.md'}")
    if badge:
        write_text(badge, drawn(document), named=True)
        say(f"oarlock: written: {badge}")
    if matrix.status:
        raise typer.Exit(matrix.status)


def print_matrix(matrix: "Matrix") -> None:
    """Prints a row a model and engine."""
    from oarlock.base.numbers import short
    from oarlock.cli.tables import print_table
    from oarlock.conformance.page import COLUMNS

    if not matrix.rows:
        return
    rows = [
        (row["model"], row["engine"], row["verdict"], *(short(row[name], 2) for name in COLUMNS)) for row in matrix.rows
    ]
    print_table(("model", "engine", "verdict", *COLUMNS.values()), rows, words=3)


def say_failures(matrix: "Matrix") -> None:
    """Says which models were refused, which engines failed, what does not pass, and what could be installed."""
    from oarlock.base.errors import few

    for member in matrix.members:
        if member.refused:
            say(f"oarlock: model refused: {member.name}: {member.refused}")
    for (model, name), why in matrix.failures.items():
        say(f"oarlock: engine {why.status}: {model} {name}: {why.message}")
    for row in matrix.rows:
        if why := matrix.beyond(row):
            say(f"oarlock: differs: {row['model']} {row['engine']}: {why}")
    if matrix.offered:
        names = few(list(matrix.offered), most=8)
        say(f"oarlock: not asked: {names}; '--engine NAME --install' makes an environment of its own for each")
