"""``oarlock bench``: tables of costs."""

from pathlib import Path
from typing import Annotated, Any

import typer

from oarlock.base.numbers import short
from oarlock.cli.console import JsonOption, QuietOption, emit_json, ends, say
from oarlock.cli.tables import print_table


@ends()
def bench(
    size: Annotated[
        list[int] | None, typer.Option(metavar="N", help="Solvers only: rows, a multiple of 6; may be repeated.")
    ] = None,
    model: Annotated[
        list[str] | None, typer.Option(metavar="MODEL", help="Steps only: of this model; may be repeated.")
    ] = None,
    contacts: Annotated[
        bool,
        typer.Option("--contacts", help="Contacts only: an exact step with contacts beside mj_step, in turns."),
    ] = False,
    with_growth: Annotated[
        bool,
        typer.Option("--growth", help="Growth only: a step and its parts against the number of loops, for minutes."),
    ] = False,
    growth_report: Annotated[
        Path | None, typer.Option("--growth-report", metavar="DIR", help="The same, and its page in a folder.")
    ] = None,
    family: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Growth only: of this family; may be repeated.")
    ] = None,
    budget: Annotated[
        float,
        typer.Option(metavar="S", help="Growth: a walk that would take longer, in s, is left out, and said to be."),
    ] = 1.0,
    rounds: Annotated[int, typer.Option(min=1, help="Interleaved rounds, of which the median counts.")] = 9,
    as_json: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Times solvers beside the pseudo-inverses of Rust's libraries, and steps beside mj_step, as ratios of one run.

    With --growth how the cost of a step grows with the size of a mechanism for every method, where its time goes, how
    far answers are from exact ones, and how much memory walks take.
    """
    from oarlock.bench import solvers as benchmark
    from oarlock.bench import steps as stepping_bench

    rows, steps, grown = [], [], None
    growing = with_growth or growth_report is not None or bool(family)
    everything = not (size or model or contacts or growing)
    for table in benchmark.bench(size, rounds) if size or everything else ():
        rows += table
        if as_json != "-":
            _print_bench(table)
    for table in stepping_bench.bench_stepping(model or stepping_bench.MODELS, rounds) if model or everything else ():
        steps += table
        if as_json != "-":
            _print_stepping_bench(table)
    turns = (stepping_bench.BARE, stepping_bench.EXACT, stepping_bench.PROJECTED)
    for table in stepping_bench.bench_stepping(stepping_bench.CONTACTS, rounds, names=turns) if contacts else ():
        steps += table
        if as_json != "-":
            _print_stepping_bench(table)
    if growing:
        grown = _measured(family, rounds, budget, quiet)
        if as_json != "-":
            _print_growth(grown)
    document = benchmark.document(rows, steps, grown)
    if as_json:
        emit_json(document, as_json)
    if grown and growth_report:
        from oarlock.bench.growth_report import write_growth_report

        say(f"oarlock: written: {write_growth_report(grown, document['provenance'], growth_report) / 'README.md'}")


def _measured(family: list[str] | None, rounds: int, budget_s: float, quiet: bool) -> dict[str, Any]:
    from oarlock.base.errors import InputError
    from oarlock.bench.budget import Budget
    from oarlock.bench.families import families
    from oarlock.bench.measurement import measure
    from oarlock.cli.bar import bar

    if not 0 < budget_s < float("inf"):
        raise InputError(f"budget = {budget_s} s, expected a positive number")
    with bar(quiet=quiet) as progress:
        return measure(families(family), rounds, Budget(budget_s), progress)


def _print_growth(grown: dict[str, Any]) -> None:
    from oarlock.bench.growth import FASTEST, SOLVERS, STEP
    from oarlock.bench.standings import by_size, of_family
    from oarlock.bench.steps import BARE

    fits = {(row["family"], row["name"], row["part"]): row for row in grown["exponents"]}
    for family in grown["families"]:
        title = f"{family['name']}: {family['title']}; ratios to {BARE}"
        names = (BARE, FASTEST, *SOLVERS)
        head, table = ["model", *(name.removeprefix(f"{BARE} at ") for name in names)], []
        for own in by_size(of_family(grown["rows"], family["name"])).values():
            ratios = [short(own[name]["ratio"]) for name in (FASTEST, *SOLVERS)]
            table.append([own[BARE]["model"], f"{short(own[BARE]['step_us'])} µs", *ratios])
        table.append(["exponent", *(short(fits[(family["name"], name, STEP)]["all"]) for name in names)])
        print(title)
        print_table(head, table)


def _print_stepping_bench(rows: list[dict[str, Any]]) -> None:
    table = []
    for row in rows:
        gain = f"{row['speedup']:.2f} ×" if row["speedup"] else ""
        ratios = (f"{row['ratio']:.2f}", f"{row['ratio_to_fastest']:.2f}", gain)
        table.append([row["name"], f"{row['step_us']:.2f} µs", *ratios])
    print(rows[0]["model"])
    print_table(["a step of", "time", "to mj_step", "to its fastest setting", "cores gain"], table)


def _print_bench(rows: list[dict[str, Any]]) -> None:
    columns = ["from the step", "ratio", "from A and b", "ratio", "min-norm error", "contradicted", "products"]
    table = []
    best = min((row for row in rows if row["right"] and not row["library"]), key=lambda row: row["solve_ns"])
    for row in rows:
        mark = " *" if row is best else "" if row["right"] else " (not the minimum norm)"
        cells = [f"{row['solve_ns']:.0f} ns", f"{row['solve_ratio']:.3f}", f"{row['given_ns']:.0f} ns"]
        cells += [f"{row['given_ratio']:.3f}", f"{row['min_norm_error']:.1e}", f"{row['contradicted_error']:.1e}"]
        table.append([row["name"] + mark, *cells, f"{row['products']:.1f}"])
    print(f"n = {rows[0]['n']}")
    print_table(["solver", *columns], table)
