"""A case made ready for one integrator and one setting: what every path of stepping starts from."""

import mujoco
import numpy as np
import polars as pl

from oarlock.case_file import Integrator
from oarlock.cases import Case
from oarlock.drive import Drive
from oarlock.errors import InputError
from oarlock.inequalities import ignore_inequalities
from oarlock.mechanism import load_mechanism
from oarlock.metrics import Energy, largest
from oarlock.observed import Observed
from oarlock.published import PublishedValues
from oarlock.start import ConsistentStart, consistent_start
from oarlock.truth import TruthTrajectory

MAX_STEPS = 10_000_000
"""Steps of a run at most: their rows are kept in memory until it is finished."""


def _steps(duration_s: float, timestep_s: float) -> int:
    if duration_s / timestep_s > MAX_STEPS:
        raise InputError(
            f"{duration_s:g} s at a timestep of {timestep_s:g} s are {duration_s / timestep_s:.3g} steps, "
            f"expected at most {MAX_STEPS:,}"
        )
    return max(1, round(duration_s / timestep_s))


class Setup:
    """A prepared model with its drive, its consistent start, its number of steps, and the truth at each of them.

    ``ignored`` says which contacts, limits and friction were switched off, or None where none were to be. For
    ``solref_s`` see ``load_mechanism``, for ``seed`` ``consistent_start``.
    """

    def __init__(
        self,
        case: Case,
        truth: TruthTrajectory | None,
        integrator: Integrator,
        settings: str,
        timestep_s: float | None,
        duration_s: float,
        ignoring: bool = False,
        *,
        solref_s: float | None = None,
        seed: int | None = None,
    ):
        self.model = load_mechanism(
            case, integrator=integrator, timestep_s=timestep_s, settings=settings, solref_s=solref_s
        )
        ignoring = ignoring or case.file.run.ignore_inequalities
        self.ignored = ignore_inequalities(self.model) if ignoring else None
        self.drive = Drive(self.model, case)
        self.start: ConsistentStart = consistent_start(self.model, case, seed)
        self.timestep_s = float(self.model.opt.timestep)
        self.steps = _steps(duration_s, self.timestep_s)
        self.published = PublishedValues(self.model, case, own=timestep_s is None)
        if self.published.last_step == self.steps:
            self.steps += 1  # states are recorded at the start of a step, and this one belongs to the end
        self.conserves_energy = Energy(self.model).conserved
        self.truth: pl.DataFrame | None = None
        if truth is not None and case.file.truth is not None:
            known = case.file.truth
            where = f"[truth] of case '{case.name}'"
            self.observed = Observed(self.model, where, joint=known.joint, site=known.site)
            times = np.arange(self.steps) * self.timestep_s
            self._true_path = truth.position(times)
            names = ["position"] if known.joint else ["x", "y", "z"]
            self.truth = pl.DataFrame({"time_s": times, **dict(zip(names, self._true_path.T, strict=True))})

    def data(self) -> mujoco.MjData:
        """A fresh data at the start."""
        data = mujoco.MjData(self.model)
        data.qpos[:], data.qvel[:] = self.start.qpos, self.start.qvel
        return data

    def truth_error(self, step: int, data: mujoco.MjData) -> float | None:
        """Distance of the joint or site that the truth knows from where it should be at the start of a step.

        In the coordinate that is furthest off, at a state whose position stage is done.
        """
        if self.truth is None or not np.isfinite(self._true_path[step]).all():
            return None
        return largest(self.observed.position(data) - self._true_path[step])

    def truth_errors(self, steps: np.ndarray, places: np.ndarray) -> np.ndarray:
        """The same of many steps, with what was observed of each, (steps, 1 or 3); NaN where the truth is not known."""
        path = self._true_path[steps]
        errors = np.abs(places - path).max(axis=1)
        return np.where(np.isfinite(path).all(axis=1), errors, np.nan)

    def apart(self, qpos1: np.ndarray, qpos2: np.ndarray) -> float | None:
        """Largest difference of two positions in any coordinate (rad or m); None if one of them is not finite."""
        apart = np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, apart, 1.0, qpos1, qpos2)
        difference = largest(apart)
        return difference if np.isfinite(difference) else None
