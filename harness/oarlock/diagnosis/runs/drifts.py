"""How far each equality drifts in a run, at the level of positions, velocities and accelerations."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from oarlock.base.numbers import figure
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
        metres_s, radians_s: when each of them was, s.
        exact_metres, exact_radians: the exact solution; of positions only, None for the other levels.
    """

    equality: str
    level: str
    metres: float | None
    radians: float | None
    time_s: float
    exact_metres: float | None = None
    exact_radians: float | None = None
    metres_s: float | None = None
    radians_s: float | None = None

    @property
    def at(self) -> str:
        """Both in words, each with its own time where they are of different ones."""
        both = ((self.metres, "m", self.metres_s), (self.radians, "rad", self.radians_s))
        parts = [(figure(value, unit), time) for value, unit, time in both if value is not None]
        if len({time for _, time in parts}) > 1:
            return " and ".join(f"{said} at t = {time:.4g} s" for said, time in parts)
        return f"{' and '.join(said for said, _ in parts) or 'nothing'} at t = {self.time_s:.4g} s"

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
            one = _drift(recording.model, recording.layout, place, level, values, recording.time)
            if exact is not None and not rates and len(exact.position):
                own = exact.layout.equalities.index(equality) if equality in exact.layout.equalities else None
                if own is not None:
                    ours = _worst(recording.model, exact.layout, own, exact.position, False)
                    worst = {unit: size for unit, (size, _) in ours.items()}
                    one = replace(one, exact_metres=worst.get("m"), exact_radians=worst.get("rad"))
            found.append(one)
    return found


def drift_of(model: mujoco.MjModel, layout: Layout, place: int, position: np.ndarray, time: np.ndarray) -> Drift:
    """The drift of one equality, by its place in a layout, from the deviations of all rows (T, n) over times (T)."""
    return _drift(model, layout, place, "position", position, time)


def _drift(
    model: mujoco.MjModel, layout: Layout, place: int, level: str, values: np.ndarray, time: np.ndarray
) -> Drift:
    worst = _worst(model, layout, place, values, level != "position")
    sizes = {unit: size for unit, (size, _) in worst.items()}
    times = {unit: float(time[at]) for unit, (_, at) in worst.items()}
    larger = times[max(sizes, key=lambda unit: sizes[unit])] if sizes else 0.0
    own = sizes.get("m"), sizes.get("rad"), larger
    return Drift(layout.equalities[place].name, level, *own, metres_s=times.get("m"), radians_s=times.get("rad"))


def _worst(
    model: mujoco.MjModel, layout: Layout, place: int, values: np.ndarray, rates: bool
) -> dict[str, tuple[float, int]]:
    """Unit → the largest gap of an equality in it, and the step of that."""
    equality, own = layout.equalities[place], values[:, layout.of_equality(place)]
    if not len(own):
        return {}
    sizes = gaps(model, equality, own, rates)
    steps = {unit: int(np.nan_to_num(size).argmax()) for unit, size in sizes.items()}
    return {unit: (float(sizes[unit][at]), at) for unit, at in steps.items()}
