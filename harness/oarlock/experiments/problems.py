"""The problems A λ = b of a run, as arrays: sequences of singular positive semidefinite systems for other solvers.

At every step of a run on exact constraints, or of MuJoCo's own, what a solver is asked and what the right answer is.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
import polars as pl

from oarlock.base import core
from oarlock.base.arguments import require_number
from oarlock.base.cores import one_thread
from oarlock.base.errors import InputError, choose
from oarlock.base.files import replacing
from oarlock.cases.case_file import Baumgarte, Form
from oarlock.cases.conditions import Conditions
from oarlock.cases.motion import RULE, Motion
from oarlock.experiments.opening import open_case
from oarlock.mechanics.engine_version import full_mass
from oarlock.mechanics.fatal import mujoco_ends_in_a_line
from oarlock.mechanics.given import Model, path_of
from oarlock.mechanics.prepare import unsolved
from oarlock.stepping.moving import Moving
from oarlock.stepping.prepared import PreparedCase
from oarlock.stepping.projection import TRACKED, Projector
from oarlock.stepping.question import Question, SolvedForce
from oarlock.stepping.solvers import MUJOCO, REFERENCE, SolverSpec
from oarlock.stepping.state import State
from oarlock.stepping.walkers import ForcedWalker, MujocoWalker, walk
from oarlock.tables.provenance import versions

BYTES = 2**31
"""Of all arrays together, at most."""

ENDINGS = (".npz", ".parquet")
"""Of the files that problems may be written to."""

COLUMNS = {
    "time": "time of the step, s",
    "rows": "number of rows n",
    "rank": "rank of A, by the reference's rank cut",
    "A": "J M⁻¹ Jᵀ, and R on its diagonal in the matched form, (n, n)",
    "b": "aref − J a₀, (n)",
    "J": "Jacobian of the equality rows, (n, nv)",
    "M": "mass matrix, (nv, nv)",
    "a0": "accelerations a₀ without the rows' forces, (nv), rad/s² or m/s²",
    "aref": "accelerations asked of the rows, (n)",
    "R": "softness of the rows, (n); zero in the hard form",
    "multipliers": "multipliers of the least norm, (n), by singular values or eigenvalues of this step alone",
    "null_space": "orthonormal basis of the null space of A, (n, n − rank)",
    "qpos": "positions, (nq)",
    "qvel": "velocities, (nv)",
    "ctrl": "controls, (nu)",
}
"""Name of an array → what it has of a step."""


@dataclass(frozen=True)
class Problems:
    """The problems of a run.

    Attributes:
        model: its name.
        form: ``hard`` or ``matched``.
        walker: who walked: a solver, or ``mujoco``.
        steps: of each, the arrays of ``COLUMNS``.
        ended: what ended the run before its last step; empty if nothing did.
    """

    model: str
    form: Form
    walker: str
    steps: list[dict[str, np.ndarray]] = field(repr=False)
    ended: str = ""

    def __len__(self) -> int:
        return len(self.steps)

    @property
    def largest(self) -> int:
        """Most rows of any."""
        return max(int(step["rows"]) for step in self.steps)

    def frame(self) -> pl.DataFrame:
        """A row a step; matrices are lists of their entries, row by row."""
        columns = {
            name: [step[name].ravel().tolist() if step[name].ndim else step[name].item() for step in self.steps]
            for name in COLUMNS
        }
        numbers = {"time": pl.Float64, "rows": pl.Int64, "rank": pl.Int64}
        return pl.DataFrame(columns, schema={name: numbers.get(name, pl.List(pl.Float64)) for name in COLUMNS})

    def save(self, path: str | Path) -> Path:
        """Writes them as ``.npz`` or ``.parquet``.

        In an NPZ file an array of the same shape at every step is stacked, (steps, …); one whose shape changes is there
        flat, all steps one after another, and ``NAME_start`` (steps + 1) says where each begins.

        Raises:
            InputError: another ending, or the file cannot be written.
        """
        target = Path(path)
        require_ending(target)
        head = {
            "model": self.model,
            "form": self.form,
            "walker": self.walker,
            "ended": self.ended,
            "columns": COLUMNS,
            "versions": versions(),
        }
        with replacing(target, named=True) as temporary:
            if target.suffix == ".parquet":
                self.frame().write_parquet(temporary, metadata={"oarlock": json.dumps(head, ensure_ascii=False)})
            else:
                with temporary.open("wb") as stream:
                    np.savez_compressed(stream, allow_pickle=False, **self._arrays(), head=np.array(json.dumps(head)))
        return target

    def _arrays(self) -> dict[str, np.ndarray]:
        found: dict[str, np.ndarray] = {}
        for name in COLUMNS:
            values = [step[name] for step in self.steps]
            if len({value.shape for value in values}) <= 1:
                found[name] = np.array(values)
            else:
                found[name] = np.concatenate([value.ravel() for value in values])
                found[f"{name}_start"] = np.concatenate([[0], np.cumsum([value.size for value in values])])
        return found


def export_problems(
    model: Model,
    *,
    form: Form = "hard",
    walker: str = "auto",
    duration: float | None = None,
    timestep: float | None = None,
    every: int = 1,
    motion: Motion = RULE,
) -> Problems:
    """Collects the problems A λ = b of a run: what a solver is asked at its steps, and the answer of the least norm.

    Args:
        model: as of ``oarlock.run``.
        form: ``hard``: exact constraints, in which A is singular where rows are redundant; ``matched``: MuJoCo's own.
        walker: a solver, whose exact run is projected after every step; or ``mujoco``.
        duration: of the run, s; the case's own if left out.
        timestep: s; the case's own if left out.
        every: takes each so many-th step.
        motion: where it starts and what drives it.

    Raises:
        InputError: bad input, a run that ends before its first step, or more than ``BYTES``.
    """
    choose("form", form, ["hard", "matched"])
    require_number("duration", duration, unit="s", positive=True)
    require_number("timestep", timestep, unit="s", positive=True)
    if every < 1:
        raise InputError(f"every = {every}, expected a whole number ≥ 1")
    leader = SolverSpec.parse(walker)
    with one_thread(), mujoco_ends_in_a_line():
        case = open_case(path_of(model))
        prepared = PreparedCase(
            case, None, case.file.run.integrator, "default", Conditions(timestep, duration, motion=motion)
        )
        steps, ended = _collected(prepared, form, leader, case.file.rank_cut, every)
        return Problems(case.name, form, walker, steps, ended)


def _collected(
    prepared: PreparedCase, form: Form, leader: SolverSpec, rank_cut: float | None, every: int
) -> tuple[list[dict[str, np.ndarray]], str]:
    by_mujoco = leader.name == MUJOCO
    own = prepared.model if by_mujoco else unsolved(prepared.model, prepared.timestep_s)
    data, moving = prepared.data(own), Moving.of(own, prepared.drive)
    reference = SolverSpec(REFERENCE).with_defaults(rank_cut=rank_cut).make()
    state = State(own, data, Baumgarte(), moving)
    if by_mujoco:
        walker = MujocoWalker(own, data, prepared.drive)
    else:
        force = SolvedForce(
            State(own, data, Baumgarte(), moving), "hard", leader.with_defaults(rank_cut=rank_cut).make()
        )
        last = Projector(own, rank_cut, TRACKED, left=prepared.left, moving=moving)
        walker = ForcedWalker(own, data, prepared.drive, force, last, moving, follows=True)
    question, found, taken, ended = Question(state, form), [], 0, ""
    with prepared.drive.installed(), np.errstate(over="ignore", invalid="ignore"):
        try:
            for step in walk(walker, prepared.steps):
                if step % every == 0 and data.ne:  # without rows there is no problem
                    state.read()
                    found.append(_problem(own, state, question, form, reference))
                    taken += sum(array.nbytes for array in found[-1].values())
                    if taken > BYTES:
                        break
        except InputError as error:
            if not found:
                raise
            ended = f"the run ends at t = {data.time:.6g} s: {error}"
    if taken > BYTES:
        raise InputError(
            f"more than {BYTES} bytes after {len(found)} of {-(-prepared.steps // every)} problems, "
            "expected a shorter run (--duration), or fewer of its steps (--every)"
        )
    if not found:
        raise InputError("the run ends before its first step, expected one that begins")
    return found, ended


def _problem(
    model: mujoco.MjModel, state: State, question: Question, form: Form, reference: core.MultiplierSolver
) -> dict[str, np.ndarray]:
    data = state.data
    aref, softness = state.question(form)
    question.ask()
    matrix, rhs = question.system.matrix, question.system.rhs
    multipliers, info = question.solve(reference)
    rank = len(rhs) if info.rank is None else info.rank
    # Eigenvalues rise: the first ones are those of the null space.
    null = np.linalg.eigh(matrix)[1][:, : len(rhs) - rank] if len(rhs) else np.zeros((0, 0))
    return {
        "time": np.array(data.time),
        "rows": np.array(len(rhs)),
        "rank": np.array(rank),
        "A": np.array(matrix),
        "b": np.array(rhs),
        "J": state.jacobian.copy(),
        "M": full_mass(model, data),
        "a0": question.unconstrained.copy(),
        "aref": np.array(aref),
        "R": np.zeros(len(rhs)) if softness is None else np.array(softness),
        "multipliers": multipliers,
        "null_space": null,
        "qpos": data.qpos.copy(),
        "qvel": data.qvel.copy(),
        "ctrl": data.ctrl.copy(),
    }


def require_ending(target: Path) -> None:
    """Refuses a file that problems cannot be written to."""
    if target.suffix not in ENDINGS:
        raise InputError(f"'{target}', expected a file whose name ends in {' or '.join(ENDINGS)}")
