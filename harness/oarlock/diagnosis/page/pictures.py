"""Figures of an examination, as Altair charts: drift, causes, what would hold, and forces."""

from collections.abc import Iterable, Iterator

import altair as alt
import numpy as np
import polars as pl

from oarlock.base.text import one_line as plain
from oarlock.base.text import quoted
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.loops.gaps import gaps
from oarlock.diagnosis.loops.wrenches import Wrench
from oarlock.diagnosis.runs.exact import ExactRun
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.row_law import CAUSES, Attribution, Share
from oarlock.diagnosis.verdict.causes import CAUSE
from oarlock.poses.layout import Layout
from oarlock.render.charts import COLOURS, WIDTH, envelope, log_axis, sampled
from oarlock.render.page import Figure

PANELS = 6
"""Equalities that a figure has room for, the worst first; the tables have all."""

POINTS = 240
"""Points of a curve of which there are many."""

FLOOR = 1e-16
"""m or rad: below the rounding of a length of 1 m there is nothing to see."""

MUJOCO, EXACT = "MuJoCo", "exact"

CAUSE_COLOURS = {
    "compliance": "#d95f02",
    "curvature": "#7570b3",
    "solver": "#e7298a",
    "start": "#66a61e",
    "stepping": "#1f78b4",
}
_TOTAL = "drift"
_AXES = {"x": "#d95f02", "y": "#1b9e77", "z": "#1f78b4"}


def _time() -> alt.X:
    return alt.X("time:Q", title="time (s)", axis=alt.Axis(grid=False, tickCount=8, labelOverlap=True))


def _colours(colours: dict[str, str], field: str) -> alt.Color:
    scale = alt.Scale(domain=list(colours), range=list(colours.values()))
    return alt.Color(f"{field}:N", title=None, scale=scale, legend=alt.Legend(orient="top"))


def _engines(*, both: bool) -> alt.Color:
    return _colours({who: COLOURS[who] for who in (MUJOCO, EXACT)[: 1 + both]}, "who")


def _rounded(frame: pl.DataFrame, digits: int = 5) -> pl.DataFrame:
    """What is not finite becomes a gap: JSON has neither."""
    finite = pl.when(pl.col("value").is_finite()).then(pl.col("value"))
    return frame.with_columns(value=finite.round_sig_figs(digits))


# Drift.


def _gaps(run: Recording | ExactRun, model_of: Recording, place: int) -> dict[str, np.ndarray]:
    """How far an equality stands open at each step, by unit."""
    layout: Layout = run.layout
    return gaps(model_of.model, layout.equalities[place], run.position[:, layout.of_equality(place)])


def drift(exam: Examination) -> Figure | None:
    """The drift of the worst equalities over time, MuJoCo beside exact."""
    recording = exam.recording
    if recording is None or not recording.steps:
        return None
    panels = []
    with np.errstate(all="ignore"):
        every = [_gaps(recording, recording, place) for place in range(len(recording.layout.equalities))]
    order = sorted(range(len(every)), key=lambda place: -max(_largest(one) for one in every[place].values()))
    for place in order[:PANELS]:
        equality = recording.layout.equalities[place]
        exact: dict[str, np.ndarray] = {}
        if exam.exact is not None and equality in exam.exact.layout.equalities and len(exam.exact.time):
            exact = _gaps(exam.exact, recording, exam.exact.layout.equalities.index(equality))
        for unit, values in every[place].items():
            curves = {MUJOCO: envelope(recording.time, values, POINTS)}
            if unit in exact and exam.exact is not None:
                curves[EXACT] = envelope(exam.exact.time, exact[unit], POINTS)
            frame = pl.concat(curve.with_columns(who=pl.lit(who)) for who, curve in curves.items())
            frame = _rounded(frame).with_columns(pl.col("value").clip(FLOOR))
            panels.append(
                alt.Chart(frame, title=plain(equality.name))
                .mark_line(strokeWidth=1.5)
                .encode(
                    x=_time(),
                    y=log_axis(frame["value"], f"drift ({unit})"),
                    color=_engines(both=exam.exact is not None),
                    tooltip=["who:N", "time:Q", alt.Tooltip("value:Q", title=f"drift ({unit})", format=".3g")],
                )
                .properties(width=WIDTH, height=120)
            )
    if not panels:
        return None
    some = f"the {PANELS} equalities with the largest drift" if len(order) > PANELS else "every equality"
    caption = f"Drift of {some} over time: the largest in each of {POINTS} parts of the run, logarithmic."
    return Figure("drift", caption, alt.vconcat(*panels))


