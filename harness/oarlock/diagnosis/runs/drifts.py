"""How far each equality drifts in a run, at the level of positions, velocities and accelerations."""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.gaps import gaps
from oarlock.diagnosis.runs.exact import ExactRun
from oarlock.diagnosis.runs.recording import Recording
from oarlock.poses.layout import Layout

LEVELS = ("position", "velocity", "acceleration")


VISIBLE = 1e-4
"""m or rad. A drift below it, beyond the target or not, is a note: MuJoCo's own softness makes as much of a light load,
and no picture shows it."""


@dataclass(frozen=True)
class Drift:
    """The largest deviation of one equality in a run, and when it was; None in a unit that it does not have.

    Attributes:
        equality: its name.
        level: ``position`` (m, rad), ``velocity`` (m/s, rad/s) or ``acceleration`` (m/s², rad/s²).
        metres, radians: MuJoCo as configured.
        time_s: when the larger of the two was, s.
        exact_metres, exact_radians: the exact solution; of positions only, None for the other levels.
    """

    equality: str
    level: str
    metres: float | None
    radians: float | None
    time_s: float
    exact_metres: float | None = None
    exact_radians: float | None = None

    @property
    def largest(self) -> float:
        """The larger of metres and radians."""
        return max(self.metres or 0.0, self.radians or 0.0)


def find_drifts(recording: Recording, exact: ExactRun | None) -> list[Drift]:
    """Three levels of every equality, in the order of the model."""
    acceleration = np.where(recording.present, recording.reached + recording.curvature, 0.0)
    levels = dict(zip(LEVELS, (recording.position, recording.velocity, acceleration), strict=True))
    found = []
    for place, equality in enumerate(recording.layout.equalities):
        for level, values in levels.items():
            rates = level != "position"
            metres, radians, at = _worst(recording.model, recording.layout, place, values, rates)
            ours = (None, None)
            if exact is not None and not rates:
                own = exact.layout.equalities.index(equality) if equality in exact.layout.equalities else None
                if own is not None and len(exact.position):
                    ours = _worst(recording.model, exact.layout, own, exact.position, False)[:2]
            time_s = float(recording.time[at]) if recording.steps else 0.0
            found.append(Drift(equality.name, level, metres, radians, time_s, *ours))
    return found


def drift_of(model: mujoco.MjModel, layout: Layout, place: int, position: np.ndarray, time: np.ndarray) -> Drift:
    """The drift of one equality, by its place in a layout, from the deviations of all rows (T, n) over times (T)."""
    metres, radians, at = _worst(model, layout, place, position, False)
    return Drift(layout.equalities[place].name, "position", metres, radians, float(time[at]))


def _worst(
    model: mujoco.MjModel, layout: Layout, place: int, values: np.ndarray, rates: bool
) -> tuple[float | None, float | None, int]:
    """Largest metres and radians of an equality, and the step of the larger one."""
    equality, own = layout.equalities[place], values[:, layout.of_equality(place)]
    if not len(own):
        return None, None, 0
    sizes = gaps(model, equality, own, rates)
    instants = {unit: int(np.nan_to_num(size).argmax()) for unit, size in sizes.items()}
    worst = {unit: float(sizes[unit][at]) for unit, at in instants.items()}
    return worst.get("m"), worst.get("rad"), instants[max(worst, key=lambda unit: worst[unit])]
