"""The page of a measured growth: figures, tables and verdicts in words, a pure function of the measurement."""

from pathlib import Path
from typing import Any

import altair as alt
import polars as pl

from oarlock.base.files import write_text
from oarlock.bench.errors import LEAD
from oarlock.bench.families import FAMILIES
from oarlock.bench.growth import FASTEST, MANY, OWN_PARTS, PARTS, PROFILED, SOLVERS, STEP
from oarlock.bench.memory import WALKERS
from oarlock.bench.standings import ANSWERED, LOSES, NONE, PAPER, TIE, TIES, WINS, by_size, of_family, shares, standings
from oarlock.bench.steps import BARE
from oarlock.render.charts import WIDTH
from oarlock.render.page import Figure, page
from oarlock.render.template import render
from oarlock.tables.folder import occasion_of

TITLE = "The cost of a step against the number of loops"

_COLOURS = {
    FASTEST: "#d95f02",
    "auto": "#111111",
    "dual": "#1f78b4",
    "primal": "#33a02c",
    "cholesky": "#a6cee3",
    "sr1-tracked": "#6a3d9a",
    "sr1": "#cab2d6",
    "pinv": "#b15928",
    "cg": "#fb9a99",
}
_SHADES = {
    "stages": "#d95f02",
    "integrator": "#fdae6b",
    "rows": "#66c2a5",
    "question": "#6baed6",
    "matrix": "#08306b",
    "solve": "#6a3d9a",
    "force": "#b2abd2",
}
"""MuJoCo's parts in orange, the question in green and blue, the answer in violet."""

_PANELS = 3
"""Panels of families in a row."""

WRONG = 1e-6
"""Relative error from which the page names an answer: what ``converged`` promises of accelerations."""

_TICKS = (0.3, 1, 3, 10, 30)


def _ratio_panel(rows: list[dict[str, Any]], title: str, counted: str) -> alt.LayerChart | alt.FacetChart:
    points = [
        {"count": row["count"], "value": row["ratio"], "who": row["name"]}
        for row in rows
        if row["name"] in _COLOURS and not row["left_out"]
    ]
    frame = pl.DataFrame(points).with_columns(pl.col("value").round_sig_figs(4))
    counts = sorted({row["count"] for row in rows})
    x = alt.X(
        "count:Q",
        title=counted,
        scale=alt.Scale(type="log", domain=[counts[0] / 1.2, counts[-1] * 1.2], nice=False),
        axis=alt.Axis(values=counts, format="d", grid=False),
    )
    low, high = float(frame["value"].min()), float(frame["value"].max())  # pyright: ignore[reportArgumentType]
    y = alt.Y(
        "value:Q",
        title=None,
        scale=alt.Scale(type="log", domain=[min(0.3, low / 1.1), max(3.0, high * 1.1)], nice=False),
        axis=alt.Axis(values=list(_TICKS)),
    )
    colour = alt.Color(
        "who:N",
        title=None,
        scale=alt.Scale(domain=list(_COLOURS), range=list(_COLOURS.values())),
        legend=alt.Legend(orient="top", columns=5, symbolType="stroke"),
    )
    lines = (
        alt.Chart(frame).mark_line(point=alt.OverlayMarkDef(size=25), strokeWidth=1.6).encode(x=x, y=y, color=colour)
    )
    rule = alt.Chart(pl.DataFrame({"value": [1.0]})).mark_rule(color="#888", strokeDash=[4, 3]).encode(y="value:Q")
    return alt.layer(rule, lines).properties(width=WIDTH / _PANELS - 45, height=170, title=title)


def ratio_chart(growth: dict[str, Any]) -> alt.TopLevelMixin:
    """A step of every method over one of ``mj_step``, against the size, a panel a family."""
    panels = [
        _ratio_panel(of_family(growth["rows"], family["name"]), family["name"], family["counted"])
        for family in growth["families"]
    ]
    return alt.concat(*panels, columns=_PANELS)


def share_chart(growth: dict[str, Any]) -> alt.TopLevelMixin:
    """Shares of the parts of an exact step at the largest size walked, stacked, a bar a family and a panel a solver."""
    order = list(PARTS)
    scale = alt.Scale(domain=list(PARTS.values()), range=[_SHADES[part] for part in PARTS])
    panels = []
    for solver in PROFILED:
        points = [
            {"model": row["model"], "who": PARTS[part], "share": share, "order": order.index(part)}
            for family in growth["families"]
            for row in ends(of_family(growth["rows"], family["name"]), solver)[-1:]
            for part, share in shares(row).items()
        ]
        frame = pl.DataFrame(
            points, schema={"model": pl.String, "who": pl.String, "share": pl.Float64, "order": pl.Int64}
        ).with_columns(pl.col("share").round_sig_figs(4))
        panels.append(
            alt.Chart(frame, title=f"exact, {solver}")
            .mark_bar()
            .encode(
                y=alt.Y("model:N", title=None, sort=None, axis=alt.Axis(labelLimit=220)),
                x=alt.X("share:Q", title="share of a step", axis=alt.Axis(format="%"), scale=alt.Scale(domain=[0, 1])),
                color=alt.Color("who:N", title=None, scale=scale, legend=alt.Legend(orient="top", columns=4)),
                order=alt.Order("order:Q"),
            )
            .properties(width=WIDTH - 220, height=200)
        )
    return alt.vconcat(*panels)


