"""The report of an examination: one page without outside references, the same as Markdown with drawings, a fragment."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from oarlock.base.files import write_text
from oarlock.base.text import markdown
from oarlock.base.text import one_line as plain
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.page import pictures
from oarlock.diagnosis.page.blocks import STILL, Chapter, Picture, Stage
from oarlock.diagnosis.page.chapters.contents import chapters
from oarlock.diagnosis.page.chapters.findings import findings
from oarlock.diagnosis.page.chapters.fixed import fixed
from oarlock.diagnosis.page.chapters.head import head
from oarlock.diagnosis.page.motion import Motion, motion, still
from oarlock.diagnosis.verdict.answer import answer
from oarlock.diagnosis.verdict.findings import Finding
from oarlock.render.folder import require_report, write_whole
from oarlock.render.page import Figure, drawable, script_json, script_library
from oarlock.render.template import render

CONTENTS = ("README.md", "figures", "index.html")
"""What a report consists of. A folder that holds anything else is not replaced."""


def markdown_text(text: object) -> str:
    """Text that stays text in Markdown, in a sentence and in a cell, and leads nowhere."""
    return re.sub(r"(?i)\b(www)\.", r"\1\\.", markdown(text).replace("://", ":\\//"))


def write_page(exam: Examination, found: Sequence[Finding], folder: Path, fix: Mapping[str, Any] | None = None) -> Path:
    """Writes README.md, figures/*.svg and index.html.

    The folder is made whole under a temporary name and then takes the place of the old one.

    Args:
        exam: whatever there is of it; of the rest the page says why it is missing.
        found: the findings, in any order.
        folder: a new one, or an old report of this kind.
        fix: the document of the file that mends it, if there is one.

    Raises:
        InputError: the folder cannot be written, or is not a report.
    """
    require_report(folder, CONTENTS)
    moving = motion(exam)
    every = [*_illustrated(exam, moving), *([fixed(fix)] if fix else [])]
    values = _values(exam, found, every)
    drawn = [block.figure for chapter in every for block in chapter.blocks if isinstance(block, Picture)]
    specs = {figure.name: json.loads(figure.spec) for figure in drawn}
    drawings = {figure.name: figure.svg() for figure in drawn}
    if moving:
        drawings[STILL] = still(moving)
    page = render(
        "check.page.html.j2",
        escaping=True,
        **values,
        specs=script_json(specs),
        motion=script_json(moving.document() if moving else None),
        library=script_library(),
    )
    text = render("check.md.j2", **values, md=markdown_text)
    return write_whole(folder, lambda new: _write(new, text, page, drawings))


def html_fragment(exam: Examination, found: Sequence[Finding]) -> str:
    """Findings and tables as HTML without figures, for a notebook."""
    return render("check.fragment.html.j2", escaping=True, **_values(exam, found, chapters(exam)))


def _write(folder: Path, text: str, page: str, drawings: dict[str, str]) -> None:
    (folder / "figures").mkdir()
    for name, drawing in drawings.items():
        write_text(folder / "figures" / f"{name}.svg", drawing)
    write_text(folder / "README.md", text)
    write_text(folder / "index.html", page)


def _illustrated(exam: Examination, moving: Motion | None) -> list[Chapter]:
    """The chapters with their figures, each before the tables of its chapter."""
    figures: dict[str, list[Figure | None]] = {
        "loops": [pictures.ranks(exam)],
        "drift": [pictures.drift(exam)],
        "why": [pictures.causes(exam), pictures.parts(exam), pictures.work(exam)],
        "remedy": [pictures.pareto(exam)],
        "forces": [*pictures.forces(exam)],
    }
    every = chapters(exam)
    for chapter in every:
        blocks: list[Picture | Stage] = [
            Picture(figure) for figure in drawable([one for one in figures.get(chapter.name, []) if one])
        ]
        if chapter.name == "drift" and moving is not None:
            blocks.insert(0, Stage(moving.caption))
        chapter.illustrate(blocks)
    return every


def _values(exam: Examination, found: Sequence[Finding], every: list[Chapter]) -> dict[str, Any]:
    """What the templates lay out."""
    return {
        "title": plain(exam.file),
        "answer": plain(answer(exam, found)),
        "head": head(exam),
        "chapters": [findings(found), *every],
    }
