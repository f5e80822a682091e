"""The native path: experiments walked by the compiled core, bit for bit as the Python path.

The core reads MuJoCo's structs, for which it has a layout of every version that it knows (``layout``).
"""

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from time import monotonic

import mujoco
import polars as pl

from oarlock.base import core
from oarlock.base.errors import InputError, RefusedError, one_line
from oarlock.cases.case_file import Baumgarte, Form
from oarlock.mechanics.newton import is_doubtful
from oarlock.stepping.ending import Ending
from oarlock.stepping.layout import disagreement, known_layout
from oarlock.stepping.path import SOLVER_BESIDE, SPOOLS, TICK_STEPS, Make, Spools, Tables, Tick, silent
from oarlock.stepping.prepared import Prepared
from oarlock.stepping.solvers import MUJOCO, SolverSpec
from oarlock.tables.columns import table_of_columns
from oarlock.tables.figures import Walk
from oarlock.tables.schema import SCHEMA
from oarlock.tables.spool import Spool

CHUNK_ROWS = 10_000
"""Rows, of all tables of a walk together, that the core holds at most before they are taken over."""


PORTION_S = 0.2
"""Time that a portion of steps should take, s: as long as an interruption may have to wait."""

_GROWTH = 8
"""Factor by which a portion may be larger than the one before it."""


def _portion(steps: int, took_s: float) -> int:
    """How many steps to take next, when so many took so long."""
    fitting = PORTION_S / max(took_s / steps, 1e-9)
    return max(1, min(int(fitting), _GROWTH * steps, TICK_STEPS))


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
            layout = known_layout()
            wrong = disagreement(layout) if layout else "mj_version"
            return f"MuJoCo {mujoco.__version__} keeps {wrong} elsewhere than oarlock's table says" if wrong else ""
    return f"no library of MuJoCo in '{folder}'"


def refusal_of(prepared: Prepared) -> str:
    """Why it cannot be taken for what is prepared; empty if it can."""
    if prepared.states is not None:
        return "a log of states is gone through on the Python path only"
    return "mocap bodies move on the Python path only" if prepared.drive.mocaps else ""