def _largest(values: np.ndarray) -> float:
    return float(np.nan_to_num(values).max(initial=0.0))


def ranks(exam: Examination) -> Figure | None:
    """The smallest singular value along the motion, where it comes near a singular pose."""
    history = exam.history
    if history is None or not history.events or not len(history.smallest):
        return None
    # The times of the samples are those of the longer run, as the examination took them.
    runs = [run for run in (exam.exact, exam.recording) if run is not None and len(run.time) >= len(history.smallest)]
    if not runs:
        return None
    time = runs[0].time[: len(history.smallest)]
    index = np.unique(np.linspace(0, len(time) - 1, 4 * POINTS).astype(int))
    usual = float(np.median(history.smallest)) or 1.0
    frame = pl.DataFrame({"time": time[index], "value": np.maximum(history.smallest[index] / usual, FLOOR)})
    frame = _rounded(frame)
    events = pl.DataFrame(
        [{"time": event.time_s, "value": max(event.smallest, FLOOR), "what": event.kind} for event in history.events]
    )
    y = log_axis([*frame["value"], *events["value"]], "smallest singular value")
    line = alt.Chart(frame).mark_line(strokeWidth=1.3, color=COLOURS[EXACT]).encode(x=_time(), y=y)
    marks = (
        alt.Chart(events)
        .mark_point(filled=True, size=60, color=COLOURS[MUJOCO], opacity=1)
        .encode(x=_time(), y=y, tooltip=["what:N", "time:Q", alt.Tooltip("value:Q", format=".3g")])
    )
    caption = "Smallest singular value of the rows along the motion, of its median; points: (near) singular poses."
    return Figure("rank", caption, (line + marks).properties(width=WIDTH, height=130))


# Causes.


def causes(exam: Examination) -> Figure | None:
    """Signed parts of the drift by cause, at the worst moments and over the run."""
    shares = _worst_shares(exam)
    if not shares:
        return None
    rows = [
        {"equality": plain(share.name), "cause": CAUSE[cause].title, "when": when, "value": 100.0 * part[cause]}
        for share in shares
        for when, part in (("at the worst moment", share.shares), ("over the whole run", share.over_run))
        for cause in CAUSES
    ]
    frame = _rounded(pl.DataFrame(rows))
    colours = {CAUSE[cause].title: colour for cause, colour in CAUSE_COLOURS.items()}
    panels = [
        alt.Chart(frame.filter(pl.col("when") == when), title=when)
        .mark_bar()
        .encode(
            x=alt.X("value:Q", title="part of the drift (%)"),
            y=alt.Y("equality:N", title=None, sort=None, axis=alt.Axis(labelLimit=140)),
            yOffset=alt.YOffset("cause:N", sort=list(colours)),
            color=_colours(colours, "cause"),
            tooltip=["equality:N", "cause:N", alt.Tooltip("value:Q", title="%", format=".1f")],
        )
        .properties(width=WIDTH - 100, height=max(70, 55 * len(shares)))
        for when in ("at the worst moment", "over the whole run")
    ]
    caption = (
        "Parts of the drift by cause, with sign; they add up to 100 %. Above at the worst moment of each equality's "
        "worst row, below over all its rows and the whole run."
    )
    return Figure("causes", caption, alt.vconcat(*panels))


def _worst_shares(exam: Examination) -> list[Share]:
    if exam.attribution is None:
        return []
    return sorted(exam.attribution.shares, key=lambda share: -abs(share.worst))[:PANELS]


def parts(exam: Examination) -> Figure | None:
    """The parts of the worst row's drift over time."""
    if exam.attribution is None or not exam.attribution.shares:
        return None
    attribution: Attribution = exam.attribution
    recording, share = attribution.recording, attribution.worst
    curves = {CAUSE[cause].title: attribution.position[at, :, share.row] for at, cause in enumerate(CAUSES)}
    curves[_TOTAL] = recording.position[:, share.row]
    frame = pl.concat(
        _rounded(sampled(recording.time, values, 2 * POINTS)).with_columns(who=pl.lit(who))
        for who, values in curves.items()
    )
    unit = recording.layout.named[share.row].measure
    colours = {CAUSE[cause].title: colour for cause, colour in CAUSE_COLOURS.items()} | {_TOTAL: "#888"}
    chart = (
        alt.Chart(frame, title=plain(share.label))
        .mark_line(strokeWidth=1.4)
        .encode(
            x=_time(),
            y=alt.Y("value:Q", title=f"part of the drift ({unit})", axis=alt.Axis(format=".1e")),
            color=_colours(colours, "who"),
            tooltip=["who:N", "time:Q", alt.Tooltip("value:Q", title=unit, format=".3g")],
        )
        .properties(width=WIDTH, height=200)
    )
    return Figure("parts", f"The parts of the drift of the worst row, '{plain(share.label)}', over time.", chart)


