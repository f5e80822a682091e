"""Iterations of the paper's method and its tracked variant along one exact trajectory, as a figure for a paper.

Run: python examples/compare_solvers.py FIGURE.pdf
"""

import sys

import altair as alt
import oarlock
import polars as pl

WIDTH_PT = 244  # 86 mm, a column of most journals: a pixel of a chart is a point of the PDF at scale 1

results = oarlock.run("boat", mode="lockstep", walker="pinv", form="hard", duration=2.0, solver=["sr1", "sr1-tracked"])
table = results.steps.select(
    pl.col("time_s").alias("time (s)"),
    (pl.col("iterations") / pl.col("solves")).alias("iterations a solve"),
    "solver",
)
means = table.group_by("solver").agg(pl.col("iterations a solve").mean().round(3)).sort("solver")
print(means)

blocks = table.group_by("solver", (pl.col("time (s)") / 0.05).floor() * 0.05, maintain_order=True).mean()
chart = (
    alt.Chart(blocks)
    .mark_line(strokeWidth=1)
    .encode(x="time (s):Q", y="iterations a solve:Q", color=alt.Color("solver:N", legend=alt.Legend(orient="top")))
    .properties(width=WIDTH_PT, height=120, autosize=alt.AutoSizeParams(type="fit", contains="padding"))
)
chart.save(sys.argv[1])