class NativePath:
    """The walks of what is prepared, as ``Path``.

    Raises:
        InputError: this process cannot step natively, or not this model.
    """

    name = "native"

    def __init__(
        self,
        prepared: Prepared,
        terms: Baumgarte,
        make: Make = SolverSpec.make,
        tick: Tick = silent,
        spools: Spools = SPOOLS,
    ):
        if refused := refusal() or refusal_of(prepared):
            raise InputError(f"no native stepping: {refused}")
        self._prepared, self._make, self._tick, self._spools = prepared, make, tick, spools
        self.core = core.Setup(
            prepared.model,
            qpos=prepared.qpos,
            qvel=prepared.qvel,
            act=prepared.act,
            laws=prepared.drive.laws,
            switches=prepared.drive.switches,
            step_s=prepared.drive.step_s,
            held=prepared.drive.held,
            beta=terms.beta,
            k=terms.k,
            observed=prepared.observed.address if prepared.observed else None,
            conserved=prepared.conserves_energy,
            inequalities=prepared.has_inequalities,
            snapshots=prepared.published.steps,
            doubted=is_doubtful(prepared.model),
        )

    def calibration(self) -> Tables:
        """As ``Path``."""
        return self._walk("calibration", self.core.calibration(self._prepared.steps))

    def lockstep(
        self, walker: SolverSpec, projector: SolverSpec | None, forms: tuple[Form, ...], solvers: tuple[SolverSpec, ...]
    ) -> Tables:
        """As ``Path``."""
        make = self._make
        questions = [(form, [make(spec) for spec in solvers]) for form in forms]
        leader = None if walker.name == MUJOCO else make(walker)
        last = make(projector) if projector else None
        run = self.core.lockstep(self._prepared.steps, questions, leader, last)
        return self._walk("lockstep", run, len(forms) * len(solvers))

    def one_step(self, forms: tuple[Form, ...], solvers: tuple[SolverSpec, ...]) -> Tables:
        """As ``Path``."""
        asked = [(form, self._make(spec)) for form in forms for spec in solvers]
        return self._walk("one-step", self.core.one_step(self._prepared.steps, asked), len(asked))

    def free(
        self,
        solver: SolverSpec,
        form: Form | None,
        projector: SolverSpec | None,
        *,
        judged: bool = True,
    ) -> Tables:
        """As ``Path``."""
        steps, make = self._prepared.steps, self._make
        if form is None:
            return self._walk("mujoco", self.core.free_mujoco(steps))
        last = make(projector) if projector else None
        beside = make(SOLVER_BESIDE) if form == "hard" else None
        run = self.core.free_solved(steps, form, make(solver), last, beside, judged)
        return self._walk("free" if judged else "alone", run)

    def _walk(self, walk: Walk, run: core.Run, count: int = 1) -> Tables:
        """Walks all steps; ``count`` is the number of those who answer."""
        tables = self._spools(count)
        rows = 0
        for taken in self._advance(run):
            rows += taken * count
            if rows >= CHUNK_ROWS:
                self._take_over(walk, run, tables)
                rows = 0
        self._take_over(walk, run, tables)
        return tables, self._ending(run)

    def _take_over(self, walk: Walk, run: core.Run, tables: list[Spool]) -> None:
        errors = self._published(run)
        for table, columns in zip(tables, run.tables(), strict=True):
            table.append(self._frame(walk, columns, errors))

    def _advance(self, run: core.Run) -> Iterator[int]:
        """Takes all steps; yields how many it took, block by block of ``TICK_STEPS``.

        A block is taken in portions that are small where steps are long, so that an interruption is seen soon. The
        clock decides the size of portions and nothing else: what is done with a block hangs on the blocks.
        """
        left, portion = self._prepared.steps, 1
        while left > 0:
            block, taken = min(TICK_STEPS, left), 0
            while taken < block:
                asked = min(portion, block - taken)
                began = monotonic()
                done = run.advance(asked)
                taken += done
                self._tick(done)
                if done < asked:
                    yield taken
                    return
                portion = _portion(asked, monotonic() - began)
            yield taken
            left -= taken

    def _ending(self, run: core.Run) -> Ending | None:
        if run.end is None:
            return None
        step, time, kind, message = run.end
        if kind == "not-finite":
            return Ending(step, time)
        return Ending(step, time, self._refusal(run, time, message) if kind == "control" else InputError(message))

    def _refusal(self, run: core.Run, time: float, message: str) -> RefusedError:
        """What the Python path would say of the state that a run was refused at: it knows the names."""
        prepared = self._prepared
        data = prepared.data()
        data.qpos[:], data.qvel[:], _ = run.state
        data.time = time
        try:
            prepared.drive.apply(data)
        except RefusedError as error:
            return error
        return RefusedError(message)

    def _published(self, run: core.Run) -> dict[int, dict[str, float]]:
        """Step → how far its state is from what is printed for it."""
        prepared, found = self._prepared, {}
        for step, qpos, qvel, multipliers in run.snapshots():
            data = prepared.data()
            data.qpos[:], data.qvel[:] = qpos, qvel
            mujoco.mj_fwdPosition(prepared.model, data)
            mujoco.mj_fwdVelocity(prepared.model, data)
            data.efc_force[: data.ne] = multipliers
            found[step] = prepared.published.errors(step, data)
        return found

    def _frame(self, walk: Walk, columns: dict[str, core.Column], errors: dict[int, dict[str, float]]) -> pl.DataFrame:
        """The table of what the core gives, and of what follows from it."""
        if not columns:
            return pl.DataFrame(schema=SCHEMA)
        step = columns["step"].values
        following: dict[str, pl.Series] = {}
        observed = columns.pop("observed", None)
        if observed is not None:
            places = observed.values.reshape(len(step), -1)
            following["truth_error"] = pl.Series(self._prepared.truth_errors(step, places), nan_to_null=True)
        for figure in sorted({figure for found in errors.values() for figure in found}):
            values = [errors.get(number, {}).get(figure) for number in step.tolist()]
            following[figure] = pl.Series(values, dtype=pl.Float64)
        return table_of_columns(walk, {**columns, **following}, len(step))
