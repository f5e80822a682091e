"""What follows from it, in words and tables: why a loop drifts, what would hold it, and which forces to trust."""

import numpy as np

from oarlock.base.numbers import figure, percent
from oarlock.diagnosis.examination import Examination
from oarlock.diagnosis.loops.layout import SINE
from oarlock.diagnosis.loops.uniqueness import Reaction
from oarlock.diagnosis.loops.wrenches import Wrench
from oarlock.diagnosis.page.blocks import Chapter
from oarlock.diagnosis.page.chapters import counted, lower, many, why_not
from oarlock.diagnosis.page.document import accelerations_table
from oarlock.diagnosis.runs.row_law import CAUSES, Share
from oarlock.diagnosis.runs.trials import Trial

CAUSE_WORDS = {
    "compliance": "softness",
    "curvature": "missing J̇v",
    "solver": "solver",
    "start": "start",
    "stepping": "time stepping",
}
"""Causes in words."""

SINE_NOTE = (
    f"The rows 'turn' of a weld are its rotations, {SINE} with its torquescale τ and the angle θ: for small angles and "
    "τ = 1 half the angle in rad."
)


# 4


def why(found: Examination) -> Chapter:
    """The drift by its causes."""
    chapter = Chapter("why", "Why")
    if found.attribution is None or not found.attribution.shares:
        chapter.say(why_not(found, "causes"))
        return chapter
    worst = found.attribution.worst
    chapter.say(
        f"'{worst.label}' is off by {figure(worst.worst)} {_share_unit(found, worst)} at t = {worst.time_s:.6g} s, of "
        f"which {percent(worst.shares[worst.leading])} is {CAUSE_WORDS[worst.leading]}."
    )
    chapter.say(
        "Every row is a damped oscillator that its own force drives: r̈ + B ṙ + K d r = −R f + m − ε. Its deviation r "
        "is the sum of the parts below, with sign; parts may exceed it and oppose one another. Softness: −R f with the "
        "force f of a solver without error. Missing J̇v: m, what MuJoCo leaves out on joint and tendon rows. Solver: "
        "what its solver left. Start: an open start. Time stepping: what the integrator did otherwise than the "
        f"oscillator, with controls held over a step. The law holds to {figure(found.attribution.defect)} here."
    )
    if any(one.kind == "weld" for one in found.attribution.recording.layout.equalities):
        chapter.say(SINE_NOTE)
    shares = found.attribution.shares
    chapter.table(
        "causes",
        ("row", "off by", "at (s)", "leading", *CAUSE_WORDS.values()),
        [
            (
                share.label,
                f"{figure(share.worst)} {_share_unit(found, share)}",
                f"{share.time_s:.6g}",
                CAUSE_WORDS[share.leading],
                *(f"{figure(share.parts[cause])} ({percent(share.shares[cause])})" for cause in CAUSES),
            )
            for share in shares
        ],
    )
    chapter.say("Over the whole run, all rows of an equality: shares that add up to 100 %, and the work it did.")
    chapter.table(
        "work",
        ("equality", *CAUSE_WORDS.values(), "root mean square", "work (J)"),
        [
            (
                share.name,
                *(percent(share.over_run[cause]) for cause in CAUSES),
                f"{figure(share.total)} {_share_unit(found, share)}",
                figure(share.work),
            )
            for share in shares
        ],
    )
    lost = float(np.abs(found.attribution.recording.energy_error).max(initial=0.0))
    chapter.say(
        f"Energy that came from nowhere, at most: {figure(lost, 'J')}. An exact loop does no work; work below 0 is "
        "energy that the loop lost."
    )
    apart = accelerations_table(found)
    if not apart.is_empty():
        chapter.say(
            "MuJoCo's acceleration less the exact one at the same states, by the same causes; all coordinates as one, "
            "in rad/s² or m/s²."
        )
        chapter.table(
            "accelerations",
            ("cause", "root mean square", "largest"),
            [
                (CAUSE_WORDS.get(row["cause"], "together"), figure(row["rms"]), figure(row["max"]))
                for row in apart.to_dicts()
            ],
        )
    return chapter


