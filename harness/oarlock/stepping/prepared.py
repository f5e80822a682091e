"""A model made ready to be walked, bare or that of a case: what every path of stepping starts from."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import polars as pl

from oarlock.base.arrays import largest
from oarlock.base.errors import InputError
from oarlock.base.numbers import figure
from oarlock.cases.case import Case
from oarlock.cases.conditions import OWN, Conditions
from oarlock.cases.integrators import IntegratorName
from oarlock.cases.truth import TruthTrajectory
from oarlock.mechanics import controls
from oarlock.mechanics.drive import Drive
from oarlock.mechanics.energy import Energy
from oarlock.mechanics.inequalities import ignore_inequalities, may_act, refuse_unsupported
from oarlock.mechanics.observed import Observed
from oarlock.mechanics.prepare import load_mechanism
from oarlock.mechanics.state_log import StateLog
from oarlock.stepping.beginning import Beginning, along_run, beginning_of_case
from oarlock.stepping.closing import CONSISTENT
from oarlock.stepping.logged import beginning_of_log, strays
from oarlock.stepping.projection import gap
from oarlock.stepping.published import PublishedValues
from oarlock.stepping.start import ConsistentStart, consistent_start

MAX_STEPS = 10_000_000
"""Steps of a run at most: their rows take a gigabyte or more of disk."""

TRUTH_ROWS = 50_000
"""Rows of the table of the truth at most: it is there to be drawn, and no figure shows more points."""


def _steps(case: Case, asked_s: float | None, timestep_s: float) -> int:
    duration_s = asked_s or case.file.run.duration_s
    if asked_s is None and timestep_s > duration_s:  # asked for, one step is enough
        raise InputError(
            f"timestep = {timestep_s:g} s is longer than the duration of {duration_s:g} s, expected at least one step"
        )
    if duration_s / timestep_s > MAX_STEPS:
        raise InputError(
            f"{duration_s:g} s at a timestep of {timestep_s:g} s are {duration_s / timestep_s:.3g} steps, "
            f"expected at most {MAX_STEPS:,}"
        )
    return max(1, round(duration_s / timestep_s))


class Prepared:
    """A model ready to be walked: what every path of stepping starts from. Walks leave it as it is.

    Attributes:
        model: what is walked.
        qpos: where a walk starts, (nq).
        qvel: its velocities there, (nv).
        act: its activations there, (na).
        drive: controls, made for this very model.
        steps: so many a walk takes.
        timestep_s: of the model.
        observed: the joint or site that an outside truth speaks of; None without one.
        published: what is printed for some of the steps.
        left: what the rows of the start leave open where they contradict one another, m or rad; 0 if it is merely open.
        conserves_energy: whether energies of a free run are worth noting.
        states: a log that takes the place of MuJoCo's own run; None: there is none.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        drive: Drive,
        qpos: np.ndarray,
        qvel: np.ndarray,
        steps: int,
        *,
        act: np.ndarray | None = None,
        observed: Observed | None = None,
        trajectory: TruthTrajectory | None = None,
        published: PublishedValues | None = None,
        states: StateLog | None = None,
    ):
        """Takes a model as it stands.

        Args:
            model: with integrator and timestep as they are to be.
            drive: made for this very model: for MuJoCo's hook a copy is another one.
            qpos: where a walk starts, (nq).
            qvel: its velocities there, (nv).
            steps: so many a walk takes.
            act: its activations there, (na); zero if left out.
            observed: the joint or site that ``trajectory`` speaks of.
            trajectory: where an outside truth says that it is.
            published: what is printed for some of the steps; nothing if left out.
            states: a log that takes the place of MuJoCo's own run.
        """
        self.states = states
        self.model, self.drive = model, drive
        self.qpos, self.qvel = qpos, qvel
        self.act = np.zeros(model.na) if act is None else act
        self.steps = steps
        self.timestep_s = float(model.opt.timestep)
        self.observed = observed
        self.published = published or PublishedValues(model, (), "")
        self.conserves_energy = self.energy().conserved
        self.has_inequalities = may_act(model)
        self._trajectory = trajectory
        self.left = self._left()

    def _left(self) -> float:
        data = self.data()
        mujoco.mj_fwdPosition(self.model, data)
        left = gap(data)
        return left if left <= CONSISTENT else 0.0

    def energy(self) -> Energy:
        """Computes energies; a mocap body that moves does work, so that none is conserved."""
        return Energy(self.model, moved=bool(self.drive.mocaps))

    def data(self, model: mujoco.MjModel | None = None) -> mujoco.MjData:
        """A fresh data at the start, of the model itself or of a copy."""
        data = mujoco.MjData(model or self.model)
        data.qpos[:], data.qvel[:], data.act[:] = self.qpos, self.qvel, self.act
        return data

    def truth_error(self, step: int, data: mujoco.MjData) -> float | None:
        """``truth_errors`` of one state whose position stage is done; None where that is not known."""
        assert self.observed is not None
        error = float(self.truth_errors(np.array([step]), self.observed.position(data)[np.newaxis])[0])
        return None if np.isnan(error) else error

    def truth_errors(self, steps: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Distance of places (steps, 1 or 3) from where they should be at those steps; NaN where that is not known.

        In the coordinate that is furthest off.
        """
        path = self._places(steps)
        errors = np.abs(places - path).max(axis=1)
        return np.where(np.isfinite(path).all(axis=1), errors, np.nan)

    def _places(self, steps: np.ndarray) -> np.ndarray:
        """Where the truth is at the start of steps, (n, 1 or 3); NaN where it is not known."""
        assert self._trajectory is not None
        return self._trajectory.position(steps * self.timestep_s)

    def apart(self, qpos1: np.ndarray, qpos2: np.ndarray) -> float | None:
        """Largest difference of two positions in any coordinate (rad or m); None if one of them is not finite."""
        apart = np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, apart, 1.0, qpos1, qpos2)
        difference = float(largest(apart))
        return difference if np.isfinite(difference) else None


class PreparedCase(Prepared):
    """A case made ready for one integrator and one setting, at its consistent start.

    Attributes:
        start: where it starts, and what the constraints are there.
        begins: where that start comes from, and the controls.
        told: the same in words, where no case says them; None of a case as it is.
        ignored: which contacts, limits and friction were switched off, in words; None where none were to be.
        truth: what the outside truth says, as a table: at every step, or of a run of more than ``TRUTH_ROWS`` steps at
            so many of them, equally spaced, first and last included. The errors of a run are taken at every step all
            the same.
    """

    def __init__(
        self,
        case: Case,
        truth: TruthTrajectory | None,
        integrator: IntegratorName,
        settings: str,
        conditions: Conditions = OWN,
        start: ConsistentStart | None = None,
        commanded: Beginning | None = None,
    ):
        """Loads the model and closes its start.

        Args:
            case: the case.
            truth: its trajectory by others, where it has one.
            integrator: which to walk with.
            settings: name of the case's settings.
            conditions: what differs from the case; at most ``MAX_STEPS`` steps long.
            start: of the same case under the same conditions, found with another integrator or other settings, on
                which it does not depend; None: to be found.
            commanded: what a controller commanded in an earlier one, which everybody is given; None: it is asked.

        Raises:
            InputError: the model or the case is wrong, or the start cannot be closed.
        """
        timestep_s = conditions.timestep_s
        model = load_mechanism(
            case, integrator=integrator, timestep_s=timestep_s, settings=settings, solref_s=conditions.solref_s
        )
        ignoring = conditions.ignore_inequalities or case.file.run.ignore_inequalities
        self.ignored = ignore_inequalities(model) if ignoring else None
        refuse_unsupported(model)
        self.begins, motion, states = beginning_of_case(model, case, conditions.motion), conditions.motion, None
        if motion.states is not None:
            states = StateLog(Path(motion.states), model)
            self.begins = beginning_of_log(states)
        self.start: ConsistentStart = start or consistent_start(model, case, conditions.seed, self.begins)
        steps = _steps(case, conditions.duration_s, float(model.opt.timestep))
        if states is not None:
            steps = min(steps, len(states)) if conditions.duration_s else len(states)
        begins = replace(self.begins, qpos=self.start.qpos, qvel=self.start.qvel)
        begins = commanded or along_run(model, begins, motion, steps)
        self.begins = replace(self.begins, laws=begins.laws, driven=begins.driven)
        drive = controls.drive(model, self.begins.laws)
        self.told = str(self.begins) if case.bare or motion.given else None
        if self.told and case.substituted and integrator == case.file.run.integrator:
            self.told += f"; {case.substituted}"
        if self.told and states is not None:
            off = strays(model, states, steps)
            self.told += f"; a step of the model from a row of the log misses the next by up to {figure(off)}"
        own = timestep_s is None
        published = PublishedValues(model, case.file.published, f"[[published]] of case '{case.name}'", own=own)
        if published.last_step == steps:
            steps += 1  # states are recorded at the start of a step, and this one belongs to the end
        known = case.file.truth if truth is not None else None
        where = f"[truth] of case '{case.name}'"
        observed = Observed(model, where, joint=known.joint, site=known.site) if known else None
        super().__init__(
            model,
            drive,
            self.start.qpos,
            self.start.qvel,
            steps,
            act=self.begins.act,
            observed=observed,
            trajectory=truth if known else None,
            published=published,
            states=states,
        )
        self.truth: pl.DataFrame | None = None
        if known:
            shown = np.linspace(0, self.steps - 1, min(self.steps, TRUTH_ROWS)).astype(int)
            names = ["position"] if known.joint else ["x", "y", "z"]
            places = dict(zip(names, self._places(shown).T, strict=True))
            self.truth = pl.DataFrame({"time_s": shown * self.timestep_s, **places})
