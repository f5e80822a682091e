"""What runs of a fix do, in words."""

import math

from oarlock.base.text import quoted
from oarlock.diagnosis.runs.drifts import VISIBLE
from oarlock.diagnosis.runs.overrun import Overrun
from oarlock.diagnosis.runs.trials import Trial

OTHER = 0.02
"""Of an overrun of a limit: a change that makes less of a difference is not told."""


def drifts(trial: Trial) -> str:
    """How far a run opens."""
    return f"{trial.drift:.2g} {trial.unit}" if math.isfinite(trial.drift) else "diverged"


def opens(trial: Trial) -> str:
    """What opens, and how far."""
    if not math.isfinite(trial.drift):
        return f"the run diverges: {trial.end.message}"
    return f"{quoted(trial.equality.name)} opens by {drifts(trial)}"


def overrun(without: Trial, with_it: Trial) -> tuple[Overrun, Overrun] | None:
    """The limit that a change lets be overrun otherwise than before, before and after; None where there is none.

    Of several it is the one that differs most.
    """
    if not (math.isfinite(without.drift) and math.isfinite(with_it.drift)):
        return None
    before, after = ({one.limit: one for one in trial.overruns} for trial in (without, with_it))
    every = [
        (before.get(limit) or Overrun(limit, 0.0, one.unit), after.get(limit) or Overrun(limit, 0.0, one.unit))
        for limit, one in {**before, **after}.items()
    ]
    was, now = max(every, key=lambda pair: abs(pair[1].by - pair[0].by), default=(None, None))
    if was is None or now is None or max(was.by, now.by) < VISIBLE:
        return None
    return (was, now) if abs(now.by - was.by) > OTHER * max(was.by, now.by) else None


def overruns(without: Trial, with_it: Trial) -> str:
    """The same as a part of a line; empty where there is none."""
    found = overrun(without, with_it)
    if found is None:
        return ""
    was, now = found
    return f"the {now.limit} is overrun by {now.by:.2g} {now.unit} in place of {was.by:.2g} {was.unit}"
