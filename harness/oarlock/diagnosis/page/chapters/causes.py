"""Why: the drift by its causes."""

import numpy as np

from oarlock.base.errors import few
from oarlock.base.numbers import NOTHING, figure, percent
from oarlock.base.text import quoted
from oarlock.diagnosis.examination import starved
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.page.blocks import Chapter, Table
from oarlock.diagnosis.page.chapters.words import SINE_NOTE, why_not
from oarlock.diagnosis.page.document import accelerations_table
from oarlock.diagnosis.runs.row_law import Share
from oarlock.diagnosis.runs.solving import Solving
from oarlock.diagnosis.runs.versions import OLDER, without_curvature
from oarlock.diagnosis.verdict.blame import amount, beyond_repair, measured_shares
from oarlock.diagnosis.verdict.causes import CAUSE

ROUNDING = 1e-9
"""Of the whole: a smaller part is rounding and not worth a line on a terminal."""

_TITLES = tuple(cause.title for cause in CAUSE.values())


def causes(exam: Examination) -> Chapter:
    """The drift by its causes."""
    chapter = Chapter("why", "Why", 4)
    if exam.attribution is None or not exam.attribution.shares:
        chapter.say(why_not(exam, "causes"))
        return chapter
    worst, shares = exam.attribution.worst, exam.attribution.shares
    lost = beyond_repair(exam)
    why = ""
    if worst.name not in lost:
        most = max(CAUSE, key=measured_shares(exam, worst).__getitem__)
        by = "by the row law" if most == worst.leading else "by a run without its other causes"
        why = f", {by} mostly for {CAUSE[most].phrase}"
    chapter.say(
        f"{quoted(worst.name)} opens by {amount(exam, worst)} at t = {worst.time_s:.6g} s; its row '{worst.label}' is "
        f"off by {_amount(exam, worst)}{why}."
    )
    if any(share.name in lost for share in shares):
        chapter.say("Of what cannot close, or comes apart, no parts are told: none of them is what keeps it open.")
    starving = sorted(starved(exam))
    if starving:
        chapter.say(
            f"With {Solving.of(exam.model).enough} most of it is gone of {few([quoted(name) for name in starving])}: "
            "MuJoCo's solver stops early, and its motion and its forces are then apart, which the row law takes for "
            "time stepping."
        )
    chapter.explain(
        "Every row is a damped oscillator that its own force drives: r̈ + B ṙ + K d r = −R f + m − ε. Its deviation r "
        "is the sum of the parts below, with sign; parts may exceed it and oppose one another. Softness: −R f with the "
        "force f of a solver without error. Missing J̇v: m, what MuJoCo leaves out on joint and tendon rows. Solver: "
        "what its solver left. Start: an open start. Time stepping: what the integrator did otherwise than the "
        f"oscillator, with controls held over a step. The law holds to {figure(exam.attribution.defect)} here."
    )
    if any(one.kind.turns for one in exam.attribution.recording.layout.equalities):
        chapter.explain(SINE_NOTE)
    chapter.table(
        "causes",
        ("row", "off by", "at (s)", "leading", *_TITLES),
        [
            (
                share.label,
                _amount(exam, share),
                f"{share.time_s:.6g}",
                CAUSE[share.leading].title,
                *(
                    f"{figure(share.parts[cause])}{'' if told == NOTHING else f' ({told})'}"
                    for cause, told in zip(CAUSE, _told(exam, share), strict=True)
                ),
            )
            for share in shares
        ],
        short=_short(exam, shares),
    )
    chapter.explain("Over the whole run, all rows of an equality: shares that add up to 100 %, and the work it did.")
    chapter.table(
        "work",
        ("equality", *_TITLES, "root mean square", "work (J)"),
        [
            (
                share.name,
                *(percent(share.over_run[cause]) for cause in CAUSE),
                f"{figure(share.total)} {_unit(exam, share)}",
                figure(share.work),
            )
            for share in shares
        ],
    )
    lost = float(np.abs(exam.attribution.recording.energy_error).max(initial=0.0))
    chapter.explain(
        f"Energy that came from nowhere, at most: {figure(lost, 'J')}. An exact loop does no work; work below 0 is "
        "energy that the loop lost."
    )
    _older(exam, chapter)
    _accelerations(exam, chapter)
    return chapter


def _older(exam: Examination, chapter: Chapter) -> None:
    """What versions that leave J̇v out of connects and welds would make of it, where it is much more."""
    recording = exam.recording
    if recording is None or recording.end.how == "diverged" or not exam.closed:
        return
    response = np.abs(without_curvature(recording))
    if not response.any():
        return
    step, row = np.unravel_index(int(response.argmax()), response.shape)
    peak, now = float(response[step, row]), float(np.abs(recording.position[:, row]).max())
    if peak > max(exam.target, OLDER * now):
        chapter.explain(
            f"Versions of MuJoCo before 3.7, which leave J̇v out of connects and welds (MJX may still), would let "
            f"'{recording.layout.labels[row]}' drift by about {figure(peak)} {recording.layout.named[row].measure} "
            "more."
        )


def _told(exam: Examination, share: Share) -> tuple[str, ...]:
    """The parts of an equality, as its finding has them; dashes of one that no cause keeps open."""
    if share.name in beyond_repair(exam):
        return (NOTHING,) * len(CAUSE)
    every = measured_shares(exam, share)
    return tuple(percent(every[cause]) for cause in CAUSE)


def _short(exam: Examination, shares: list[Share]) -> Table:
    """An equality in a row: its worst row by cause, and its work over the run."""
    rows = [
        (
            share.name,
            _amount(exam, share),
            f"{share.time_s:.6g}",
            *_told(exam, share),
            figure(share.work),
        )
        for share in shares
    ]
    return Table("causes", ("equality", "worst row", "at s", *_TITLES, "work J"), rows)


def _accelerations(exam: Examination, chapter: Chapter) -> None:
    apart = accelerations_table(exam)
    if apart.is_empty():
        return
    chapter.say(
        "MuJoCo's acceleration less the exact one at the same states, by the same causes; all coordinates as one, "
        "in rad/s² or m/s²."
    )
    head, whole = ("cause", "root mean square", "largest"), apart["rms"][-1]
    rows = [
        (CAUSE[row["cause"]].title if row["cause"] in CAUSE else "together", figure(row["rms"]), figure(row["max"]))
        for row in apart.to_dicts()
    ]
    told = [row for row, rms in zip(rows, apart["rms"], strict=True) if not rms <= ROUNDING * whole]
    chapter.table("accelerations", head, rows, short=Table("accelerations", head, told or rows))


def _unit(exam: Examination, share: Share) -> str:
    assert exam.attribution is not None
    return exam.attribution.recording.layout.named[share.row].measure


def _amount(exam: Examination, share: Share) -> str:
    return f"{figure(share.worst)} {_unit(exam, share)}"
