"""The native path: the experiments of ``experiments.py`` walked by the compiled core, bit for bit as the Python path.

The core needs MuJoCo of exactly the version that it was built against, for it reads its structs.
"""

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import polars as pl

from oarlock.base import core
from oarlock.base.errors import InputError, one_line
from oarlock.cases.case_file import Baumgarte, Form
from oarlock.mechanics.inequalities import refuse_inequalities
from oarlock.stepping.path import Make, Spools, Tables, Tick
from oarlock.stepping.setup import Setup
from oarlock.stepping.solvers import MUJOCO, RUN_REFERENCE, SolverSpec
from oarlock.tables.columns import steps_table
from oarlock.tables.spool import Spool

TICK_STEPS = 200
"""Steps between two reports of progress, and between two looks at interruptions."""

CHUNK_ROWS = 10_000
"""Rows, of all tables of a walk together, that the core holds at most before they are taken over."""


@cache
def refusal() -> str:
    """Why the native path cannot be taken in this process; empty if it can."""
    folder = Path(mujoco.__file__).parent
    for pattern in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll"):
        for path in sorted(folder.glob(pattern)):
            try:
                core.open_mujoco(str(path))
            except InputError as error:
                return one_line(error)
            return ""
    return f"no library of MuJoCo in '{folder}'"


class NativePath:
    """The experiments of one setup on the native path.

    Raises:
        InputError: the model cannot be walked natively.
    """

    name = "native"

    def __init__(self, setup: Setup, terms: Baumgarte, make: Make, tick: Tick, spools: Spools):
        self._setup, self._make, self._tick, self._spools = setup, make, tick, spools
        self.core = core.Setup(
            setup.model,
            qpos=setup.start.qpos,
            qvel=setup.start.qvel,
            laws=setup.drive.laws,
            beta=terms.beta,
            k=terms.k,
            observed=setup.observed.address if setup.truth is not None else None,
            conserved=setup.conserves_energy,
            snapshots=setup.published.steps,
        )

    def calibration(self) -> Tables:
        """As ``PythonPath``."""
        return self._walk(self.core.calibration(self._setup.steps))

    def lockstep(
        self, walker: SolverSpec, projector: SolverSpec | None, forms: tuple[Form, ...], solvers: tuple[SolverSpec, ...]
    ) -> Tables:
        """As ``PythonPath``."""
        make = self._make
        questions = [(form, make(SolverSpec(RUN_REFERENCE)), [make(spec) for spec in solvers]) for form in forms]
        leader = None if walker.name == MUJOCO else make(walker)
        last = make(projector) if projector else None
        return self._walk(self.core.lockstep(self._setup.steps, questions, leader, last), len(forms) * len(solvers))

    def one_step(self, forms: tuple[Form, ...], solvers: tuple[SolverSpec, ...]) -> Tables:
        """As ``PythonPath``."""
        asked = [(form, self._make(spec)) for form in forms for spec in solvers]
        return self._walk(self.core.one_step(self._setup.steps, asked), len(asked))

    def free(self, solver: SolverSpec, form: Form | None, projector: SolverSpec | None) -> Tables:
        """As ``PythonPath``."""
        steps, make = self._setup.steps, self._make
        if form is None:
            return self._walk(self.core.free_mujoco(steps))
        last = make(projector) if projector else None
        return self._walk(self.core.free_solved(steps, form, make(solver), make(SolverSpec(RUN_REFERENCE)), last))

    def _walk(self, run: core.Run, count: int = 1) -> Tables:
        """Walks all steps; ``count`` is the number of those who answer."""
        tables = self._spools(count)
        rows = 0
        for taken in self._advance(run):
            rows += taken * count
            if rows >= CHUNK_ROWS:
                self._take_over(run, tables)
                rows = 0
        self._take_over(run, tables)
        return tables, self._message(run)

    def _take_over(self, run: core.Run, tables: list[Spool]) -> None:
        errors = self._published(run)
        for table, columns in zip(tables, run.tables(), strict=True):
            table.append(self._frame(columns, errors))

    def _advance(self, run: core.Run) -> Iterator[int]:
        left = self._setup.steps
        while left > 0:
            asked = min(TICK_STEPS, left)
            taken = run.advance(asked)
            self._tick(taken)
            yield taken
            left -= taken
            if taken < asked:
                return

    def _message(self, run: core.Run) -> str:
        if run.end is None:
            return ""
        step, time, kind, message = run.end
        where = f"step {step}, t = {time:.6g} s"
        if kind == "not-finite":
            return f"{where}: the state is no longer finite"
        if kind in ("inequalities", "control"):
            self._refuse(run, time)
        if step == 0 or kind != "refused":
            raise InputError(message)
        return f"{where}: {one_line(message)}"

    def _refuse(self, run: core.Run, time: float) -> None:
        """Says what the Python path would say of the state that a run was refused at: it knows the names."""
        setup = self._setup
        data = setup.data()
        data.qpos[:], data.qvel[:], _ = run.state
        data.time = time
        setup.drive.apply(data)
        mujoco.mj_fwdPosition(setup.model, data)
        mujoco.mj_fwdVelocity(setup.model, data)
        refuse_inequalities(setup.model, data)

    def _published(self, run: core.Run) -> dict[int, dict[str, float]]:
        """Step → how far its state is from what is printed for it."""
        setup, found = self._setup, {}
        for step, qpos, qvel, multipliers in run.snapshots():
            data = setup.data()
            data.qpos[:], data.qvel[:] = qpos, qvel
            mujoco.mj_fwdPosition(setup.model, data)
            mujoco.mj_fwdVelocity(setup.model, data)
            data.efc_force[:] = multipliers
            found[step] = setup.published.errors(step, data)
        return found

    def _frame(self, columns: dict[str, Any], errors: dict[int, dict[str, float]]) -> pl.DataFrame:
        step = columns.get("step", np.zeros(0))
        if "observed" in columns:
            observed, lengths = columns.pop("observed")
            places = observed.reshape(len(step), lengths[0])
            columns["truth_error"] = ("nullable", self._setup.truth_errors(step, places))
        for number, figures in errors.items():
            for name, value in figures.items():
                values = columns.setdefault(name, [None] * len(step))
                for index in np.flatnonzero(step == number):
                    values[index] = value
        return steps_table(columns, len(step))
