"""The drift: how far every equality opens in the run, beside the exact solution."""

from oarlock.base.numbers import figure
from oarlock.base.text import quoted
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.page.blocks import Chapter, Table
from oarlock.diagnosis.page.chapters.words import lower, measured, why_not
from oarlock.diagnosis.runs.drifts import LEVELS, Drift
from oarlock.diagnosis.verdict.cost import widest

UNITS = {"position": ("m", "rad"), "velocity": ("m/s", "rad/s"), "acceleration": ("m/s²", "rad/s²")}


def drift(exam: Examination) -> Chapter:
    """How far every equality opens in the run."""
    chapter = Chapter("drift", "Drift", 3)
    if exam.recording is None:
        chapter.say(why_not(exam, "run"))
        return chapter
    worst = widest(exam)
    if worst is not None:
        chapter.say(f"MuJoCo as configured; the worst: {quoted(worst.equality)} opens by {worst.at}.")
    end = exam.recording.end
    if end.how != "finished":
        chapter.say(f"MuJoCo's run ended at t = {end.time_s:.6g} s of {exam.duration_s:g} s: {end.message}.")
    _exact(exam, chapter)
    chapter.explain(
        "Largest values of the run. Metres are the distance of the two points, radians the angle between the two "
        "orientations; of a coupling, its deviation."
    )
    rows = [
        (
            one.equality,
            one.level,
            measured(one.metres, UNITS[one.level][0]),
            measured(one.radians, UNITS[one.level][1]),
            measured(one.exact_metres, "m"),
            measured(one.exact_radians, "rad"),
            f"{one.time_s:.6g}",
        )
        for level in LEVELS
        for one in exam.drifts
        if one.level == level
    ]
    columns = ("equality", "level", "MuJoCo", "MuJoCo, angle", "exact", "exact, angle", "worst at (s)")
    chapter.table("drift", columns, rows, words=2, short=_short(exam.drifts))
    return chapter


def _short(drifts: list[Drift]) -> Table:
    """An equality in a row: its worst moment in positions, and the largest of its rates."""
    by_level = {level: {one.equality: one for one in drifts if one.level == level} for level in LEVELS}
    position, velocity, acceleration = by_level.values()
    rows = []
    for name, one in position.items():
        exact = max((value for value in (one.exact_metres, one.exact_radians) if value is not None), default=None)
        rates = [figure(level[name].largest if name in level else None) for level in (velocity, acceleration)]
        rows.append((name, figure(one.metres), figure(one.radians), f"{one.time_s:.6g}", figure(exact), *rates))
    return Table("drift", ("equality", "m", "rad", "at s", "exact", "per s", "per s²"), rows)


def _exact(exam: Examination, chapter: Chapter) -> None:
    exact = exam.exact
    if exact is None:
        chapter.say(f"The exact solution: {lower(why_not(exam, 'exact'))}")
        return
    text = f"The exact solution steps with the integrator {exact.integrator}"
    text += f" ({exact.note})" if exact.note else ""
    if len(exact.drift):
        most = exact.drift.max(axis=0)
        text += (
            f" and leaves at most {figure(most[0])} m or rad, {figure(most[1])} per s and {figure(most[2])} per s² "
            f"of any row. By its own estimate, from a walk at half the timestep, it is off by at most "
            f"{figure(exact.error.max(), 'm or rad')} to t = {exact.time[-1]:.6g} s"
        )
    if exact.end.how != "finished":
        text += f". It ends at t = {exact.end.time_s:.6g} s: {exact.end.message}"
    chapter.say(f"{text}.")