def _share_unit(found: Examination, share: Share) -> str:
    assert found.attribution is not None
    return found.attribution.recording.layout.named[share.row].measure


# 5


def remedy(found: Examination) -> Chapter:
    """What would hold the loops, in words, as MJCF and as the runs that were made."""
    chapter, recipe = Chapter("remedy", "What would hold it"), found.recipe
    if recipe is None:
        chapter.say(why_not(found, "remedy"))
        _settings(found, chapter)
        return chapter
    wanted = f"the wanted {figure(recipe.target)} m or rad"
    drifted = "diverges" if not np.isfinite(recipe.chosen.drift) else f"opens by {_drifted(recipe.chosen)}"
    said = {
        "holds": f"It holds {wanted} as it stands: it {drifted}.",
        "reached": f"It holds {wanted} with {recipe.reason}: it {drifted}, at {figure(recipe.chosen.cost)} times the "
        f"cost; as authored it opens by {_drifted(recipe.authored)}.",
        "not-reached": f"Nothing that was tried holds {wanted}: {recipe.reason}. The best of the runs {drifted}.",
    }[recipe.outcome]
    chapter.say(said)
    if recipe.verified:
        finite = [trial for trial in recipe.verified if np.isfinite(trial.drift)]
        worst = max(finite, key=lambda trial: trial.drift, default=None)
        text = f"The same settings from {counted(len(recipe.verified), 'disturbed start')}: "
        text += f"at most {_drifted(worst)}" if worst else "no run stays finite"
        chapter.say(f"{text}{'' if len(finite) == len(recipe.verified) or not finite else ', and others diverge'}.")
    if recipe.mjcf:
        chapter.say("To paste:" if recipe.reached else "The best that was found, to paste:")
        chapter.code(recipe.mjcf)
    if recipe.conserving:
        chapter.say(
            f"Where energy matters: {recipe.conserving.setting.integrator} at "
            f"{recipe.conserving.setting.timestep_s:g} s holds too, and its energy error is "
            f"{figure(recipe.conserving.energy_error, 'J')} in place of {figure(recipe.chosen.energy_error, 'J')}, at "
            f"{figure(recipe.conserving.cost)} times the cost:"
        )
        chapter.code(recipe.conserving.setting.mjcf)
    chapter.say(
        "Every run that was made. Drift: the largest deviation of any row. Cost: time of the run relative to the run "
        "as authored, measured on this machine."
    )
    chapter.table(
        "trials",
        (
            "run",
            "start",
            "timestep (s)",
            "integrator",
            "solref",
            "solimp",
            "drift",
            "expected",
            "row",
            "energy error (J)",
            "cost",
        ),
        [_trial(trial, chosen=trial == recipe.chosen) for trial in recipe.trials],
    )
    if any(trial.row.turns for trial in recipe.trials):
        chapter.say(SINE_NOTE)
    _settings(found, chapter)
    return chapter


def _drifted(trial: Trial) -> str:
    if not np.isfinite(trial.drift):
        return "everything, for it diverges"
    return f"{figure(trial.drift)} {trial.row.measure}"


def _trial(trial: Trial, *, chosen: bool) -> tuple[str, ...]:
    setting = trial.setting

    def written(values: tuple[float, ...] | None) -> str:
        return "as authored" if values is None else " ".join(f"{value:g}" for value in values)

    finite = np.isfinite(trial.drift)
    return (
        f"{trial.label}{' (chosen)' if chosen else ''}",
        trial.start,
        f"{setting.timestep_s:g}",
        setting.integrator,
        written(setting.solref),
        written(setting.solimp),
        _drifted(trial) if finite else f"diverged: {trial.end.message}",
        figure(trial.predicted),
        str(trial.row),
        figure(trial.energy_error) if finite else "–",
        f"× {figure(trial.cost)}",
    )


