"""``oarlock check``: what it prints, and its exit status."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from oarlock.base.errors import InputError
from oarlock.cli.console import GATE_FAILED, JsonOption, console, emit_json, ends, say, shown
from oarlock.diagnosis.wish import BUDGET_S, TARGET

if TYPE_CHECKING:
    from oarlock.diagnosis.examination import Examination
    from oarlock.diagnosis.verdict.findings import Finding

ROUNDING = 1e-9
"""Of the whole: smaller parts are rounding and not worth a word."""

_COLOURS = {"error": "red", "warning": "yellow", "note": "cyan"}


@ends()
def check(
    file: Annotated[str, typer.Argument(metavar="FILE.xml", help="MJCF with loops closed by equalities, or a MODEL.")],
    keyframe: Annotated[str | None, typer.Option(metavar="NAME", help="Start here [default: the first].")] = None,
    controls: Annotated[
        str | None, typer.Option(metavar="KIND", help="keyframe, constant or random (smooth) [default: what fits].")
    ] = None,
    control: Annotated[
        list[str] | None, typer.Option(metavar="ACTUATOR=VALUE", help="A constant control; may be repeated.")
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Of random controls.")] = 0,
    duration: Annotated[float | None, typer.Option(metavar="S", help="Of the run [default: 2 s].")] = None,
    timestep: Annotated[float | None, typer.Option(metavar="S", help="In place of the model's.")] = None,
    integrator: Annotated[str | None, typer.Option(metavar="NAME", help="In place of the model's.")] = None,
    target: Annotated[float, typer.Option(metavar="METRES", help="Wanted drift, m or rad.")] = TARGET,
    budget: Annotated[float, typer.Option(metavar="S", min=0.0, help="Time to look for settings; 0: none.")] = BUDGET_S,
    ignore_inequalities: Annotated[
        bool, typer.Option("--ignore-inequalities", help="Without contacts, limits and friction.")
    ] = False,
    fail_above: Annotated[
        float | None, typer.Option(metavar="METRES", help="Status 1 if an equality drifts further, m or rad.")
    ] = None,
    write_keyframe: Annotated[
        Path | None, typer.Option(metavar="OUT.xml", help="A copy with the nearest consistent start as a keyframe.")
    ] = None,
    write_tuned: Annotated[
        Path | None, typer.Option(metavar="OUT.xml", help="A copy with the settings that hold the loop.")
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="A page with figures: HTML, and Markdown with SVG.")
    ] = None,
    as_json: JsonOption = None,
) -> None:
    """Why do the loops of a model come apart, and what would hold them? Status 1: --fail-above was exceeded."""
    from oarlock.diagnosis.checked import check as examine

    printing = as_json != "-"

    def progress(part: str, found: "Examination") -> None:
        if printing:
            _SECTIONS.get(part, _nothing)(found)

    checked = examine(
        file,
        keyframe=keyframe,
        controls=controls,
        constant=_constants(control or []),
        seed=seed,
        duration_s=duration,
        timestep_s=timestep,
        integrator=integrator,
        target=target,
        budget_s=budget,
        ignore_inequalities=ignore_inequalities,
        fail_above=fail_above,
        progress=progress,
    )
    found = checked.examination
    if printing:
        _print_findings(checked.found)
    if write_keyframe:
        _write_keyframe(found, write_keyframe)
    if write_tuned:
        _write_tuned(found, write_tuned)
    if report:
        from oarlock.diagnosis.page.page import write_page

        say(f"oarlock: {write_page(found, checked.found, report)}")
    if as_json:
        emit_json(checked.document(), as_json)
    above = [finding for finding in checked.found if finding.code == "D7"]
    if above:
        say(f"oarlock: {above[0]}")
        raise typer.Exit(GATE_FAILED)


def _constants(given: Sequence[str]) -> dict[str, float]:
    found = {}
    for text in given:
        name, sign, value = text.rpartition("=")
        try:
            found[name] = float(value)
        except ValueError:
            sign = ""
        if not sign or not name:
            raise InputError(f"--control {text}, expected ACTUATOR=VALUE with a number")
    return found


def _write_keyframe(found: "Examination", target: Path) -> None:
    from oarlock.diagnosis.edit.keyframe import write_keyframe

    pose = found.pose
    if pose is None or not pose.closed:
        raise InputError(f"'{target}' is not written: no pose near the start closes the loops")
    name = write_keyframe(found.path, target, pose.qpos, pose.qvel)
    say(f"oarlock: {target}: keyframe '{name}'")


def _write_tuned(found: "Examination", target: Path) -> None:
    from oarlock.diagnosis.edit.tuned import write_tuned

    recipe = found.recipe
    if recipe is None:
        raise InputError(f"'{target}' is not written: {found.missing.get('remedy', 'no settings were looked for')}")
    if not recipe.reached:
        raise InputError(f"'{target}' is not written: {recipe.reason}")
    for path in write_tuned(found.path, target, recipe.chosen.setting):
        say(f"oarlock: {path}")


# What is printed of each part.


def _nothing(_found: "Examination") -> None:
    pass


def _heading(text: str) -> None:
    console().print(Text(text, style="bold"))


def _line(text: str) -> None:
    console().print(shown(text), soft_wrap=True)


def _table(titles: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> None:
    table = Table(box=None, header_style="bold", pad_edge=False)
    for index, title in enumerate(titles):
        table.add_column(title, justify="left" if index < left else "right", overflow="fold")
    for row in rows:
        table.add_row(*(shown(text) for text in row))
    console().print(table)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _loops(found: "Examination") -> None:
    pose = found.pose
    if pose is None:
        return
    loops = pose.loops
    _heading("1  The loops")
    whole = "1 equality" if len(loops.loops) == 1 else f"{len(loops.loops)} equalities"
    _line(
        f"{whole} in {_count(len(loops.groups), 'independent group')}: {_count(loops.rows, 'row')}, rank {loops.rank}, "
        f"redundancy {loops.redundancy}, {_count(loops.dof, 'degree')} of freedom left of {loops.nv}"
    )
    rows = [
        (
            loop.name,
            loop.equality.kind,
            " – ".join(loop.ends),
            loop.path.shape,
            str(len(loop.rows)),
            str(len(loop.zero_rows)),
            str(loop.group + 1),
            "yes" if loop.removable else "no",
        )
        for loop in loops.loops
    ]
    _table(("equality", "type", "between", "loop", "rows", "zero", "group", "removable"), rows, 4)


def _start(found: "Examination") -> None:
    pose = found.pose
    if pose is None:
        return
    _heading("2  The start")
    words = {
        "consistent": "consistent",
        "closed": "open, and can be closed",
        "locked": "closes, and then nothing of a group can move",
        "cannot-close": "cannot be closed",
    }
    _line(f"{found.begins}: {words[pose.status]}")
    for one in pose.openings:
        if one.largest > 1e-9:
            _line(f"  '{one.equality}' is open by {one}")
    if pose.closed and pose.moved_joint and pose.moved > 1e-9:
        _line(f"  the nearest closed pose moves '{pose.moved_joint}' by {pose.moved:.4g}, and others by less")


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


def _run(found: "Examination") -> None:
    recording = found.recording
    _heading("3  Drift")
    if recording is None:
        _line(f"  {found.missing.get('run', '')}")
        return
    beside = "the exact solution" if found.exact else f"nothing: {found.missing.get('exact', '')}"
    _line(f"{found.duration_s:g} s at {found.timestep_s:g} s, {recording.integrator}; {found.driven}")
    _line(f"MuJoCo as configured, against {beside}")
    if recording.end.how != "finished":
        _line(f"  MuJoCo's run ends at {recording.end.time_s:.4g} s: {recording.end.message}")
    by_name = {(one.equality, one.level): one for one in found.drifts}
    rows = []
    for one in found.drifts:
        if one.level == "position":
            fast, hard = by_name[one.equality, "velocity"], by_name[one.equality, "acceleration"]
            exact = max((value for value in (one.exact_metres, one.exact_radians) if value is not None), default=None)
            levels = [_number(one.metres), _number(one.radians), f"{one.time_s:.4g}", _number(exact)]
            rows.append((one.equality, *levels, _number(fast.largest), _number(hard.largest)))
    _table(("equality", "m", "rad", "at s", "exact", "per s", "per s²"), rows)


def _causes(found: "Examination") -> None:
    attribution = found.attribution
    _heading("4  Why")
    if attribution is None:
        _line(f"  {found.missing.get('causes', 'there is no run to look at')}")
        return
    causes = list(attribution.shares[0].shares) if attribution.shares else []
    rows = [
        (
            share.name,
            f"{share.worst:.3g} {share.unit}",
            f"{share.time_s:.4g}",
            *(f"{round(100.0 * share.shares[cause])} %" for cause in causes),
            f"{share.work:.3g}",
        )
        for share in attribution.shares
    ]
    titles = {"compliance": "softness", "curvature": "missing J̇v", "stepping": "time stepping"}
    _table(("equality", "worst row", "at s", *(titles.get(cause, cause) for cause in causes), "work J"), rows)
    from oarlock.diagnosis.page.document import accelerations_table

    apart = accelerations_table(found)
    if not apart.is_empty():
        parts = [
            f"{titles.get(row['cause'], row['cause'])} {row['rms']:.3g}"
            for row in apart.to_dicts()
            if row["rms"] > ROUNDING * apart["rms"][-1]
        ]
        _line(f"MuJoCo's acceleration off the exact one at the same states, rms: {', '.join(parts)} rad/s² or m/s²")


def _remedy(found: "Examination") -> None:
    recipe = found.recipe
    _heading("5  What would hold it")
    if recipe is None:
        _line(f"  {found.missing.get('remedy', '')}")
        return
    words = {"holds": "holds already", "reached": "reached", "not-reached": "not reached"}
    _line(f"a drift of {recipe.target:g}: {words[recipe.outcome]}; {recipe.reason}")
    rows = [
        (
            trial.label,
            trial.start,
            f"{trial.drift:.3g} {trial.unit}",
            f"{trial.energy_error:.3g}",
            f"{trial.cost:.2f}",
            "chosen" if trial is recipe.chosen else "",
        )
        for trial in recipe.trials
    ]
    _table(("settings", "start", "drift", "energy error J", "cost", ""), rows, 2)
    if recipe.mjcf:
        _line("paste into the model:")
        for line in recipe.mjcf.splitlines():
            _line(f"    {line}")


def _forces(found: "Examination") -> None:
    _heading("6  Forces")
    if not found.given:
        _line(f"  {found.missing.get('forces', 'there is no run to look at')}")
        return
    from oarlock.diagnosis.page.document import largest

    exact = {one.equality: one for one in found.determined}
    # Where the exact run ends early, as at a contact, both are compared until then.
    until = len(found.exact.time) if found.exact and len(found.exact.time) else None
    verdicts = {one.names[0]: one.verdict for one in found.reactions.equalities} if found.reactions else {}
    rows = []
    for one in found.given:
        own = exact.get(one.equality)
        pairs = [(one.total.force, own and own.total.force), (one.total.torque, own and own.total.torque)]
        cells = [_number(largest(None if values is None else values[:until])) for pair in pairs for values in pair]
        couplings = _number(largest(one.total.ends))
        rows.append((one.equality, *cells, couplings, verdicts.get(one.equality, "–")))
    _table(("equality", "N", "exact N", "N m", "exact N m", "coupling", "reaction"), rows)


_SECTIONS = {
    "loops": _loops,
    "start": _start,
    "run": _run,
    "causes": _causes,
    "remedy": _remedy,
    "forces": _forces,
}


def _print_findings(findings: Sequence["Finding"]) -> None:
    _heading("Findings")
    if not findings:
        _line("none")
    groups: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        groups.setdefault((finding.severity, finding.code), []).append(finding)
    for (severity, code), (first, *others) in groups.items():
        text = Text(f"{severity:8}", style=_COLOURS[severity])
        text.append_text(shown(f"{code} {first.name}  {first.element + ': ' if first.element else ''}{first.line}"))
        console().print(text, soft_wrap=True)
        if others:
            names = dict.fromkeys(one.element for one in others)
            _line(f"{'':8}   and {len(others)} more: {', '.join(list(names)[:6])}{', …' if len(names) > 6 else ''}")
    if findings:
        _line(f"oarlock explain {findings[0].code} says what that means, how it is measured, and what to do")