def work(exam: Examination) -> Figure | None:
    """What the equalities did on the mechanism up to each moment."""
    if exam.attribution is None or not exam.attribution.work.size:
        return None
    attribution = exam.attribution
    names = [plain(one.name) for one in attribution.recording.layout.equalities]
    most = np.argsort(-np.abs(np.nan_to_num(attribution.work)).max(axis=0), kind="stable")[:PANELS]
    frame = pl.concat(
        _rounded(sampled(attribution.recording.time, attribution.work[:, place], POINTS)).with_columns(
            equality=pl.lit(names[place])
        )
        for place in most.tolist()
    )
    scale = alt.Scale(domain=[names[place] for place in most.tolist()], scheme="dark2")
    chart = (
        alt.Chart(frame)
        .mark_line(strokeWidth=1.5)
        .encode(
            x=_time(),
            y=alt.Y("value:Q", title="work (J)"),
            color=alt.Color("equality:N", title=None, scale=scale, legend=alt.Legend(orient="top", labelLimit=160)),
            tooltip=["equality:N", "time:Q", alt.Tooltip("value:Q", title="work (J)", format=".3g")],
        )
        .properties(width=WIDTH, height=150)
    )
    return Figure("work", "Work of the equalities on the mechanism since the start; exact loops do none.", chart)


# What would hold.


def pareto(exam: Examination) -> Figure | None:
    """Drift against cost of the runs that were made, and those that no other beats in both."""
    recipe = exam.recipe
    if recipe is None:
        return None
    own = recipe.authored.start
    kinds = {"as authored": "#888888", "tried": COLOURS[EXACT], "chosen": COLOURS[MUJOCO]}
    finite = [trial for trial in recipe.trials if trial.cost is not None and trial.start == own]
    if not finite:
        return None
    rows = [
        {
            "cost": float(f"{trial.cost:.4g}"),
            "value": max(float(f"{trial.drift:.5g}"), FLOOR),
            "what": "chosen" if trial == recipe.chosen else "as authored" if trial == recipe.authored else "tried",
            "label": plain(trial.label),
            "timestep": f"{trial.setting.timestep_s:g} s",
        }
        for trial in finite
    ]
    frame = pl.DataFrame(rows)
    front = pl.DataFrame(
        [{"cost": one.cost, "value": max(one.drift, FLOOR)} for one in recipe.pareto if one.cost is not None]
    )
    y = log_axis([*frame["value"], recipe.target], "drift (m or rad)")
    ends = [0.5 * min(frame["cost"].to_list()), 2.0 * max(frame["cost"].to_list())]
    scale = alt.Scale(type="log", domain=ends, nice=False)
    axis = alt.Axis(format="~g", tickCount=6, labelOverlap=True)
    x = alt.X("cost:Q", title="cost (evaluations, as authored = 1)", scale=scale, axis=axis)
    layers: list[alt.Chart] = []
    if len(front) > 1:
        layers.append(
            alt.Chart(front)
            .mark_line(interpolate="step-after", strokeWidth=1, color="#888", strokeDash=[3, 3])
            .encode(x=x, y=y)
        )
    rule = alt.Chart(pl.DataFrame({"value": [recipe.target]})).mark_rule(strokeDash=[6, 4], color="#1b9e77")
    layers.append(rule.encode(y=y))
    layers.append(
        alt.Chart(frame)
        .mark_point(filled=True, size=90, opacity=0.9)
        .encode(
            x=x,
            y=y,
            color=_colours(kinds, "what"),
            shape=alt.Shape(
                "what:N",
                title=None,
                scale=alt.Scale(domain=list(kinds), range=["square", "circle", "diamond"]),
                legend=alt.Legend(orient="top"),
            ),
            tooltip=[
                "label:N",
                "timestep:N",
                alt.Tooltip("cost:Q", format=".3g"),
                alt.Tooltip("value:Q", title="drift", format=".3g"),
            ],
        )
    )
    caption = (
        "Drift against cost of the runs from the user's own start; dashed: those that no other beats in both; green: "
        "the wanted drift. Runs that diverged are left out."
    )
    return Figure("pareto", caption, alt.layer(*layers).properties(width=WIDTH, height=240))


