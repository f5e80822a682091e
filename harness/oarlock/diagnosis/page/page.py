"""The report of an examination: one page without outside references, the same as Markdown with drawings, a fragment."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import vl_convert

from oarlock.diagnosis.examination import Examination
from oarlock.diagnosis.page import answers, chapters, pictures
from oarlock.diagnosis.page.blocks import Chapter, Picture, Stage, Table, plain
from oarlock.diagnosis.page.motion import Motion, motion, still
from oarlock.diagnosis.verdict.findings import SEVERITIES, Finding, catalogue, worst_first
from oarlock.render.folder import require_report, write_whole
from oarlock.render.page import script_json, script_library
from oarlock.render.template import render

CONTENTS = ("README.md", "figures", "index.html")
"""What a report consists of. A folder that holds anything else is not replaced."""

STILL = "mechanism"
"""Name of the drawing of the worst moment."""

_MARKUP = re.compile(r"([\\`*{}\[\]<>#|!&~$^]|(?<![^\W_])_|_(?![^\W_]))")


def markdown_text(text: object) -> str:
    """Text that stays text in Markdown, in a sentence and in a cell, and leads nowhere."""
    escaped = _MARKUP.sub(r"\\\1", plain(text))
    return re.sub(r"(?i)\b(www)\.", r"\1\\.", escaped.replace("://", ":\\//"))


def write_page(found: Examination, findings: Sequence[Finding], folder: Path) -> Path:
    """Writes README.md, figures/*.svg and index.html.

    The folder is made whole under a temporary name and then takes the place of the old one.

    Args:
        found: whatever there is of it; of the rest the page says why it is missing.
        findings: in any order.
        folder: a new one, or an old report of this kind.

    Raises:
        InputError: the folder cannot be written, or is not a report.
    """
    require_report(folder, CONTENTS)
    moving = motion(found)
    every = _illustrated(found, moving)
    values = _values(found, findings, every)
    drawn = [block.figure for chapter in every for block in chapter.blocks if isinstance(block, Picture)]
    specs = {figure.name: figure.chart.to_dict() for figure in drawn}
    page = render(
        "check.page.html.j2",
        escaping=True,
        **values,
        specs=script_json(specs),
        motion=script_json(moving.document() if moving else None),
        library=script_library(),
    )
    text = render("check.md.j2", **values, md=markdown_text, still=STILL)
    return write_whole(folder, lambda new: _write(new, text, page, specs, moving))


def html_fragment(found: Examination, findings: Sequence[Finding]) -> str:
    """Findings and tables as HTML without figures, for a notebook."""
    return render("check.fragment.html.j2", escaping=True, **_values(found, findings, _chapters(found)))


def _write(folder: Path, text: str, page: str, specs: dict[str, Any], moving: Motion | None) -> None:
    (folder / "figures").mkdir()
    for name, spec in specs.items():
        (folder / "figures" / f"{name}.svg").write_text(vl_convert.vegalite_to_svg(spec), encoding="utf-8")
    if moving is not None:
        (folder / "figures" / f"{STILL}.svg").write_text(still(moving), encoding="utf-8")
    (folder / "README.md").write_text(text, encoding="utf-8")
    (folder / "index.html").write_text(page, encoding="utf-8")


def _chapters(found: Examination) -> list[Chapter]:
    makers = (chapters.loops, chapters.start, chapters.drift, answers.why, answers.remedy, answers.forces)
    return [make(found) for make in makers]


def _illustrated(found: Examination, moving: Motion | None) -> list[Chapter]:
    """The chapters with their figures, each before the tables of its chapter."""
    every = _chapters(found)
    figures = {
        "loops": [pictures.ranks(found)],
        "drift": [pictures.drift(found)],
        "why": [pictures.causes(found), pictures.parts(found), pictures.work(found)],
        "remedy": [pictures.pareto(found)],
        "forces": list(pictures.forces(found)),
    }
    for chapter in every:
        blocks: list[Any] = [Picture(figure) for figure in figures.get(chapter.name, []) if figure is not None]
        if chapter.name == "drift" and moving is not None:
            blocks.insert(0, Stage(moving.caption))
        tables = [at for at, block in enumerate(chapter.blocks) if isinstance(block, Table)]
        at = tables[0] if tables else len(chapter.blocks)
        chapter.blocks[at:at] = blocks
    return every


def _values(found: Examination, findings: Sequence[Finding], every: list[Chapter]) -> dict[str, Any]:
    ordered = worst_first(findings)
    codes = catalogue()
    counts = {severity: sum(one.severity == severity for one in ordered) for severity in SEVERITIES}
    return {
        "title": plain(found.file),
        "head": chapters.head(found),
        "findings": ordered,
        "counted": ", ".join(chapters.counted(count, severity) for severity, count in counts.items() if count),
        "entries": codes,
        "explained": [codes[code] for code in dict.fromkeys(one.code for one in ordered)],
        "chapters": every,
        "plain": plain,
    }
