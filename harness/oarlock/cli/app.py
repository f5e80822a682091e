"""The command ``oarlock``.

Exit status: 0 all gates held, 1 a gate failed or a comparison got worse, 2 bad input, 130 interrupted, 141 reader gone.
"""

import gc
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.table import Table

from oarlock.base.errors import InputError, one_line
from oarlock.base.numbers import short
from oarlock.cli.check import check
from oarlock.cli.console import BAD_INPUT, GATE_FAILED, JsonOption, console, emit_json, ends, one_of, say
from oarlock.cli.diff import diff
from oarlock.cli.explain import explain
from oarlock.experiments.modes import ASKED
from oarlock.experiments.outcome import Results
from oarlock.experiments.session import Progress
from oarlock.experiments.session import run as run_model
from oarlock.render.folder import CONTENTS, require_report

app = typer.Typer(
    help="Cross-validates closed-chain MuJoCo models: exact constraint multipliers against MuJoCo, step by step.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    add_completion=False,
)


class _BarProgress(Progress):
    """A progress bar on standard error, and a line a finished run."""

    def __init__(self, bar: Bar):
        self._bar = bar
        self._task = bar.add_task("running", total=None)

    def begin(self, steps: int) -> None:
        self._bar.update(self._task, total=steps)

    def advance(self, steps: int) -> None:
        self._bar.advance(self._task, steps)

    def finished(self, row: dict[str, Any]) -> None:
        note = "" if row["status"] == "done" else f"  [{row['status']}: {_ending(row)}]"
        self._bar.console.print(f"  {row['run']}{note}", highlight=False, markup=False)


@contextmanager
def _bar() -> Iterator[Progress | None]:
    """A progress bar, where somebody looks at one."""
    stream = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Bar(*columns, console=stream, transient=True, disable=not stream.is_terminal) as bar:
        yield _BarProgress(bar) if stream.is_terminal else None


def _ending(row: dict[str, Any]) -> str:
    if row["status"] == "unprojected":
        return f"{row['unprojected']} of {row['steps_done']} projections did not reach the constraints"
    return row["message"] or f"{row['unconverged']} of {row['solves']} solves did not converge"


_COLUMNS = {
    "run": "run",
    "status": "status",
    "iterations_mean": "iterations",
    "min_norm_error_max": "min-norm error",
    "qacc_rel_diff_max": "qacc diff",
    "drift_pos_max": "drift",
    "truth_error_max": "truth error",
}


def _print_summary(results: Results) -> None:
    table = Table(box=None, header_style="bold", pad_edge=False)
    for title in _COLUMNS.values():
        table.add_column(title, justify="left" if title in ("run", "status") else "right", no_wrap=True)
    for row in results.rows:
        table.add_row(*(short(row[name]) for name in _COLUMNS))
    console().print(table)


@app.command("list")
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
        table.add_row(*(", ".join(v) if isinstance(v := entry[name], list) else short(v) for name in names))
    console().print(table)


@app.command()
@ends()
def run(
    model: Annotated[
        str, typer.Argument(metavar="MODEL[:key=value,…]|FILE.xml", help="A model's name, or any MJCF file.")
    ],
    solver: Annotated[
        list[str] | None, typer.Option(metavar="NAME[:key=value,…]", help="Solver; may be repeated.")
    ] = None,
    form: Annotated[str | None, typer.Option(help="matched, hard or both.")] = None,
    mode: Annotated[str | None, typer.Option(help=one_of(ASKED))] = None,
    walker: Annotated[str | None, typer.Option(help="Who walks in lockstep: mujoco or a solver.")] = None,
    integrator: Annotated[str | None, typer.Option(help="euler, implicit, implicitfast or rk4.")] = None,
    stabilisation: Annotated[
        str | None, typer.Option(help="What holds exact constraints: baumgarte, projection or both.")
    ] = None,
    timestep: Annotated[float | None, typer.Option(metavar="S", help="Timestep in s.")] = None,
    duration: Annotated[float | None, typer.Option(metavar="S", help="Duration in s.")] = None,
    rtol: Annotated[float | None, typer.Option(help="Relative tolerance of the solvers that have one.")] = None,
    ignore_inequalities: Annotated[
        bool, typer.Option("--ignore-inequalities", help="Run without the model's contacts, limits and friction.")
    ] = False,
    stepping: Annotated[str, typer.Option(help="auto, native or python: the path that steps.")] = "auto",
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for the tables [default: results/MODEL].")
    ] = None,
    to: Annotated[
        Path | None, typer.Option("--report", metavar="DIR", help="Write the report too, as 'oarlock report' does.")
    ] = None,
    as_json: JsonOption = None,
) -> None:
    """Runs a model's comparison. With none of the options before --timestep it runs the experiments of its case."""
    from oarlock.cases.case import load_case

    folder = out or Path("results") / load_case(model).slug
    if to:
        _require_place(to, folder)
    with _bar() as progress:
        results = run_model(
            model,
            solver=solver or (),
            form=form,
            mode=mode,
            walker=walker,
            integrator=integrator,
            timestep_s=timestep,
            duration_s=duration,
            rtol=rtol,
            stabilisation=stabilisation,
            ignore_inequalities=ignore_inequalities,
            stepping=stepping,
            out=folder,
            progress=progress,
        )
    if as_json:
        emit_json(results.document(), as_json)
    if as_json != "-":
        _print_summary(results)
    if "inequalities_ignored" in results.provenance:
        say(f"oarlock: inequalities ignored: {results.provenance['inequalities_ignored']}")
    for row in results.rows:
        if row["status"] != "done":
            say(f"oarlock: run {row['run']} {row['status']}: {_ending(row)}")
    for verdict in results.failures:
        say(f"oarlock: gate failed: {verdict.line()}")
    unchecked = sum(verdict.held is None for verdict in results.verdicts)
    if unchecked:
        say(
            f"oarlock: {unchecked} gate(s) of the case not checked: "
            "no run at the case's own parameters, timestep and duration"
        )
    if to:
        from oarlock.report.case_report import write_report

        say(f"oarlock: written: {write_report(folder, to) / 'README.md'}")
    if results.failures:
        raise typer.Exit(GATE_FAILED)