# Forces.


def forces(exam: Examination) -> Iterator[Figure]:
    """The wrench through the most loaded equalities over time, in the axes of one of the bodies, a figure each."""
    theirs, ours = ({one.equality: one for one in some} for some in (exam.given, exam.determined))
    names = list(dict.fromkeys([*theirs, *ours]))
    load = {name: max(_load(one) for one in (theirs.get(name), ours.get(name)) if one is not None) for name in names}
    loaded = sorted(names, key=lambda name: -load[name])[:PANELS]
    for number, name in enumerate(name for name in names if name in loaded):
        figure = _wrench_figure(exam, number + 1, theirs.get(name), ours.get(name))
        if figure is not None:
            yield figure


def _load(wrench: Wrench) -> float:
    total = wrench.total
    some = next(part for part in (total.force, total.torque, total.ends) if part is not None)
    return _largest(np.abs(some))


def _wrench_figure(exam: Examination, number: int, given: Wrench | None, determined: Wrench | None) -> Figure | None:
    runs = [
        (who, wrench, run.time)
        for who, wrench, run in ((MUJOCO, given, exam.recording), (EXACT, determined, exam.exact))
        if wrench is not None and run is not None
    ]
    if not runs:
        return None
    some = runs[0][1]
    ends = [plain(end) for end in some.ends]
    body = 1 if len(ends) > 1 and ends[0] == "world" else 0
    axes = f" (axes of {ends[body]})" if some.frames else ""
    panels: list[alt.Chart] = []
    for name, unit in (("force", "N"), ("torque", "N m"), ("ends", some.units[0] if some.units else "")):
        if getattr(some.total, name) is None:
            continue
        for part in ("determined", "free"):
            curves = [(who, time, _vectors(wrench, name, part, body)) for who, wrench, time in runs]
            if part == "free" and max(_largest(np.abs(values)) for _, _, values in curves) <= _negligible(runs, name):
                continue
            words = {"determined": "determined", "free": "not determined by the motion"}[part]
            what = f"on {ends[0]}" if name == "ends" else name
            panels.append(_components(curves, f"{what}, {words}{axes}", unit, single=name == "ends"))
    if not panels:
        return None
    on = f"on {ends[0]}, the opposite on the other" if some.frames else "along the joint or tendon"
    between = " and ".join(ends)
    caption = f"What goes through {quoted(plain(some.equality))} between {between}: {on}. Solid: MuJoCo; dashed: exact."
    return Figure(f"forces-{number}", caption, alt.vconcat(*panels).resolve_scale(color="independent"))


def _negligible(runs: Iterable[tuple[str, Wrench, np.ndarray]], name: str) -> float:
    return 1e-9 * max(_largest(np.abs(getattr(wrench.total, name))) for _, wrench, _ in runs)


def _vectors(wrench: Wrench, name: str, part: str, body: int) -> np.ndarray:
    free, total = getattr(wrench.free, name), getattr(wrench.total, name)
    values = free if part == "free" else total - free
    return values[:, :1] if name == "ends" else wrench.in_frame(values, body)


def _components(curves: list[tuple[str, np.ndarray, np.ndarray]], title: str, unit: str, *, single: bool) -> alt.Chart:
    frames = [
        _rounded(sampled(time[: len(values)], values[:, at], POINTS), 4).with_columns(
            who=pl.lit(who), axis=pl.lit("along" if single else axis)
        )
        for who, time, values in curves
        for at, axis in enumerate(list(_AXES)[: values.shape[1]])
    ]
    who = [who for who, _, _ in curves]
    dash = alt.Scale(domain=[MUJOCO, EXACT], range=[[1, 0], [5, 4]])
    colours = {"along": COLOURS[EXACT]} if single else _AXES
    return (
        alt.Chart(pl.concat(frames), title=alt.Title(title, fontSize=12))
        .mark_line(strokeWidth=1.4, opacity=0.9)
        .encode(
            x=_time(),
            y=alt.Y("value:Q", title=unit),
            color=_colours(colours, "axis"),
            strokeDash=alt.StrokeDash("who:N", title=None, scale=dash, legend=alt.Legend(orient="top", values=who)),
            tooltip=["who:N", "axis:N", "time:Q", alt.Tooltip("value:Q", title=unit, format=".4g")],
        )
        .properties(width=WIDTH, height=120)
    )
