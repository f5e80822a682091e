"""``oarlock run``: what it prints, and its exit status."""

from pathlib import Path
from typing import Annotated, get_args

import typer

from oarlock.base.errors import InputError
from oarlock.base.numbers import short
from oarlock.base.text import visible
from oarlock.cases.case import load_case
from oarlock.cases.case_file import Stabilisation
from oarlock.cases.integrators import RUNNING
from oarlock.cli.bar import bar
from oarlock.cli.console import (
    GATE_FAILED,
    KEPT,
    JsonOption,
    NoCodeOption,
    QuietOption,
    emit_json,
    ends,
    one_of,
    say,
)
from oarlock.cli.motion import ControlOption, ControlsOption, KeyframeOption, SeedOption, StatesOption, given_controls
from oarlock.cli.tables import print_table
from oarlock.experiments import session
from oarlock.experiments.modes import ASKABLE
from oarlock.experiments.options import FORMS, RunOptions, Stepping
from oarlock.experiments.outcome import COLUMNS, WORDS, Results, glance
from oarlock.render.folder import CONTENTS, require_report
from oarlock.tables.promise import doubts


def _print_summary(results: Results) -> None:
    rows = [[short(value) for value in glance(row)] for row in results.rows]
    print_table(list(COLUMNS.values()), rows, WORDS)
    integrators = ", ".join(dict.fromkeys(row["integrator"] for row in results.rows))
    print(visible(f"{results.motion}; integrator {integrators}"))


@ends(KEPT)
def run(
    model: Annotated[
        str, typer.Argument(metavar="MODEL[:key=value,…]|FILE.xml", help="A model's name, or any MJCF file.")
    ],
    solver: Annotated[
        list[str] | None, typer.Option(metavar="NAME[:key=value,…]", help="Solver; may be repeated.")
    ] = None,
    form: Annotated[str | None, typer.Option(help=one_of(FORMS))] = None,
    mode: Annotated[str | None, typer.Option(help=one_of(ASKABLE))] = None,
    walker: Annotated[str | None, typer.Option(help="Who walks in lockstep: mujoco or a solver.")] = None,
    integrator: Annotated[str | None, typer.Option(help=one_of(RUNNING))] = None,
    stabilisation: Annotated[
        str | None, typer.Option(help=f"What holds exact constraints: {one_of(get_args(Stabilisation))}")
    ] = None,
    keyframe: KeyframeOption = None,
    controls: ControlsOption = None,
    control: ControlOption = None,
    seed: SeedOption = 0,
    states: StatesOption = None,
    timestep: Annotated[float | None, typer.Option(metavar="S", help="Timestep in s.")] = None,
    duration: Annotated[float | None, typer.Option(metavar="S", help="Duration in s.")] = None,
    rtol: Annotated[float | None, typer.Option(help="Relative tolerance of the solvers that have one.")] = None,
    ignore_inequalities: Annotated[
        bool, typer.Option("--ignore-inequalities", help="Run without the model's contacts, limits and friction.")
    ] = False,
    stepping: Annotated[str, typer.Option(help=f"The path that steps: {one_of(get_args(Stepping))}")] = "auto",
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder for the tables [default: results/MODEL, or results/MODEL-2 … where that holds other results].",
        ),
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Let go other results that the folder holds.")] = False,
    to: Annotated[
        Path | None, typer.Option("--report", metavar="DIR", help="Write the report too, as 'oarlock report' does.")
    ] = None,
    as_json: JsonOption = None,
    no_code: NoCodeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Runs a model's comparison. With none of the options before --keyframe it runs the experiments of its case."""
    options = RunOptions(
        solver=solver or (),
        form=form,
        mode=mode,
        walker=walker,
        integrator=integrator,
        stabilisation=stabilisation,
        keyframe=keyframe,
        controls=controls,
        control=given_controls(control),
        seed=seed,
        states=states,
        timestep=timestep,
        duration=duration,
        rtol=rtol,
        ignore_inequalities=ignore_inequalities,
        stepping=stepping,
    )
    folder = out or Path("results") / load_case(model).slug
    if to:
        _require_place(to, folder)
    with bar(quiet=quiet) as progress:
        if out is None and not replace:
            results = session.run_beside(model, options, folder, progress)
        else:
            results = session.run(model, options, out=folder, replace=replace, progress=progress)
    if as_json:
        emit_json(results.document(), as_json)
    if as_json != "-":
        _print_summary(results)
    if results.still:
        say("oarlock: nothing moves: give it a start with a velocity (--keyframe), or controls (--controls, --control)")
    if "inequalities_ignored" in results.provenance:
        say(f"oarlock: inequalities ignored: {results.provenance['inequalities_ignored']}")
    if "python_solvers" in results.provenance:
        say(f"oarlock: called in Python, which is slow: {results.provenance['python_solvers']}")
    lost = results.lost
    for row in results.rows:
        if row["status"] != "done":
            expected = "" if row in lost else "; the case expects that"
            say(f"oarlock: run {row['run']} {row['status']}: {row['message']}{expected}")
    for doubt in doubts(results.rows):
        say(f"oarlock: {doubt}")
    for verdict in results.failures:
        say(f"oarlock: gate failed: {verdict.line()}")
    unchecked = sum(verdict.held is None for verdict in results.verdicts)
    if unchecked:
        say(
            f"oarlock: {unchecked} gate(s) of the case not checked: "
            "no run at the case's own parameters, timestep and duration"
        )
    if to:
        say(f"oarlock: written: {results.report(to) / 'README.md'}")
    if as_json != "-":
        print(visible(results.answer))
    if results.failures or lost:
        raise typer.Exit(GATE_FAILED)


def _require_place(report: Path, results: Path) -> None:
    """Before a run, for what is wrong with the place of its report would be said only after it."""
    if results.resolve().is_relative_to(report.resolve()):
        raise InputError(f"'{report}' is where the results go, expected another folder for the report")
    require_report(report, CONTENTS)
