"""The columns of a table of steps, the key of a run, and a finished run."""

import re
from dataclasses import asdict, dataclass

import polars as pl

from oarlock.tables.figures import COLUMNS, DTYPES
from oarlock.tables.spool import Spool

SCHEMA = {column.name: DTYPES[column.kind] for column in COLUMNS}
"""Columns of a table of steps, as polars knows them; what does not apply is null."""


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

    How it ended ``promise.ended`` says; the message says why, unless it is ``done``.
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