def ends(rows: list[dict[str, Any]], name: str) -> list[dict[str, Any]]:
    """The rows of one who walks, in the order of sizes, without those left out: of one family."""
    return [row for row in rows if row["name"] == name and not row["left_out"]]


def draw(growth: dict[str, Any]) -> list[Figure]:
    """The figures of the page."""
    return [
        Figure(
            "ratios",
            "A step over one of bare mj_step (the dashed line), against the size; all axes logarithmic.",
            ratio_chart(growth),
        ),
        Figure(
            "shares",
            "Where the time of an exact step goes, at the largest size that was walked. Orange is MuJoCo's.",
            share_chart(growth),
        ),
    ]


def cost(row: dict[str, Any]) -> str:
    """A cell of the table of costs: ratios to default and to fastest, and how many solves did not converge."""
    if row["left_out"]:
        return "–"
    said = f"{row['ratio']:.2f} / {row['ratio_to_fastest']:.2f}"
    return said + (f" ({100 * row['unconverged']:.3g} % unconverged)" if row["unconverged"] else "")


def error(row: dict[str, Any] | None, figure: str) -> str:
    """A cell of a table of errors, with what the method said of it where that is not ``converged``."""
    if row is None:
        return "–"
    said = "not finite" if row[figure] is None else f"{row[figure]:.0e}"
    if row["rank"] not in (None, row["true_rank"]):
        said += f", rank {row['rank']}"
    return said + ("" if row["status"] == "converged" else f", {row['status']}")


def error_table(rows: list[dict[str, Any]]) -> list[tuple[dict[str, Any], dict[str, dict[str, Any]]]]:
    """A model and state each, with its rows by method."""
    keys = dict.fromkeys((row["model"], row["state"]) for row in rows)
    groups = [[row for row in rows if (row["model"], row["state"]) == key] for key in keys]
    return [(own[0], {row["name"]: row for row in own}) for own in groups]


def memory_table(rows: list[dict[str, Any]]) -> list[tuple[dict[str, Any], dict[str, dict[str, Any]]]]:
    """A family each, one of its rows and all by who walks."""
    families = dict.fromkeys(row["family"] for row in rows)
    groups = [[row for row in rows if row["family"] == family] for family in families]
    return [(own[0], {row["name"]: row for row in own}) for own in groups]


def refusals(rows: list[dict[str, Any]]) -> list[tuple[str, str, dict[str, list[str]]]]:
    """Each family and model at which methods are left out, with why → which."""
    found: dict[tuple[str, str], dict[str, list[str]]] = {}
    for row in rows:
        if row["left_out"]:
            key = row["family"], row["model"]
            found.setdefault(key, {}).setdefault(row["left_out"], []).append(row["name"])
    return [(*key, why) for key, why in found.items()]


def silent_errors(rows: list[dict[str, Any]], figure: str) -> list[dict[str, Any]]:
    """The rows of errors above ``WRONG`` of methods that said ``converged``, and no wrong rank."""
    own = [row for row in rows if row["status"] == "converged" and row["rank"] in (None, row["true_rank"])]
    return [row for row in own if row[figure] is None or row[figure] > WRONG]


def write_growth_report(growth: dict[str, Any], occasion: dict[str, Any], target: Path) -> Path:
    """Writes README.md, figures/*.svg and, not to be tracked, index.html with the occasion.

    Raises:
        InputError: the target cannot be written.
    """
    rows = growth["rows"]
    named = {family["name"]: of_family(rows, family["name"]) for family in growth["families"]}
    symbols = {family.name: family.symbol for family in FAMILIES}
    drawn = draw(growth)
    text = render(
        "growth.md.j2",
        title=TITLE,
        growth=growth,
        named=named,
        symbols=symbols,
        tables={name: by_size(own) for name, own in named.items()},
        standings={name: standings(own) for name, own in named.items()},
        fits={(row["family"], row["name"], row["part"]): row for row in growth["exponents"]},
        figures={figure.name: figure for figure in drawn},
        refusals=refusals(rows),
        errors=error_table(growth["errors"]),
        wrong=WRONG,
        wrong_ones={what: silent_errors(growth["errors"], what) for what in ("acceleration", "multipliers")},
        memory=memory_table(growth["memory"]),
        ends=ends,
        shares=shares,
        cost=cost,
        error=error,
        solvers=SOLVERS,
        profiled=PROFILED,
        parts=PARTS,
        own_parts=OWN_PARTS,
        bare=BARE,
        fastest=FASTEST,
        step=STEP,
        many=MANY,
        lead=LEAD,
        paper=PAPER,
        tie=TIE,
        answered=ANSWERED,
        walkers=WALKERS,
        verdicts=(WINS, TIES, LOSES),
        silent=NONE,
    )
    for figure in drawn:
        write_text(target / "figures" / f"{figure.name}.svg", figure.svg())
    write_text(target / "README.md", text)
    write_text(target / "index.html", page(TITLE, text, drawn, occasion_of(occasion)))
    return target