def _require_place(report: Path, results: Path) -> None:
    """Before a run, for what is wrong with the place of its report would be said only after it."""
    if results.resolve().is_relative_to(report.resolve()):
        raise InputError(f"'{report}' is where the results go, expected another folder for the report")
    require_report(report, CONTENTS)


@app.command()
@ends()
def new(
    name: Annotated[str, typer.Argument(help="Name of the model and of its folder.")],
    file: Annotated[Path, typer.Argument(metavar="FILE.xml", help="Any MJCF file whose loops are closed.")],
    to: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder that gets the new one [default: the models of a checkout, or .]."),
    ] = None,
) -> None:
    """Writes the case of a model: a folder with a self-contained copy, case.toml and README.md."""
    from oarlock.scaffold.scaffold import models_folder, new_model

    with _bar() as progress:
        folder, scaffold = new_model(name, file, to, progress)
    for line in scaffold.lines():
        print(line)
    listed = folder.parent == models_folder()
    print(f"\nwritten: {folder}{os.sep}")
    print(f"next:    oarlock run {name if listed else os.path.join(os.curdir, folder)}")
    if listed:
        print(f"then:    make run MODEL={name}    (publishes its report)")


@app.command()
@ends()
def report(
    results: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that 'oarlock run --out' wrote.")],
    to: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for the report [default: DIR/report].")] = None,
) -> None:
    """Writes the report of a folder of results: Markdown with SVG figures, and one self-contained HTML page."""
    from oarlock.report.case_report import write_report

    target = write_report(results, to or results / "report")
    print(target / "README.md")


@app.command()
@ends()
def bench(
    size: Annotated[
        list[int] | None, typer.Option(metavar="N", help="Solvers only: rows, a multiple of 6; may be repeated.")
    ] = None,
    model: Annotated[
        list[str] | None, typer.Option(metavar="MODEL", help="Steps only: of this model; may be repeated.")
    ] = None,
    with_growth: Annotated[
        bool,
        typer.Option("--growth", help="Growth only: a step and its parts against the number of loops."),
    ] = False,
    growth_report: Annotated[
        Path | None, typer.Option("--growth-report", metavar="DIR", help="The same, and its page in a folder.")
    ] = None,
    rounds: Annotated[int, typer.Option(min=1, help="Interleaved rounds, of which the median counts.")] = 9,
    as_json: JsonOption = None,
) -> None:
    """Times solvers beside the pseudo-inverses of Rust's libraries, and steps beside mj_step, as ratios of one run.

    With --growth also how the cost of a step grows with the size of a mechanism, and where its time goes.
    """
    from oarlock.bench import growth
    from oarlock.bench import solvers as benchmark
    from oarlock.bench import steps as stepping_bench

    rows, steps, grown = [], [], None
    growing = with_growth or growth_report is not None
    everything = not (size or model or growing)
    for table in benchmark.bench(size, rounds) if size or everything else ():
        rows += table
        if as_json != "-":
            _print_bench(table)
    for table in stepping_bench.bench_stepping(model or stepping_bench.MODELS, rounds) if model or everything else ():
        steps += table
        if as_json != "-":
            _print_stepping_bench(table)
    if growing:
        grown = growth.bench_growth(rounds=rounds)
        if as_json != "-":
            _print_growth(grown)
    document = benchmark.document(rows, steps, grown)
    if as_json:
        emit_json(document, as_json)
    if grown and growth_report:
        from oarlock.bench.growth_report import write_growth_report

        say(f"oarlock: written: {write_growth_report(grown, document['provenance'], growth_report) / 'README.md'}")


