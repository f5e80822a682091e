"""What stays open for good behind an open start: the deviation that is left when the start's own has faded."""

import copy
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from oarlock.diagnosis.loops.gaps import Opening, opening
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.diagnosis.runs.row_law import CAUSES, Attribution

PARTS = 4
"""Of a run; the last of them is looked at."""

FADED = 0.1
"""Of what is open there: the start's own part is below it, or the start has not faded."""

TORQUESCALE = 5.0
"""Times the torquescale of a weld: tried where its angle is what stays open."""

HELPS = 0.5
"""Of a lasting deviation: a change that leaves less is a remedy."""

_TORQUESCALE, _OFFSET = 10, 0
"""Places in ``eq_data``."""


@dataclass(frozen=True)
class Lasting:
    """One equality that was open at the start, and stays open.

    Attributes:
        equality: its name.
        left: how far it stays open, as a median over the last part of the run.
        cause: the largest part of that, of ``CAUSES``; share: its part.
        attribute: of the equality in MJCF, and value, that was tried out; empty if none was, or none helped.
        after: how far it then stays open.
    """

    equality: str
    left: Opening
    cause: str
    share: float
    attribute: str = ""
    value: str = ""
    after: Opening | None = None


def find_lasting(
    attribution: Attribution,
    open_at_start: set[str],
    least: float,
) -> list[Lasting]:
    """Looks at the equalities that were open at the start.

    Args:
        attribution: of MuJoCo's run from there.
        open_at_start: names of those equalities.
        least: deviations below it are not worth a word, m or rad.
    """
    recording, found = attribution.recording, []
    window = slice(recording.steps - max(1, recording.steps // PARTS), None)
    for place, equality in enumerate(recording.layout.equalities):
        if equality.name not in open_at_start:
            continue
        rows = recording.layout.of_equality(place)
        median = np.median(recording.position[window, rows], axis=0)
        left = opening(recording.model, equality, median)
        parts = np.median(attribution.position[:, window, rows], axis=1)
        size = float(median @ median)
        if left.largest <= least or not size:
            continue
        shares = parts @ median / size
        start = CAUSES.index("start")
        if abs(shares[start]) > FADED:
            continue
        shares[start] = -np.inf
        leading = int(shares.argmax())
        one = Lasting(equality.name, left, CAUSES[leading], min(1.0, float(shares[leading])))
        found.append(_tried(one, recording, place, median, recording.position[0, rows]))
    return found


def _tried(
    one: Lasting,
    recording: Recording,
    place: int,
    median: np.ndarray,
    start: np.ndarray,
) -> Lasting:
    """With the attribute that takes most of it away, if there is one: it is tried.

    An offset is the one that closes the start as it is given. What stays open by much less than the start is what a
    load takes, and an offset against that would hold under this load alone.
    """
    equality = recording.layout.equalities[place]
    model = copy.deepcopy(recording.model)
    data = model.eq_data[equality.index]
    last: np.ndarray | None = None
    if equality.kind.turns and (one.left.radians or 0.0) >= (one.left.metres or 0.0):
        data[_TORQUESCALE] *= TORQUESCALE
        attribute, value = "torquescale", f"{data[_TORQUESCALE]:g}"
        last = _lasting(recording, model, place)
    elif not equality.kind.joins_points:
        if np.abs(median[0]) < FADED * np.abs(start[0]):
            return one
        data[_OFFSET] += start[0]
        last = _lasting(recording, model, place)
        attribute, value = "polycoef", " ".join(f"{number:.6g}" for number in data[:5])
    else:
        return one
    if last is None:
        return one
    after = opening(model, equality, last)
    if not after.largest < HELPS * one.left.largest:
        return one
    return replace(one, attribute=attribute, value=value, after=after)


def _lasting(recording: Recording, model: mujoco.MjModel, place: int) -> np.ndarray | None:
    """Median rows of an equality over the last part of the same run of a changed model; None if it does not last."""
    again = rerun(recording, model)
    if again is None:
        return None
    rows = recording.layout.of_equality(place)
    return np.median(again.position[-max(1, recording.steps // PARTS) :, rows], axis=0)
