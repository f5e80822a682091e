"""The columns of a table of steps, the key of a run, and a finished run."""

import re
from dataclasses import asdict, dataclass

import polars as pl

from oarlock.tables.spool import Spool

SCHEMA: dict[str, pl.DataType | type[pl.DataType]] = {
    "step": pl.Int64,
    "time_s": pl.Float64,
    "status": pl.String,
    "solves": pl.Int64,
    "unconverged": pl.Int64,
    "iterations": pl.Int64,
    "iterations_worst": pl.Int64,
    "products": pl.Int64,
    "refreshes": pl.Int64,
    "refolds": pl.Int64,
    "residual_rel": pl.Float64,
    "solve_ns": pl.Int64,
    "rank": pl.Int64,
    "inconsistency": pl.Float64,
    "min_norm_error": pl.Float64,
    "qacc_rel_diff": pl.Float64,
    "qfrc_constraint_rel_diff": pl.Float64,
    "drift_pos": pl.Float64,
    "drift_vel": pl.Float64,
    "drift_acc": pl.Float64,
    "projection": pl.String,
    "projection_rounds": pl.Int64,
    "projection_solves": pl.Int64,
    "projection_iterations": pl.Int64,
    "projection_moved": pl.Float64,
    "energy": pl.Float64,
    "kinetic_energy": pl.Float64,
    "trajectory_diff": pl.Float64,
    "truth_error": pl.Float64,
    "published_position_error": pl.Float64,
    "published_velocity_error_rel": pl.Float64,
    "published_multiplier_error_rel": pl.Float64,
    "step_us": pl.Float64,
    "qpos": pl.List(pl.Float64),
    "residual": pl.List(pl.Float64),
    "multipliers": pl.List(pl.Float64),
}
"""Columns of a steps table; a figure that does not apply is null."""


@dataclass(frozen=True)
class RunKey:
    """Which run it is."""

    case: str
    mode: str
    walker: str
    solver: str
    form: str | None
    integrator: str
    settings: str
    stepping: str
    timestep_s: float
    steps: int
    stabilisation: str | None = None
    """None: nothing in the run is stabilised."""

    @property
    def slug(self) -> str:
        """A file name that tells the runs of a folder apart."""
        parts = [
            self.mode,
            self.form,
            f"along-{self.walker}" if self.mode == "lockstep" else None,
            self.solver,
        ]
        parts += [
            None if self.settings == "default" else self.settings,
            None if self.stabilisation == "baumgarte" else self.stabilisation,
            self.integrator,
        ]
        text = "-".join(part for part in parts if part)
        return re.sub(r"[^A-Za-z0-9.+-]+", "_", text)


@dataclass(frozen=True)
class RunResult:
    """A finished run: its key, how it ended, and its steps.

    It ended ``done``, ``diverged``, or complete but with solves that did not converge (``unconverged``) or projections
    that did not reach the constraints (``unprojected``).
    """

    key: RunKey
    status: str
    message: str
    steps: Spool

    def table(self) -> pl.LazyFrame:
        """The steps with the key in front of every row."""
        key = asdict(self.key)
        marks = [pl.lit(value, dtype=pl.String if value is None else None).alias(name) for name, value in key.items()]
        names = [name for name in SCHEMA if name not in key and name != "step"]
        return self.steps.lazy().select("step", *marks, *names)