def _settings(found: Examination, chapter: Chapter) -> None:
    if not found.settings:
        return
    chapter.say("The settings as authored. A deviation fades where a step multiplies it by less than 1.")
    chapter.table(
        "settings",
        (
            "equality",
            "solref",
            "as MuJoCo takes it",
            "largest impedance",
            "h²Kd + 2hB",
            "a step multiplies by",
            "stable",
        ),
        [
            (
                one.name,
                " ".join(f"{value:g}" for value in one.settings.given),
                " ".join(f"{value:g}" for value in one.settings.effective) if one.settings.changed else "the same",
                f"{max(one.settings.solimp[:2]):g}",
                figure(one.number),
                figure(one.growth),
                "yes" if one.stable else "NO",
            )
            for one in found.settings
        ],
    )


# 6


def forces(found: Examination) -> Chapter:
    """What goes through the equalities, and how much of it is determined."""
    chapter = Chapter("forces", "Forces")
    if not found.given and not found.determined:
        chapter.say(f"Wrenches: {lower(why_not(found, 'forces'))}")
    else:
        chapter.say(
            "Largest values of the run. A multiplier has a part that the motion determines, on which every solver must "
            "agree, and one that does not change the motion, which only the solver decides. Exact multipliers are of "
            "the least norm."
        )
        ours = {one.equality: one for one in found.determined}
        theirs = {one.equality: one for one in found.given}
        chapter.table(
            "forces",
            ("equality", "what", "MuJoCo", "exact", "not determined, MuJoCo", "not determined, exact"),
            [row for name in dict.fromkeys([*theirs, *ours]) for row in _peaks(theirs.get(name), ours.get(name))],
        )
    if found.reactions is None:
        chapter.say(f"Which reactions are unique: {lower(why_not(found, 'reactions'))}")
        return chapter
    every = [*found.reactions.equalities, *found.reactions.together, *found.reactions.joints]
    chapter.say(f"Which reactions the motion determines, from {counted(found.reactions.poses, 'closed pose')}:")
    columns = ("of", "which", "between", "force", "torque", "in all")
    chapter.table("reactions", columns, [_reaction(one) for one in every])
    return chapter


def _peaks(given: Wrench | None, determined: Wrench | None) -> list[tuple[str, ...]]:
    some = given or determined
    assert some is not None

    def peak(wrench: Wrench | None, name: str, end: int | None, part: str, unit: str) -> str:
        if wrench is None:
            return "–"
        values = getattr(getattr(wrench, part), name)
        sizes = np.abs(values[:, end]) if end is not None else np.linalg.norm(values, axis=1)
        return figure(float(sizes.max(initial=0.0)), unit)

    wanted: list[tuple[str, str, int | None, str]] = []
    if some.total.force is not None:
        wanted.append(("|force|", "force", None, "N"))
    if some.total.torque is not None:
        wanted.append(("|torque|", "torque", None, "N m"))
    if some.total.ends is not None:
        pairs = zip(some.ends, some.units, strict=False)
        wanted += [(f"on '{name}'", "ends", end, unit) for end, (name, unit) in enumerate(pairs)]
    return [
        (
            some.equality,
            what,
            *(
                peak(wrench, name, end, part, unit)
                for part, wrench in (("total", given), ("total", determined), ("free", given), ("free", determined))
            ),
        )
        for what, name, end, unit in wanted
    ]


def _reaction(one: Reaction) -> tuple[str, ...]:
    of = {"equality": "equality", "together": "together", "joint": "joint of the tree"}[one.owner]
    directions = (str(part) if part is not None else "–" for part in (one.force, one.torque))
    return of, many(one.names), " – ".join(one.bodies) or "–", *directions, one.verdict
