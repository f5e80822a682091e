"""``oarlock export-problems``: what solvers are asked along a run, as a file of arrays."""

from pathlib import Path
from typing import Annotated, cast

import typer

from oarlock.cases.case_file import Form
from oarlock.cases.motion import Motion
from oarlock.cli.console import NoCodeOption, ends, say
from oarlock.cli.motion import ControlOption, ControlsOption, KeyframeOption, SeedOption, given_controls


@ends()
def export_problems(
    model: Annotated[
        str, typer.Argument(metavar="MODEL[:key=value,…]|FILE.xml", help="A model's name, or any MJCF file.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="FILE.npz or FILE.parquet.")],
    form: Annotated[str, typer.Option(metavar="FORM", help="hard (exact constraints) or matched (MuJoCo's).")] = "hard",
    walker: Annotated[str, typer.Option(metavar="NAME", help="Who walks: a solver, or mujoco.")] = "auto",
    duration: Annotated[float | None, typer.Option(metavar="S", help="Of the run, s.")] = None,
    timestep: Annotated[float | None, typer.Option(metavar="S", help="Timestep in s.")] = None,
    every: Annotated[int, typer.Option(metavar="N", min=1, help="Each so many-th step.")] = 1,
    keyframe: KeyframeOption = None,
    controls: ControlsOption = None,
    control: ControlOption = None,
    seed: SeedOption = 0,
    no_code: NoCodeOption = False,
) -> None:
    """A, b, J, M, null space and multipliers of every step of a run: problems for solvers of one's own."""
    from oarlock.experiments.problems import COLUMNS, export_problems, require_ending

    require_ending(out)
    motion = Motion(keyframe, controls, given_controls(control), seed)
    problems = export_problems(
        model, form=cast(Form, form), walker=walker, duration=duration, timestep=timestep, every=every, motion=motion
    )
    say(f"oarlock: written: {problems.save(out)}: {len(problems)} problems of up to {problems.largest} rows")
    if problems.ended:
        say(f"oarlock: {problems.ended}")
    for name, meaning in COLUMNS.items():
        say(f"  {name:12} {meaning}")