def _print_growth(grown: dict[str, Any]) -> None:
    from oarlock.bench.growth import PARTS, STEP

    fits = {(row["name"], row["part"]): row for row in grown["exponents"]}
    for name in dict.fromkeys(row["name"] for row in grown["rows"]):
        own = [row for row in grown["rows"] if row["name"] == name]
        table = Table(box=None, header_style="bold", pad_edge=False, title=name, title_justify="left")
        table.add_column("µs a step", no_wrap=True)
        for title in (*(f"N = {row['loops']}" for row in own), "exponent", "of many loops"):
            table.add_column(title, justify="right", no_wrap=True)
        costs = {STEP: [row["step_us"] for row in own]}
        costs |= {part: [row["parts_us"][part] for row in own] for part in own[0]["parts_us"]}
        for part, values in costs.items():
            fit = fits[(name, part)]
            cells = [short(value) for value in (*values, fit["all"], fit["many"])]
            table.add_row(PARTS.get(part, f"whole {part}"), *cells)
        (Console() if sys.stdout.isatty() else Console(width=200)).print(table)


def _print_stepping_bench(rows: list[dict[str, Any]]) -> None:
    table = Table(box=None, header_style="bold", pad_edge=False, title=rows[0]["model"], title_justify="left")
    table.add_column("a step of", no_wrap=True)
    for title in ("time", "to mj_step", "to its fastest setting", "cores gain"):
        table.add_column(title, justify="right", no_wrap=True)
    for row in rows:
        gain = f"{row['speedup']:.2f} ×" if row["speedup"] else ""
        ratios = (f"{row['ratio']:.2f}", f"{row['ratio_to_fastest']:.2f}", gain)
        table.add_row(row["name"], f"{row['step_us']:.2f} µs", *ratios)
    (Console() if sys.stdout.isatty() else Console(width=200)).print(table)


def _print_bench(rows: list[dict[str, Any]]) -> None:
    columns = ["from the step", "ratio", "from A and b", "ratio", "min-norm error", "contradicted", "products"]
    table = Table(box=None, header_style="bold", pad_edge=False, title=f"n = {rows[0]['n']}", title_justify="left")
    table.add_column("solver", no_wrap=True)
    for title in columns:
        table.add_column(title, justify="right", no_wrap=True)
    best = min((row for row in rows if row["right"] and not row["library"]), key=lambda row: row["solve_ns"])
    for row in rows:
        mark = " *" if row is best else "" if row["right"] else " (not the minimum norm)"
        cells = [f"{row['solve_ns']:.0f} ns", f"{row['solve_ratio']:.3f}", f"{row['given_ns']:.0f} ns"]
        cells += [f"{row['given_ratio']:.3f}", f"{row['min_norm_error']:.1e}", f"{row['contradicted_error']:.1e}"]
        table.add_row(row["name"] + mark, *cells, f"{row['products']:.1f}")
    (Console() if sys.stdout.isatty() else Console(width=200)).print(table)


@app.command()
@ends()
def suite(
    models: Annotated[
        list[str] | None,
        typer.Argument(metavar="[MODEL…]", help="Models, variants or MJCF files [default: every model]."),
    ] = None,
    jobs: Annotated[int | None, typer.Option(metavar="N", min=1, help="Runs at once [default: one a core].")] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS|local",
            help="Run on a dask.distributed cluster: of that scheduler, tcp://HOST:PORT, or of processes here.",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for the results, a folder a model; what is there is kept.")
    ] = Path("results"),
    to: Annotated[
        Path | None, typer.Option("--report", metavar="DIR", help="Folder for the report [default: OUT/report].")
    ] = None,
    as_json: JsonOption = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Do everything anew, also what is finished.")] = False,
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=A:B:N",
            help="Free runs at N values from A to B instead of the experiments: of timestep or solref (MuJoCo's time "
            "constant of the equalities), in s and spaced geometrically; of a parameter of the model; or of seed, "
            "which disturbs the start. Several make a grid.",
        ),
    ] = None,
) -> None:
    """Every model × its experiments, in parallel; resumes where it stopped, repeats what changed, writes the report."""
    from oarlock.cli.suite import run_suite

    target = to or out / "report"
    status, document = run_suite(
        models or [], jobs=jobs, scheduler=scheduler, out=out, report=target, fresh=fresh, sweep=sweep or ()
    )
    if as_json:
        emit_json(document, as_json)
    if status:
        raise typer.Exit(status)


app.command()(check)
app.command()(diff)
app.command()(explain)


def main() -> None:
    """Runs the command: a user's mistake is one line on standard error, never a traceback."""
    gc.freeze()  # what was imported stays: no collection of garbage need walk through it
    warnings.showwarning = lambda message, *_: say(f"oarlock: {one_line(message)}")
    try:
        app(standalone_mode=True)
    except InputError as error:
        say(f"oarlock: {one_line(error)}")
        sys.exit(BAD_INPUT)
    except OSError as error:
        say(f"oarlock: {one_line(error)}")
        sys.exit(BAD_INPUT)
