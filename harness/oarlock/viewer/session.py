"""From what is to be shown, a model or a folder of results, to a page."""

import html as text
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from oarlock.base.answer import Answer, html_table
from oarlock.base.arguments import complete, takes
from oarlock.base.errors import InputError, few
from oarlock.base.files import write_text
from oarlock.base.progress import Progress
from oarlock.cases.case import model_names
from oarlock.diagnosis.options import CheckOptions
from oarlock.mechanics.given import Model
from oarlock.render.folder import require_report, write_whole
from oarlock.render.template import render
from oarlock.viewer import page
from oarlock.viewer.results import of_results
from oarlock.viewer.show import Show, show

KEPT = "case.json"
"""A folder with this file holds results."""

CONTENTS = ("README.md", "figures", "index.html")
"""Names in the folder of a page. A folder that holds anything else is not replaced."""

HIGH = 600
"""Pixels of a page in a notebook."""


class Viewed(Answer):
    """Two motions of a model, MuJoCo's and the exact one, as a page shows them.

    Attributes:
        shown: all that the page shows.
    """

    FRAMES = ("drift",)

    def __init__(self, shown: Show):
        self.shown = shown

    @property
    def notes(self) -> list[str]:
        """What is not shown, or not as it is, and why."""
        return self.shown.notes

    @property
    def drift(self) -> pl.DataFrame:
        """A row a frame: its time, s, and the largest deviation of a row in each motion, m or rad."""
        film = self.shown.film
        columns = {side.title: np.full(len(film.times), np.nan) for side in film.sides}
        for side in film.sides:
            columns[side.title][: len(side.drift)] = side.drift
        return pl.DataFrame({"time_s": film.times, **columns}).fill_nan(None)

    def write(self, path: str | Path) -> int:
        """Writes the page, one HTML file; gives its size in bytes.

        Raises:
            InputError: the name does not end in .html, or it cannot be written.
        """
        return page.write(self.shown, Path(path))

    def video(self, path: str | Path, progress: Progress | None = None) -> int:
        """Writes a video of both motions side by side, FILE.gif or FILE.mp4; gives its size in bytes.

        Args:
            path: the file; what is there is replaced.
            progress: listens: ``advance`` gets every frame.

        Raises:
            InputError: another name, no ffmpeg for an MP4, or it cannot be written.
        """
        from oarlock.viewer.video import write_video

        return write_video(self.shown, Path(path), progress)

    def document(self) -> dict[str, Any]:
        """What is shown, in words, and the drift of the frames."""
        shown = self.shown
        return {
            "title": shown.title,
            "head": shown.head,
            "notes": shown.notes,
            "motions": [side.title for side in shown.film.sides],
            "drift": self.drift.to_dicts(),
        }

    def report(self, folder: str | Path) -> Path:
        """Writes the page to a folder, with a drawing of the moment at which MuJoCo's loops are widest open.

        Raises:
            InputError: the folder cannot be written, or holds something else.
        """
        from oarlock.viewer.video import Video

        shown, target = self.shown, Path(folder)
        require_report(target, CONTENTS)
        worst = int(np.nan_to_num(shown.film.sides[0].drift).argmax())

        def write(new: Path) -> None:
            page.write(shown, new / "index.html")
            write_text(new / "figures" / "motion.svg", Video(shown).picture(worst))
            told = render("view.md.j2", title=shown.title, head=shown.head, notes=shown.notes)
            write_text(new / "README.md", told)

        return write_whole(target, write)

    def _repr_html_(self) -> str:
        sides = [
            [side.title, len(side.poses), float(np.nan_to_num(side.drift).max())] for side in self.shown.film.sides
        ]
        told = html_table(self.shown.head, ["motion", "frames", "largest drift (m, rad)"], sides, self.notes)
        return f'{told}<iframe srcdoc="{text.escape(page.html(self.shown))}" width="100%" height="{HIGH}"></iframe>'


@takes(CheckOptions)
def view(
    model: Model,
    options: CheckOptions | None = None,
    *,
    model_file: str | Path | None = None,
    progress: Progress | None = None,
    **keywords: Any,
) -> Viewed:
    """Shows MuJoCo's own motion of a model beside the exact one: runs it, or takes both from a folder of results.

    Args:
        model: as of ``oarlock.check``, or a folder that ``oarlock.run`` wrote, of which nothing is run anew.
        options: where a run starts, what drives it, how long it is.
        model_file: of a folder of results: its model, where that is no longer where it was.
        progress: listens: ``finished`` gets the name of every part that is there.
        keywords: the fields of ``CheckOptions``, one by one: ``duration=1.0, keyframe="home"``.

    Raises:
        InputError: as ``oarlock.check``; a folder of results without MuJoCo's motion, or whose model is not there.
    """
    options = complete(CheckOptions, options, keywords)
    folder = _results(model)
    if folder is None:
        if model_file is not None:
            raise InputError(f"model_file = '{model_file}' beside a model, expected a folder of results")
        listens = progress or Progress()
        return Viewed(show(model, replace(options, budget=0.0), listens.finished))
    usual = CheckOptions()
    asked = [one.name for one in fields(usual) if getattr(options, one.name) != getattr(usual, one.name)]
    if asked := [name for name in asked if name != "budget"]:
        raise InputError(f"{asked[0]} beside '{folder}', which is shown as it was run, expected no such option")
    return Viewed(of_results(folder, model_file))


def _results(model: Model) -> Path | None:
    """The folder of results that is meant; None where a model is.

    Raises:
        InputError: it holds those of several cases.
    """
    if not isinstance(model, str | Path) or str(model) in model_names() or not Path(model).is_dir():
        return None
    folder = Path(model)
    if (folder / KEPT).is_file():
        return folder
    if several := [str(path.parent) for path in sorted(folder.glob(f"*/{KEPT}"))]:
        raise InputError(f"'{folder}' holds results of several cases, expected one of {few(several)}")
    return None
