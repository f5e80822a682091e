"""``oarlock check``: what it prints, and its exit status."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from oarlock.base.errors import InputError
from oarlock.cli.console import GATE_FAILED, JsonOption, NoCodeOption, emit_json, ends, say
from oarlock.cli.motion import ControlOption, ControlsOption, KeyframeOption, SeedOption, given_controls
from oarlock.diagnosis.checked import begun, judged, parts
from oarlock.diagnosis.options import BUDGET_S, TARGET, CheckOptions

if TYPE_CHECKING:
    from oarlock.diagnosis.checked import Checked
    from oarlock.diagnosis.examination import Examination


@ends()
def check(
    file: Annotated[str, typer.Argument(metavar="FILE.xml", help="MJCF with loops closed by equalities, or a MODEL.")],
    keyframe: KeyframeOption = None,
    controls: ControlsOption = None,
    control: ControlOption = None,
    seed: SeedOption = 0,
    states: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="A log of what a program really did, in place of MuJoCo's own run: FILE.npz with time, qpos, qvel, "
            "ctrl and act before every step, or FILE.csv with qpos0, qpos1 …",
        ),
    ] = None,
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
        Path | None, typer.Option(metavar="DIR", help="A page with figures: HTML, and Markdown with SVG.")
    ] = None,
    as_json: JsonOption = None,
    no_code: NoCodeOption = False,
) -> None:
    """Why do the loops of a model come apart, and what would hold them?

    Status 1: --fail-above was exceeded, --lint found an error, or a file that was asked for does not hold the target.
    """
    printing = as_json != "-"
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
    if lint:
        _require_alone(
            {"--report": report, "--write-keyframe": write_keyframe, "--write-tuned": write_tuned, "--fix": fix}
            | {"--fail-above": fail_above}
        )
    exam = begun(file, options)
    _require_places(exam, [path for path in (write_keyframe, write_tuned, fix) if path])
    checked = _examined(exam)
    if printing:
        _print(checked)
    kept = [
        write_keyframe is None or _written(write_keyframe, lambda path: _write_keyframe(exam, path)),
        write_tuned is None or _written(write_tuned, lambda path: _write_tuned(exam, path)),
        fix is None or _written(fix, lambda path: _fix(checked, path, printing)),
    ]
    if report:
        say(f"oarlock: {checked.report(report)}")
    if as_json:
        emit_json(checked.document(), as_json)
    if lint and any(finding.severity == "error" for finding in checked.verdict):
        raise typer.Exit(GATE_FAILED)
    above = [finding for finding in checked.verdict if finding.code == "D7"]
    if above:
        say(f"oarlock: {above[0]}")
    if above or not all(kept):
        raise typer.Exit(GATE_FAILED)


def _examined(exam: "Examination") -> "Checked":
    from oarlock.cli.bar import bar
    from oarlock.diagnosis.examination import PARTS

    with bar() as progress:
        progress.begin("checking", len(PARTS))
        for _ in parts(exam):
            progress.advance(1)
        return judged(exam)


def _require_alone(others: Mapping[str, object]) -> None:
    for flag, value in others.items():
        if value is not None:
            raise InputError(f"{flag} with --lint, expected one of the two: it shows a run")


def _print(checked: "Checked") -> None:
    """The answer first; what it rests on after it."""
    from oarlock.cli.blocks import print_chapter, print_line
    from oarlock.diagnosis.page.chapters.contents import chapters
    from oarlock.diagnosis.page.chapters.findings import findings
    from oarlock.diagnosis.page.chapters.head import head

    exam = checked.examination
    print_line(checked.answer)
    print_line(head(exam))
    print_chapter(findings(checked.verdict))
    if not exam.options.lint:
        for chapter in chapters(exam):
            print_chapter(chapter)


def _require_places(exam: "Examination", paths: Sequence[Path]) -> None:
    """Refuses files that cannot be written before anything takes time."""
    if paths:
        from oarlock.diagnosis.edit.place import require_place

        for path in paths:
            require_place(exam.path, path)


def _written(target: Path, write: Callable[[Path], bool]) -> bool:
    """Says whether a copy holds what it should; the report and the JSON are had without it, too."""
    try:
        return write(target)
    except InputError as error:
        say(f"oarlock: '{target}' is not written: {error}")
        return False


def _write_keyframe(exam: "Examination", target: Path) -> bool:
    from oarlock.diagnosis.edit.keyframe import source_key, write_keyframe

    pose = exam.pose
    if pose is None or not pose.closed:
        raise InputError("no pose near the start closes the loops")
    name = write_keyframe(exam.path, target, pose.qpos, pose.qvel, like=source_key(exam.model, exam.options.keyframe))
    say(f"oarlock: {target}: keyframe '{name}'")
    return True


def _write_tuned(exam: "Examination", target: Path) -> bool:
    """Says whether the settings hold the target; the best ones are written anyway."""
    from oarlock.diagnosis.edit.tuned import write_tuned

    recipe = exam.recipe
    if recipe is None:
        raise InputError(exam.missing.get("remedy", "no settings were looked for"))
    for path in write_tuned(exam.path, target, recipe.chosen.setting):
        say(f"oarlock: {path}")
    if not recipe.reached:
        say(f"oarlock: warning: {target} does not hold {recipe.target:g}: {recipe.reason}")
    return recipe.reached


def _fix(checked: "Checked", target: Path, printing: bool) -> bool:
    """Says whether the fixed file holds what it should."""
    from oarlock.cli.blocks import print_line

    fixed = checked.fix(target)
    if printing:
        print_line(f"Fixed: {target}")
        for line in fixed.told():
            print_line(line)
    else:
        say(f"oarlock: {target}")
    if not fixed.reached:
        say(f"oarlock: warning: {target}: {fixed.reason}")
    return fixed.reached
