"""A case made ready for one integrator and one setting: what every path of stepping starts from."""

import mujoco
import numpy as np
import polars as pl

from oarlock.base.arrays import largest
from oarlock.base.errors import InputError
from oarlock.cases.case import Case
from oarlock.cases.case_file import Integrator
from oarlock.cases.truth import TruthTrajectory
from oarlock.mechanics.drive import Drive
from oarlock.mechanics.energy import Energy
from oarlock.mechanics.inequalities import ignore_inequalities
from oarlock.mechanics.observed import Observed
from oarlock.mechanics.prepare import load_mechanism
from oarlock.stepping.published import PublishedValues
from oarlock.stepping.start import ConsistentStart, consistent_start

MAX_STEPS = 10_000_000
"""Steps of a run at most: their rows take a gigabyte or more of disk."""

TRUTH_ROWS = 50_000
"""Rows of the table of the truth at most: it is there to be drawn, and no figure shows more points."""

_NOWHERE = np.zeros(0)


def _steps(duration_s: float, timestep_s: float) -> int:
    if duration_s / timestep_s > MAX_STEPS:
        raise InputError(
            f"{duration_s:g} s at a timestep of {timestep_s:g} s are {duration_s / timestep_s:.3g} steps, "
            f"expected at most {MAX_STEPS:,}"
        )
    return max(1, round(duration_s / timestep_s))


class Setup:
    """A prepared model with its drive, its consistent start, its number of steps, and what the truth says of them.

    ``truth`` is that as a table: at every step, or of a run of more than ``TRUTH_ROWS`` steps at so many of them,
    equally spaced, first and last included. The errors of a run are taken at every step all the same.

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
            self._trajectory = truth
            shown = np.linspace(0, self.steps - 1, min(self.steps, TRUTH_ROWS)).astype(int)
            names = ["position"] if known.joint else ["x", "y", "z"]
            places = dict(zip(names, self._places(shown).T, strict=True))
            self.truth = pl.DataFrame({"time_s": shown * self.timestep_s, **places})

    def data(self, model: mujoco.MjModel | None = None) -> mujoco.MjData:
        """A fresh data at the start, of the model itself or of a copy."""
        data = mujoco.MjData(model or self.model)
        data.qpos[:], data.qvel[:] = self.start.qpos, self.start.qvel
        return data

    def place(self, data: mujoco.MjData) -> np.ndarray:
        """Where the joint or site is that the truth knows, (1 or 3), at a state whose position stage is done.

        Empty without a truth.
        """
        return _NOWHERE if self.truth is None else self.observed.position(data)

    def truth_errors(self, steps: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Distance of places (steps, 1 or 3) from where they should be at those steps; NaN where that is not known.

        In the coordinate that is furthest off.
        """
        path = self._places(steps)
        errors = np.abs(places - path).max(axis=1)
        return np.where(np.isfinite(path).all(axis=1), errors, np.nan)

    def _places(self, steps: np.ndarray) -> np.ndarray:
        """Where the truth is at the start of steps, (n, 1 or 3); NaN where it is not known."""
        return self._trajectory.position(steps * self.timestep_s)

    def apart(self, qpos1: np.ndarray, qpos2: np.ndarray) -> float | None:
        """Largest difference of two positions in any coordinate (rad or m); None if one of them is not finite."""
        apart = np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, apart, 1.0, qpos1, qpos2)
        difference = float(largest(apart))
        return difference if np.isfinite(difference) else None
