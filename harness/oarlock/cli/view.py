"""``oarlock view``: where the page goes, and who opens it."""

import os
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from oarlock.cli.bar import bar
from oarlock.cli.console import NoCodeOption, QuietOption, ends, say
from oarlock.cli.motion import ControlOption, ControlsOption, KeyframeOption, SeedOption, given_controls
from oarlock.diagnosis.options import CheckOptions


@ends()
def view(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE.xml|RESULTS",
            help="MJCF with loops closed by equalities, a MODEL, or a folder that 'oarlock run --out' wrote.",
        ),
    ],
    keyframe: KeyframeOption = None,
    controls: ControlsOption = None,
    control: ControlOption = None,
    seed: SeedOption = 0,
    duration: Annotated[float | None, typer.Option(metavar="S", help="Of the run [default: 2 s].")] = None,
    timestep: Annotated[float | None, typer.Option(metavar="S", help="In place of the model's.")] = None,
    integrator: Annotated[str | None, typer.Option(metavar="NAME", help="In place of the model's.")] = None,
    ignore_inequalities: Annotated[
        bool, typer.Option("--ignore-inequalities", help="Without contacts, limits and friction.")
    ] = False,
    model: Annotated[
        str | None,
        typer.Option(metavar="FILE.xml", help="Of RESULTS: their model, where it is no longer where it was."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="OUT.html", help="Write the page here [default: a temporary file, opened]."
        ),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.gif|FILE.mp4",
            help="A video of both motions side by side; MP4 needs ffmpeg. Without --out there is no page then.",
        ),
    ] = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Open no browser.")] = False,
    no_code: NoCodeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Shows MuJoCo's own motion in a browser, the exact one as a ghost, gaps of loops exaggerated, forces as arrows.

    One HTML file, which needs no net and no server: it can be kept, sent and put beside a report.
    """
    from oarlock.viewer.page import require_page
    from oarlock.viewer.session import view as look
    from oarlock.viewer.video import require_video

    if out is not None:
        require_page(out)
    if video is not None:
        require_video(video)
    options = CheckOptions(
        keyframe=keyframe,
        controls=controls,
        control=given_controls(control),
        seed=seed,
        duration=duration,
        timestep=timestep,
        integrator=integrator,
        ignore_inequalities=ignore_inequalities,
    )
    viewed = look(file, options, model_file=model)
    for note in [] if quiet else viewed.notes:
        say(f"oarlock: {note}")
    if video is not None:
        with bar(quiet=quiet) as progress:
            size = viewed.video(video, progress)
        print(f"{video} ({size / 1e6:.1f} MB)")
        if out is None:
            return
    path = out or _temporary(file)
    size = viewed.write(path)
    print(f"{path} ({size / 1e6:.1f} MB)")
    if out is None and not no_open and not _opened(path):
        say(f"oarlock: no browser was found; open {path} in one")


def _temporary(file: str) -> Path:
    stem = "".join(character for character in Path(file).stem if character.isalnum() or character in "-_")[:40]
    handle, name = tempfile.mkstemp(prefix=f"oarlock-{stem or 'model'}-", suffix=".html")
    os.close(handle)
    return Path(name)


def _opened(path: Path) -> bool:
    import webbrowser

    try:
        return webbrowser.open(path.resolve().as_uri())
    except (webbrowser.Error, OSError):
        return False
