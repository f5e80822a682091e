"""The page of a matrix: Markdown, HTML and a heat map, a pure function of its document."""

import json
import math
from pathlib import Path
from typing import Any

import altair as alt
import polars as pl

from oarlock.base.files import write_text
from oarlock.base.text import json_visible
from oarlock.conformance.badge import badge
from oarlock.conformance.causes import FAILED, NEARLY, READER
from oarlock.conformance.precision import MARGIN, SETTLED
from oarlock.conformance.states import RUN_S, SPEED
from oarlock.conformance.versions import changes
from oarlock.render.folder import require_report, write_whole
from oarlock.render.page import Figure, drawable, page
from oarlock.render.template import render
from oarlock.tables.folder import OCCASION, occasion_of

TITLE = "Does the loop mean the same elsewhere?"

CONTENTS = ("README.md", "badge.svg", "figures", "index.html", "matrix.json")

COLUMNS = {
    "qacc_mujoco": "Δq̈ to MuJoCo",
    "qacc_exact": "to exact",
    "qacc_rest": "at rest",
    "force_mujoco": "ΔJᵀλ to MuJoCo",
    "drift_max": "largest gap",
    "drift_end": "at the end",
}
"""Figure of a row → its heading in tables."""

GREY = "#d0d0d0"
"""Colour of what no difference was measured of."""

FLOOR = 1e-16
"""Where the colours begin: rounding."""

_SHORT = {
    "agrees": "agrees",
    "exact": "exact",
    "jdotv": "no J̇v",
    "rows": "rows lost",
    "cone": "cone",
    "mass": "mass",
    "compiled": "compiled",
    "float32": "f32",
    "history": "history",
    "residue": "nearly",
    "reader": "kept",
}
"""Cause → what stands in a cell."""


def cell(cause: str) -> str:
    """What stands in a cell of the heat map for a cause."""
    parts = cause.split("+")
    if parts[0] == READER:  # an engine that computes nothing: what it lost
        parts = parts[1:] or parts
    return ", ".join(_SHORT.get(part, part) for part in parts)


def heat_map(document: dict[str, Any]) -> Figure:
    """Models × engines: the difference as colour, the verdict as text."""
    cells = [
        {
            "model": row["model"],
            "engine": row["engine"],
            "value": math.log10(max(row["difference"], FLOOR)) if row["difference"] is not None else None,
            "cause": cell(row["cause"]),
        }
        for row in document["rows"]
    ]
    cells += [{**failure, "value": None, "cause": FAILED} for failure in document["failures"]]
    keys = ("model", "engine", "value", "cause")
    frame = pl.DataFrame(
        [{key: one[key] for key in keys} for one in cells],
        schema={"model": pl.String, "engine": pl.String, "value": pl.Float64, "cause": pl.String},
    )
    engines = list(dict.fromkeys(one["engine"] for one in cells))
    models = list(dict.fromkeys(one["model"] for one in cells))
    base = alt.Chart(frame).encode(
        x=alt.X("engine:N", sort=engines, title=None, axis=alt.Axis(orient="top", labelAngle=-30)),
        y=alt.Y("model:N", sort=models, title=None),
    )
    shade = alt.Scale(domain=[-16.0, 0.0], range=["#f7fbff", "#08519c"], clamp=True)
    legend = alt.Legend(title="log₁₀ of Δq̈ to the nearer", orient="bottom", gradientLength=240)
    compared = alt.condition("datum.value !== null", alt.Color("value:Q", scale=shade, legend=legend), alt.value(GREY))
    squares = base.mark_rect(stroke="white").encode(color=compared)
    dark = alt.condition("datum.value !== null && datum.value > -6", alt.value("white"), alt.value("#222"))
    words = base.mark_text(fontSize=10).encode(text="cause:N", color=dark)
    chart = (squares + words).properties(width=max(96 * len(engines), 96), height=max(26 * len(models), 26))
    caption = (
        "Worst relative difference of accelerations to the nearer of MuJoCo and the exact solution, and its cause; "
        "white is rounding, grey what was not compared."
    )
    return Figure("matrix", caption, chart)


def write_page(document: dict[str, Any], target: Path) -> Path:
    """Writes README.md, figures/matrix.svg, badge.svg, matrix.json and index.html into a folder.

    Args:
        document: of the matrix.
        target: a new folder, or an old page of this kind.

    Raises:
        InputError: the folder cannot be written, or is not such a page.
    """
    require_report(target, CONTENTS)
    drawn = drawable([heat_map(document)]) if document["rows"] or document["failures"] else []
    text = _text(document, drawn)

    def write(new: Path) -> None:
        for figure in drawn:
            write_text(new / "figures" / f"{figure.name}.svg", figure.svg())
        write_text(new / "README.md", text)
        write_text(new / "matrix.json", _tracked(document))
        write_text(new / "badge.svg", badge(document))
        write_text(new / "index.html", page(TITLE, text, drawn, occasion_of(document["provenance"])))

    return write_whole(target, write)


def _tracked(document: dict[str, Any]) -> str:
    """The document as JSON, without what differs from one occasion to the next."""
    provenance = {name: value for name, value in document["provenance"].items() if name not in OCCASION}
    kept = {**document, "provenance": provenance}
    rows = [json.dumps(row, ensure_ascii=False, allow_nan=False) for row in kept.pop("rows")]
    head = json.dumps(kept, indent=1, ensure_ascii=False, allow_nan=False).removesuffix("\n}")
    return json_visible(head + ',\n "rows": [\n' + ",\n".join(rows) + "\n ]\n}") + "\n"


def _text(document: dict[str, Any], drawn: list[Figure]) -> str:
    versions: dict[str, dict[str, str]] = {}
    for row in document["rows"]:
        versions.setdefault(row["engine"], row["versions"])
    mujocos = [row for row in document["rows"] if row["engine"].startswith("mujoco@")]
    return render(
        "conform.md.j2",
        title=TITLE,
        document=document,
        figures=drawn,
        columns=COLUMNS,
        versions=versions,
        changes=changes(mujocos) if len({row["engine"] for row in mujocos}) > 1 else [],
        speed=SPEED,
        run_s=RUN_S,
        margin=MARGIN,
        settled=SETTLED,
        nearly=NEARLY,
    )
