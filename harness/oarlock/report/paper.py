"""The figures of a report for print: as PDF or SVG of a journal's width, with the numbers behind each as CSV."""

import csv
import io
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import vl_convert

from oarlock.base.errors import InputError, choose
from oarlock.base.files import write_bytes, write_text
from oarlock.render.page import Figure, drawable
from oarlock.report.case_report import draw
from oarlock.report.tables import Tables
from oarlock.tables.folder import ResultFolder, believing

FORMATS = ("pdf", "svg")

MM = 72.0 / 25.4
"""Points in a millimetre: a unit of a drawing is a point of the page."""

WIDTHS_MM = (30.0, 400.0)
"""Narrower, labels take all of the room; wider than any page."""

FONTS = {"labelFontSize": 7, "titleFontSize": 8, "titleFontWeight": "normal"}
"""Of axes, legends and headings, in points."""

FACTORS, HALVINGS = (0.1, 2.0), 8
"""Between these the factor of the charts' widths is looked for, by so many halvings: to a hundredth."""

FLAT = 0.75
"""Part of its height that a chart keeps when it is made narrower: curves stay apart."""


def figure_set(results: Path, target: Path, width_mm: float = 86.0, kind: str = "pdf") -> list[Path]:
    """Writes every figure of a folder of results for print, and what it shows as CSV.

    Args:
        results: folder of results of one case.
        target: folder for the files, ``NAME.pdf`` (or ``.svg``) and ``NAME.csv``; those of these names are replaced.
        width_mm: width of the drawings, as a journal's column has it.
        kind: ``pdf`` or ``svg``.

    Returns:
        The files, figure by figure.

    Raises:
        InputError: the folder holds no results, a width out of range, an unknown kind, or a file cannot be written.
    """
    choose("format", kind, list(FORMATS))
    low, high = WIDTHS_MM
    if not low <= width_mm <= high:
        raise InputError(f"width = {width_mm:g} mm, expected {low:g} to {high:g} mm")
    with believing(results):
        drawn = drawable(draw(Tables(ResultFolder(results))))
    written: list[Path] = []
    for figure in drawn:
        spec, scale = for_print(figure, width_mm * MM)
        path = target / f"{figure.name}.{kind}"
        drawing = _scaled(vl_convert.vegalite_to_svg(spec), scale)
        if kind == "pdf":
            write_bytes(path, vl_convert.svg_to_pdf(drawing))
        else:
            write_text(path, drawing)
        written.append(path)
        for number, rows in enumerate(_data(spec)):
            table = target / f"{figure.name}{f'-{number + 1}' if number else ''}.csv"
            write_text(table, _csv(rows))
            written.append(table)
    return written


def for_print(figure: Figure, width: float) -> tuple[dict[str, Any], float]:
    """The document of a chart for a width (points), legends and labels included, with fonts of a printed page.

    Its charts are made narrower; where labels alone take more, the whole drawing is to be scaled by the number that is
    given with it.
    """
    spec = figure.chart.to_dict()
    spec["config"] = {**spec.get("config", {}), **{part: FONTS for part in ("axis", "legend", "header")}}
    if "hconcat" in spec:  # a column has no room for two beside one another
        spec["vconcat"] = spec.pop("hconcat")
    keep = 1.0 if figure.name == "mechanism" else FLAT  # whose lengths are to scale
    low, high = FACTORS
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _width(_resized(spec, middle, keep)) > width:
            high = middle
        else:
            low = middle
    resized = _resized(spec, low, keep)
    return resized, width / _width(resized)


def _width(spec: dict[str, Any]) -> float:
    found = re.search(r'<svg[^>]*\bwidth="([\d.]+)"', vl_convert.vegalite_to_svg(spec))
    assert found is not None
    return float(found[1])


def _scaled(svg: str, scale: float) -> str:
    """A drawing of another size, what is in it as it was."""
    head, end, rest = svg.partition(">")
    sizes = re.sub(r'\b(width|height)="([\d.]+)"', lambda size: f'{size[1]}="{float(size[2]) * scale:.2f}"', head)
    return f"{sizes}{end}{rest}"


def _resized(spec: Any, factor: float, keep: float) -> Any:
    """A copy of the document in which charts are so many times as wide."""
    if isinstance(spec, list):
        return [_resized(entry, factor, keep) for entry in spec]
    if not isinstance(spec, dict):
        return spec
    scales = {"width": factor, "height": factor if keep == 1.0 else max(factor, keep)}
    return {
        key: round(value * scales[key], 2)
        if key in scales and isinstance(value, int | float) and not isinstance(value, bool)
        else value
        if key in ("datasets", "config")
        else _resized(value, factor, keep)
        for key, value in spec.items()
    }


def _data(spec: dict[str, Any]) -> Iterator[list[dict[str, Any]]]:
    """The tables behind a chart."""
    yield from (rows for rows in spec.get("datasets", {}).values() if rows)


def _csv(rows: Sequence[dict[str, Any]]) -> str:
    names = list(dict.fromkeys(name for row in rows for name in row))
    stream = io.StringIO(newline="")
    writer = csv.DictWriter(stream, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()
