"""Figures for print: as wide as was asked for, readable, with their numbers."""

import csv
import re

import polars as pl
import pytest
from oarlock.base.errors import InputError
from oarlock.report.paper import MM, figure_set

LEAST = 5.0
"""Points that the smallest letters have at least, also where labels take more room than a column has."""


@pytest.mark.parametrize("width", [86.0, 180.0])
def test_drawings_are_as_wide_as_the_column_and_their_labels_as_large_as_print(boat_run, tmp_path, width):
    files = figure_set(boat_run.folder, tmp_path, width, "svg")
    drawings = [path for path in files if path.suffix == ".svg"]
    assert {path.stem for path in drawings} >= {"mechanism", "deviations", "truth", "iterations"}
    for path in drawings:
        text = path.read_text()
        head = text[: text.index(">")]
        found = float(re.search(r'\bwidth="([\d.]+)"', head)[1])
        inside = float(re.search(r'viewBox="0 0 ([\d.]+)', head)[1])
        assert found == pytest.approx(width * MM, abs=0.01), path.name
        sizes = {float(size) * found / inside for size in re.findall(r'font-size="([\d.]+)px"', text)}
        assert all(size >= LEAST for size in sizes), (path.name, sizes)


def test_pdf_is_pdf_and_every_curve_has_its_numbers(boat_run, tmp_path):
    files = figure_set(boat_run.folder, tmp_path)
    assert all(path.read_bytes().startswith(b"%PDF") for path in files if path.suffix == ".pdf")
    with (tmp_path / "truth.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    numbers = {float(value) for row in rows for value in row.values() if _is_number(value)}
    worst = pl.read_parquet(boat_run.folder / "steps" / "free-hard-pinv-rk4.parquet")["truth_error"].max()
    assert min(abs(number - worst) for number in numbers) <= 1e-3 * worst


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return True


@pytest.mark.parametrize(
    ("asked", "line"),
    [({"width_mm": 3.0}, "width = 3 mm, expected 30 to 400 mm"), ({"kind": "eps"}, "unknown format 'eps'")],
)
def test_what_cannot_be_is_one_line(boat_run, tmp_path, asked, line):
    with pytest.raises(InputError, match=line):
        figure_set(boat_run.folder, tmp_path, **asked)
