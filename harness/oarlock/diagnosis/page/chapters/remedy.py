"""What would hold the loops, in words, as MJCF and as the runs that were made."""

import numpy as np

from oarlock.base.numbers import NOTHING, figure
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.options import TARGET
from oarlock.diagnosis.page.blocks import Chapter
from oarlock.diagnosis.page.chapters.words import counted, spelt, why_not
from oarlock.diagnosis.runs.recipe import Recipe
from oarlock.diagnosis.runs.trials import Trial


def remedy(exam: Examination) -> Chapter:
    """What would hold the loops, in words, as MJCF and as the runs that were made."""
    chapter, recipe = Chapter("remedy", "What would hold it", 5), exam.recipe
    if recipe is None:
        chapter.say(why_not(exam, "remedy"))
        _settings(exam, chapter)
        return chapter
    if exam.withheld:
        chapter.say(
            f"Settings were tried, and none is offered: beside {exam.withheld} stiffer equalities would hide what is "
            "wrong, and not mend it. Mend that, and check again."
        )
    else:
        _offered(chapter, exam, recipe)
    chapter.explain(
        "Every run that was made. Drift: the largest gap of any equality. Cost: evaluations of the model relative to "
        "the run as authored, one a step and four under Runge–Kutta."
    )
    settings = ("timestep (s)", "integrator", "solref", "solimp")
    chapter.table(
        "trials",
        ("run", "start", *settings, "drift", "expected", "equality", "energy error (J)", "cost"),
        [_trial(trial, chosen=trial == recipe.chosen) for trial in recipe.trials],
        words=3,
        short=("run", "start", "equality", "timestep (s)", "drift", "energy error (J)", "cost"),
    )
    _settings(exam, chapter)
    return chapter


def _offered(chapter: Chapter, exam: Examination, recipe: Recipe) -> None:
    """What became of the search, and the settings to paste."""
    chapter.say(_outcome(exam, recipe))
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


def _outcome(exam: Examination, recipe: Recipe) -> str:
    """What became of the search, in a sentence or two."""
    wanted = f"the wanted {figure(recipe.target)} m or rad"
    if exam.options.target is None:
        wanted += f" ({TARGET:g} of the loops' {figure(exam.size, 'm')})"
    untried = f"; {recipe.untried}" if recipe.untried else ""
    drifted = "diverges" if not np.isfinite(recipe.chosen.drift) else f"opens by {_drifted(recipe.chosen)}"
    return {
        "holds": f"It holds {wanted} as it stands: it {drifted}; {recipe.reason}{untried}.",
        "reached": f"It holds {wanted} with {recipe.reason}: it {drifted}, at {figure(recipe.chosen.cost)} times the "
        f"cost; as authored it opens by {_drifted(recipe.authored)}{untried}.",
        "not-reached": f"Nothing that was tried holds {wanted}: {recipe.reason}. The best of the runs {drifted}.",
        "undecided": f"Whether anything holds {wanted} is not decided: {recipe.reason}. The best so far {drifted}.",
    }[recipe.outcome]


def _drifted(trial: Trial) -> str:
    if not np.isfinite(trial.drift):
        return "everything, for it diverges"
    return f"{figure(trial.drift)} {trial.unit}"


def _trial(trial: Trial, *, chosen: bool) -> tuple[str, ...]:
    setting = trial.setting

    def written(values: tuple[float, ...] | None) -> str:
        return "as authored" if values is None else spelt(values)

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
        trial.equality.name,
        figure(trial.energy_error) if finite and np.isfinite(trial.energy_error) else NOTHING,
        f"× {figure(trial.cost)}" if trial.cost is not None else NOTHING,
    )


def _settings(exam: Examination, chapter: Chapter) -> None:
    if not exam.settings:
        return
    chapter.explain("The settings as authored. A deviation fades where a step multiplies it by less than 1.")
    columns = ("equality", "solref", "as MuJoCo takes it", "largest impedance", "h²Kd + 2hB", "a step multiplies by")
    chapter.table(
        "settings",
        (*columns, "stable"),
        [
            (
                one.name,
                spelt(one.settings.given),
                spelt(one.settings.effective) if one.settings.changed else "the same",
                f"{max(one.settings.solimp[:2]):g}",
                figure(one.number),
                figure(one.growth),
                "yes" if one.stable else "NO",
            )
            for one in exam.settings
        ],
    )
