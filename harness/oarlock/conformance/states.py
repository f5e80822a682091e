"""The states that every engine is asked about, and the run: the same for all, seeded, closed.

The start of the case; states that ``sample`` draws, poses that close every row with velocities that the rows admit; and
the first of these poses at rest, where nothing that depends on velocities can differ.
"""

from dataclasses import asdict, dataclass
from typing import Any

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.cases.case import Case
from oarlock.cases.conditions import Conditions
from oarlock.conformance.laws import blocks, place
from oarlock.diagnosis.sampling import sample
from oarlock.engines.asking import Files, States, arrays_of, compiled, states_of, text_of
from oarlock.experiments.laboratory import Laboratory
from oarlock.experiments.opening import open_case
from oarlock.experiments.sketch import traced
from oarlock.experiments.task import Task
from oarlock.mechanics.prepare import set_integrator
from oarlock.stepping.prepared import PreparedCase
from oarlock.stepping.solvers import BESIDE, SolverSpec

SPEED = 3.0
"""Root mean square of the drawn velocities, rad/s: what grows with their square is then clear of what float32 loses."""

AT_REST = 4
"""Of so many drawn poses one is asked about at rest, too, and one beside it."""

OPEN = 1e-3
"""rad or m: how far coordinates of open states are from closed ones, as soft loops give way; of ``SPEED`` too."""

STILL = 1e-6
"""Of ``SPEED``: a mechanism that a drawn state moves by less stands still."""

TINY = 1e-300
"""Divides nothing by zero."""

RUN_S = 2.0
"""Length of the free run, s, where that of the case is not shorter."""

RECORDS = 100
"""Records of a run, roughly."""


