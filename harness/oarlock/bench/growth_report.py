"""The page of a measured growth: figures, tables and exponents in words, a pure function of the measurement."""

from pathlib import Path
from typing import Any

import altair as alt
import polars as pl

from oarlock.base.files import write_text
from oarlock.bench.growth import MANY, PARTS, SOLVERS, STEP
from oarlock.bench.steps import BARE
from oarlock.render.charts import WIDTH, log_axis
from oarlock.render.page import Figure, page
from oarlock.render.template import render
from oarlock.tables.folder import occasion_of

NAMED = 0.05
"""Share of a step from which on the text names a part."""

TITLE = "The cost of a step against the number of loops"

_CURVES = {BARE: "#d95f02", "auto": "#1f78b4", "sr1-tracked": "#6a3d9a"}
_SHADES = {
    "stages": "#d95f02",
    "integrator": "#fdae6b",
    "rows": "#66c2a5",
    "question": "#6baed6",
    "whitening": "#2171b5",
    "matrix": "#08306b",
    "solve": "#6a3d9a",
    "force": "#b2abd2",
}
"""MuJoCo's parts in orange, the question in green and blue, the answer in violet."""


def who(name: str) -> str:
    """A contender as the page calls it."""
    return f"bare {BARE}" if name == BARE else f"exact, {name}"


def in_words(power: float | None) -> str:
    """An exponent as one says it: a power is called N or N² within 0.15 and 0.25 of it."""
    if power is None:
        return "not at all"
    bounds = {0.15: "hardly at all", 0.85: "slower than N", 1.15: "like N"}
    bounds |= {1.75: "faster than N, slower than N²", 2.25: "like N²"}
    return next((words for bound, words in bounds.items() if power <= bound), "faster than N²")


def shares(row: dict[str, Any]) -> dict[str, float]:
    """Part → its share of the sum, the largest first; of those that take time."""
    costs = {part: cost for part, cost in row["parts_us"].items() if cost > 0}
    return {part: costs[part] / sum(costs.values()) for part in sorted(costs, key=lambda part: -costs[part])}


def _loops(rows: list[dict[str, Any]]) -> alt.X:
    sizes = sorted({row["loops"] for row in rows})
    scale = alt.Scale(type="log", domain=[sizes[0] / 1.1, sizes[-1] * 1.1], nice=False)
    return alt.X("loops:Q", title="N, four-bars in the chain", scale=scale, axis=alt.Axis(values=sizes, format="d"))


def _curves(points: pl.DataFrame, x: alt.X, colours: dict[str, str], height: int) -> alt.Chart:
    """µs against N, both axes logarithmic, a curve a ``who``."""
    scale = alt.Scale(domain=list(colours), range=list(colours.values()))
    legend = alt.Legend(orient="top", columns=4)
    return (
        alt.Chart(points)
        .mark_line(point=alt.OverlayMarkDef(size=35), strokeWidth=2)
        .encode(
            x=x,
            y=log_axis(points["value"], "a step (µs)"),
            color=alt.Color("who:N", title=None, scale=scale, legend=legend),
        )
        .properties(width=WIDTH, height=height)
    )


def cost_chart(rows: list[dict[str, Any]]) -> alt.TopLevelMixin:
    """A step of every contender against N."""
    points = [{"loops": row["loops"], "value": row["step_us"], "who": who(row["name"])} for row in rows]
    frame = pl.DataFrame(points).with_columns(pl.col("value").round_sig_figs(4))
    return _curves(frame, _loops(rows), {who(name): colour for name, colour in _CURVES.items()}, 300)


def _parts(rows: list[dict[str, Any]], solver: str) -> pl.DataFrame:
    """loops, who (what is done), value (µs), share and order of every part; what takes no time is left out."""
    order = list(PARTS)
    points = [
        {
            "loops": row["loops"],
            "who": PARTS[part],
            "value": row["parts_us"][part],
            "share": share,
            "order": order.index(part),
        }
        for row in rows
        if row["name"] == solver
        for part, share in shares(row).items()
    ]
    return pl.DataFrame(points).with_columns(pl.col("value", "share").round_sig_figs(4))


def share_chart(rows: list[dict[str, Any]]) -> alt.TopLevelMixin:
    """Shares of the parts of an exact step, stacked, a bar a size and a panel a solver."""
    scale = alt.Scale(domain=list(PARTS.values()), range=[_SHADES[part] for part in PARTS])
    legend = alt.Legend(orient="top", columns=4)
    panels = [
        alt.Chart(_parts(rows, solver), title=who(solver))
        .mark_bar()
        .encode(
            x=alt.X("loops:O", title="N, four-bars in the chain", axis=alt.Axis(labelAngle=0)),
            y=alt.Y("share:Q", title="share of a step", axis=alt.Axis(format="%"), scale=alt.Scale(domain=[0, 1])),
            color=alt.Color("who:N", title=None, scale=scale, legend=legend),
            order=alt.Order("order:Q"),
        )
        .properties(width=WIDTH / 2 - 40, height=280)
        for solver in SOLVERS
    ]
    return alt.hconcat(*panels)


def part_chart(rows: list[dict[str, Any]]) -> alt.TopLevelMixin:
    """Every part of an exact step against N, a panel a solver."""
    colours = {PARTS[part]: _SHADES[part] for part in PARTS}
    panels = [
        _curves(_parts(rows, solver), _loops(rows), colours, 260).properties(title=who(solver)) for solver in SOLVERS
    ]
    return alt.vconcat(*panels)


def draw(rows: list[dict[str, Any]]) -> list[Figure]:
    """The figures of the page."""
    return [
        Figure("cost", "A step against N, both axes logarithmic: a straight line is a power of N.", cost_chart(rows)),
        Figure("shares", "Where the time of an exact step goes. Orange is MuJoCo's.", share_chart(rows)),
        Figure("parts", "The parts of an exact step against N, both axes logarithmic.", part_chart(rows)),
    ]


def write_growth_report(growth: dict[str, Any], occasion: dict[str, Any], target: Path) -> Path:
    """Writes README.md, figures/*.svg and, not to be tracked, index.html with the occasion.

    Raises:
        InputError: the target cannot be written.
    """
    rows = growth["rows"]
    sizes = sorted({row["loops"] for row in rows})
    table = {loops: {row["name"]: row for row in rows if row["loops"] == loops} for loops in sizes}
    ends = list(dict.fromkeys([sizes[0], sizes[-1]]))
    fits = {(row["name"], row["part"]): row for row in growth["exponents"]}
    drawn = draw(rows)
    text = render(
        "growth.md.j2",
        title=TITLE,
        growth=growth,
        table=table,
        fits=fits,
        sizes=ends,
        shares={(solver, loops): shares(table[loops][solver]) for solver in SOLVERS for loops in ends},
        figures={figure.name: figure for figure in drawn},
        contenders=(BARE, *SOLVERS),
        solvers=SOLVERS,
        parts=PARTS,
        bare=BARE,
        step=STEP,
        many=MANY,
        named=NAMED,
        who=who,
        in_words=in_words,
    )
    for figure in drawn:
        write_text(target / "figures" / f"{figure.name}.svg", figure.svg())
    write_text(target / "README.md", text)
    write_text(target / "index.html", page(TITLE, text, drawn, occasion_of(occasion)))
    return target
