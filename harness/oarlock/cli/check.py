"""``oarlock check``: what it prints, and its exit status."""

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from oarlock.base.errors import InputError
from oarlock.cli.checking import Asked, Outcome, checked_file, refused
from oarlock.cli.console import JsonOption, NoCodeOption, QuietOption, emit, emit_json, ends, prints, say
from oarlock.cli.motion import ControlOption, ControlsOption, KeyframeOption, SeedOption, StatesOption, given_controls
from oarlock.diagnosis.options import BUDGET_S, TARGET, CheckOptions


@ends()
def check(
    files: Annotated[
        list[str], typer.Argument(metavar="FILE.xml…", help="MJCF with loops closed by equalities, or MODELs.")
    ],
    keyframe: KeyframeOption = None,
    controls: ControlsOption = None,
    control: ControlOption = None,
    seed: SeedOption = 0,
    states: StatesOption = None,
    duration: Annotated[float | None, typer.Option(metavar="S", help="Of the run [default: 2 s].")] = None,
    timestep: Annotated[float | None, typer.Option(metavar="S", help="In place of the model's.")] = None,
    integrator: Annotated[str | None, typer.Option(metavar="NAME", help="In place of the model's.")] = None,
    target: Annotated[
        float | None,
        typer.Option(metavar="METRES", help=f"Wanted drift, m or rad [default: {TARGET:g} of the loops' size]."),
    ] = None,
    budget: Annotated[
        float, typer.Option(metavar="S", min=0.0, help="Work to look for settings, in s of a usual machine; 0: none.")
    ] = BUDGET_S,
    ignore_inequalities: Annotated[
        bool, typer.Option("--ignore-inequalities", help="Without contacts, limits and friction.")
    ] = False,
    lint: Annotated[bool, typer.Option("--lint", help="Only what is seen without a run: milliseconds.")] = False,
    fail_above: Annotated[
        float | None, typer.Option(metavar="METRES", help="Status 1 if an equality drifts further, m or rad.")
    ] = None,
    hold: Annotated[
        list[str] | None,
        typer.Option(
            metavar="JOINT", help="Stays where an open start is closed; may be repeated [default: driven; none]."
        ),
    ] = None,
    write_keyframe: Annotated[
        Path | None, typer.Option(metavar="OUT.xml", help="A copy with the nearest consistent start as a keyframe.")
    ] = None,
    write_tuned: Annotated[
        Path | None, typer.Option(metavar="OUT.xml", help="A copy with the settings that hold the loop.")
    ] = None,
    fix: Annotated[
        Path | None, typer.Option(metavar="OUT.xml", help="One file with everything that helps, tried and checked.")
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="A page with figures: HTML, and Markdown with SVG; of several a folder each."),
    ] = None,
    as_json: JsonOption = None,
    sarif: Annotated[
        str | None, typer.Option(metavar="FILE|-", help="Write the findings as SARIF, with the lines they are about.")
    ] = None,
    junit: Annotated[
        str | None, typer.Option(metavar="FILE|-", help="Write JUnit XML: a suite a file, a test case a finding.")
    ] = None,
    no_code: NoCodeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Why do the loops of a model come apart, and what would hold them?

    Status 1: --fail-above was exceeded, --lint found an error, or a file that was asked for does not hold the target.
    Of several files each is checked, whatever the others are; the status is the worst, the JSON a list.
    """
    copies = {"--write-keyframe": write_keyframe, "--write-tuned": write_tuned, "--fix": fix}
    copies = {flag: path for flag, path in copies.items() if path is not None}
    if lint:
        shown = {"--states": states, "--duration": duration, "--target": target, "--hold": hold or None}
        _require_alone({**copies, "--report": report, "--fail-above": fail_above, **shown})
    options = CheckOptions(
        keyframe=keyframe,
        controls=controls,
        control=given_controls(control),
        seed=seed,
        states=states,
        duration=duration,
        timestep=timestep,
        integrator=integrator,
        target=target,
        budget=budget,
        ignore_inequalities=ignore_inequalities,
        fail_above=fail_above,
        lint=lint,
        hold=None if not hold else [] if hold == ["none"] else hold,
    )
    several = len(files) > 1
    if several and copies:
        raise InputError(f"{next(iter(copies))} with {len(files)} files, expected one file to copy")
    wanted = {"json": as_json, "sarif": sarif, "junit": junit}
    printing = prints({f"--{name}": to for name, to in wanted.items()})
    asked = Asked(options, copies, printing, quiet, frozenset(name for name, to in wanted.items() if to))
    outcomes = []
    for file, folder in zip(files, _folders(files, report), strict=True):
        if several and printing:
            _print_heading(file, first=not outcomes)
        outcomes.append(_one(file, asked, folder))
    if as_json and several:
        emit_json([outcome.json for outcome in outcomes], as_json)
    elif as_json and not outcomes[0].refused:
        emit_json(outcomes[0].json, as_json)
    _write(outcomes, sarif, junit)
    if printing:
        _print_verdicts(outcomes)
    if status := max(outcome.status for outcome in outcomes):
        raise typer.Exit(status)


def _one(file: str, asked: Asked, report: Path | None) -> Outcome:
    try:
        return checked_file(file, asked, report)
    except BrokenPipeError:  # nobody reads: of no file is there anything left to say
        raise
    except (InputError, OSError) as error:
        outcome = refused(file, error)
        say(f"oarlock: {outcome.refused}")
        return outcome


def _require_alone(others: Mapping[str, object]) -> None:
    for flag, value in others.items():
        if value is not None:
            raise InputError(f"{flag} with --lint, expected one of the two: it shows a run")


def _folders(files: Sequence[str], report: Path | None) -> list[Path | None]:
    """Where the page of every file goes: of several into folders of their own, named after the files."""
    if report is None or len(files) == 1:
        return [report] * len(files)
    names = list[str]()
    for file in files:
        stem = Path(file).stem or "model"
        numbered = (f"{stem}-{number}" for number in itertools.count(2))
        names.append(next(name for name in itertools.chain([stem], numbered) if name not in names))
    return [report / name for name in names]


def _print_heading(file: str, first: bool) -> None:
    from oarlock.cli.blocks import print_heading, print_line

    if not first:
        print_line("")
    print_heading(file)


def _print_verdicts(outcomes: Sequence[Outcome]) -> None:
    """A line a file, after all else."""
    from oarlock.cli.blocks import print_line

    if len(outcomes) > 1:
        print_line("")
    for outcome in outcomes:
        if len(outcomes) > 1 or not outcome.refused:
            print_line(outcome.verdict)


def _write(outcomes: Sequence[Outcome], sarif: str | None, junit: str | None) -> None:
    """Writes the documents of all files."""
    if sarif:
        from oarlock.diagnosis.page.sarif import sarif as document

        results: list[dict[str, Any]] = [result for outcome in outcomes for result in outcome.sarif]
        emit_json(document(results, [(one.file, one.refused) for one in outcomes if one.refused]), sarif)
    if junit:
        from oarlock.base.junit import junit as render

        emit(render("oarlock check", [outcome.suite for outcome in outcomes if outcome.suite]), junit)