@dataclass(frozen=True)
class Plan:
    """What is asked about a model, besides the files of the question.

    Attributes:
        name: of the case.
        nq: positions; nv: velocities.
        steps: of the run; every: steps between its records.
        timestep: s.
        moving: which states (n) move.
        mujoco_end: positions (nq) where the run of the installed MuJoCo ends.
        exact_end: the same of our exact run; None where there is none under constant controls.
        generated: whether the text of the model has rounded numbers.
        closed: so many states, the first ones, are closed; those after them are for engines whose rows may be open.
        mujoco_gap: the largest deviation of a row in that run of MuJoCo, m or rad.
        extent: of the mechanism, m, as MuJoCo has it.
    """

    name: str
    nq: int
    nv: int
    steps: int
    every: int
    timestep: float
    moving: tuple[bool, ...]
    mujoco_end: tuple[float, ...]
    exact_end: tuple[float, ...] | None
    generated: bool
    closed: int
    mujoco_gap: float
    extent: float

    @property
    def asked(self) -> list[Any]:
        """What of it the questions hold."""
        return [self.name, self.steps, self.every, self.timestep, self.generated]

    @property
    def records(self) -> int:
        """Rows of the answer to the run."""
        return self.steps // self.every

    def document(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    @classmethod
    def read(cls, document: dict[str, Any]) -> "Plan":
        """Reads what ``document`` made."""
        ends = {name: document[name] and tuple(document[name]) for name in ("mujoco_end", "exact_end")}
        return cls(**{**document, "moving": tuple(document["moving"]), **ends})


def own_model(case: Case, text: Files) -> mujoco.MjModel:
    """The model with its own settings, and step and integrator of the case."""
    model = compiled(case, text)
    set_integrator(model, case.file.run.integrator)
    if case.file.run.timestep_s is not None:
        model.opt.timestep = case.file.run.timestep_s
    return model


def prepare(asked: str, count: int, seed: int) -> tuple[Files, Plan]:
    """Draws the states of a model; returns the files that every question has, and the plan.

    Args:
        asked: what ``load_case`` takes.
        count: states to draw.
        seed: of all random numbers.

    Raises:
        InputError: the model cannot be loaded, copied or closed, or mocap bodies move.
    """
    case = open_case(asked)
    text = text_of(case)
    model = own_model(case, text)
    setup = PreparedCase(case, None, case.file.run.integrator, "default")
    if setup.drive.mocaps:
        raise InputError(f"'{case.name}': mocap bodies move, expected a model whose motion is in its states")
    data = setup.data()
    setup.drive.apply(data)
    drawn = sample(asked, count, seed, speed=SPEED)
    rest = -(-count // AT_REST)
    ctrl = _controls(model, count, seed)
    qvel = _each_at_speed(model, drawn.qpos, drawn.qvel)
    open_qpos, open_qvel = _opened(model, drawn.qpos[:rest], qvel[:rest], seed)
    states = states_of(
        model,
        np.concatenate([setup.start.qpos[None], drawn.qpos, drawn.qpos[:rest], open_qpos]),
        np.concatenate([setup.start.qvel[None], qvel, np.zeros((rest, model.nv)), open_qvel]),
        np.concatenate([data.ctrl[None], ctrl, ctrl[:rest], ctrl[:rest]]),
        np.concatenate([data.act[None], np.zeros((count + 2 * rest, model.na))]),
    )
    steps, every = _steps(case, model)
    end, gap = _mujoco_run(model, states, steps)
    plan = Plan(
        name=case.name,
        nq=int(model.nq),
        nv=int(model.nv),
        steps=steps,
        every=every,
        timestep=float(model.opt.timestep),
        moving=tuple(bool(moves) for moves in np.abs(states.qvel).max(axis=1, initial=0.0) > 0.0),
        mujoco_end=end,
        exact_end=_exact_end(case, setup, steps),
        generated=case.model_path.suffix == ".py",
        closed=1 + count + rest,
        mujoco_gap=gap,
        extent=float(model.stat.extent),
    )
    return {**text, "model.npz": arrays_of(model), "states.parquet": states.table()}, plan


def _each_at_speed(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
    """Velocities (n, nv) with each mechanism at ``SPEED`` by itself, as far as it moves.

    A screw that turns fast beside a four-bar would leave that one without motion, and its J̇v unseen.
    """
    states, found = states_of(model, qpos, qvel, np.zeros((len(qpos), model.nu))), qvel.copy()
    for block in blocks(model, states):
        speeds = np.sqrt(np.mean(qvel[:, block] ** 2, axis=1, keepdims=True))
        found[:, block] *= np.where(speeds > STILL * SPEED, SPEED / np.maximum(speeds, TINY), 1.0)
    return found


def _opened(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Poses (n, nq) beside closed ones, and velocities (n, nv) that the rows do not admit.

    What rows are asked for there hangs on their stiffness, damping and impedance, of which a closed loop shows nothing.
    """
    numbers = np.random.default_rng([seed, model.nv])
    poses = qpos.copy()
    for pose in poses:
        mujoco.mj_integratePos(model, pose, OPEN * numbers.uniform(-1.0, 1.0, model.nv), 1.0)
    return poses, qvel + OPEN * SPEED * numbers.uniform(-1.0, 1.0, qvel.shape)


def _controls(model: mujoco.MjModel, count: int, seed: int) -> np.ndarray:
    """Controls (count, nu), spread evenly over their ranges; where there is none, over −1 to 1."""
    low, high = np.where(model.actuator_ctrllimited[:, None] > 0, model.actuator_ctrlrange, [-1.0, 1.0]).T
    return np.random.default_rng([seed, model.nu]).uniform(low, high, size=(count, model.nu))


def _steps(case: Case, model: mujoco.MjModel) -> tuple[int, int]:
    """Steps of the run, and between records; the last step is recorded."""
    steps = max(1, round(min(RUN_S, case.file.run.duration_s) / float(model.opt.timestep)))
    every = next(size for size in range(max(1, steps // RECORDS), 0, -1) if steps % size == 0)
    return steps, every


def _mujoco_run(model: mujoco.MjModel, states: States, steps: int) -> tuple[tuple[float, ...], float]:
    """Where the installed MuJoCo ends after so many steps from the first state, and its loops' largest gap by then."""
    data, widest = mujoco.MjData(model), 0.0
    place(model, data, states, 0)
    for _ in range(steps):
        mujoco.mj_step(model, data)
        mujoco.mj_fwdPosition(model, data)
        widest = max(widest, float(np.abs(data.efc_pos[: data.ne]).max(initial=0.0)))
    return tuple(data.qpos.tolist()), widest


def _exact_end(case: Case, setup: PreparedCase, steps: int) -> tuple[float, ...] | None:
    """Where our exact run ends after so many steps. None where its controls would change, or it does not arrive."""
    if setup.drive.laws or setup.drive.switches:
        return None
    # A row is the state at the start of its step: that of one more step is the end.
    conditions = Conditions(duration_s=(steps + 1) * setup.timestep_s)
    task = Task("free", SolverSpec(BESIDE), ("hard",), (SolverSpec(BESIDE),), case.file.run.integrator, "default")
    try:
        results = list(Laboratory(case, conditions).run(task))
    except InputError:
        return None
    walked = results[0].steps
    return tuple(traced(walked)[-1].tolist()) if len(walked) == steps + 1 else None
