"""What a model that nobody has described yet turns out to be: start, timestep, duration, and bounds for its figures.

Everything is computed or measured, with the reason in words beside it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from oarlock.base.errors import InputError, RefusedError
from oarlock.cases.case import Case
from oarlock.cases.case_file import Baumgarte, CaseFile, Drive, RunDefaults, Start
from oarlock.cases.conditions import Conditions
from oarlock.cases.integrators import INTEGRATORS, IntegratorName
from oarlock.mechanics.inequalities import ignore_inequalities
from oarlock.mechanics.load import load_model
from oarlock.mechanics.names import element_name
from oarlock.mechanics.prepare import integrator_of, prepare
from oarlock.stepping.paths import fitting_path
from oarlock.stepping.prepared import PreparedCase
from oarlock.stepping.projection import TRACKED
from oarlock.stepping.solvers import REFERENCE, SolverSpec
from oarlock.stepping.start import KEYFRAME, ConsistentStart, consistent_start

AS_IT_STANDS = 1e-9
"""rad or m. A start that closing moves by less counts as closed: the digits of its file."""

KEYS = 8
"""So many keyframes at most are tried as starts."""

PROBE_STEPS = 100
"""Length of the exact run that a timestep is judged by, in the model's own timesteps."""

AGREES = 1e-6
"""rad or m. Exact runs with a timestep and with half of it may differ by so much over the probe: a hundredth of what
MuJoCo's default softness opens a loop by, so that figures show the softness and not the timestep."""

HALVINGS = 5

NICE = (1.0, 2.0, 5.0)

LONGEST_S = 10.0

STEPS, STEPS_LARGE, LARGE = 2500, 250, 30
"""Steps of a run at most, and of a model with more than LARGE velocities, whose steps take milliseconds."""


@dataclass
class Survey:
    """What was found.

    Attributes:
        model: the model, compiled.
        start: what the constraints are at the start.
        origin: where the start comes from, in words.
        written: the start that a case has to give; empty where the model's own is closed as it stands.
        controls: actuator → constant control that the keyframe of the start gives.
        timestep_reason: why this timestep.
        notes: what an author should know.
    """

    model: mujoco.MjModel
    integrator: IntegratorName
    ignoring: bool
    start: ConsistentStart
    origin: str
    written: Start
    controls: dict[str, float]
    timestep_s: float = 0.0
    timestep_reason: str = ""
    duration_s: float = 0.0
    notes: list[str] = field(default_factory=list)

    @property
    def baumgarte(self) -> Baumgarte:
        """Critically damped, at a twentieth of a step's inverse: fast, and far from where a step would feel it."""
        beta = nice(0.05 / self.timestep_s)
        return Baumgarte(beta=beta, k=beta * beta)

    @property
    def own_integrator(self) -> str:
        """The one that the model asks for."""
        return integrator_of(self.model).name

    @property
    def own_timestep(self) -> bool:
        """Whether the model's own timestep is kept."""
        return self.timestep_s == float(self.model.opt.timestep)


def survey(name: str, path: Path, *, ignoring: bool) -> Survey:
    """Looks at a model.

    Args:
        name: name of the case, for messages.
        path: the MJCF file.
        ignoring: without contacts, limits and friction.

    Raises:
        RefusedError: contacts that are no constraint rows, and they are not to be ignored; a law has no value.
        InputError: the model cannot be loaded, or no start of it can be closed.
    """
    model = load_model(path)
    integrator: IntegratorName = "implicitfast" if model.na else "rk4"
    key, written, start = _best_start(name, path, model)
    found = Survey(model, integrator, ignoring, start, _origin(model, key), written, _controls(model, key))
    _choose_timestep(found, lambda timestep: _draft(name, path, found, timestep))
    found.duration_s = longest(found.timestep_s, STEPS if model.nv <= LARGE else STEPS_LARGE)
    if start.dof == 0:
        found.notes.append("0 degrees of freedom: at this start the mechanism is locked, and nothing can move")
    if model.na:
        found.notes.append(
            f"{model.na} actuator activation(s), 0 at the start: implicitfast, for rk4 takes no activations yet"
        )
    return found


def nice(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above a value."""
    decade = 10.0 ** math.floor(math.log10(value * (1 + 1e-12)))
    return float(f"{max(step for step in NICE if step * decade <= value * (1 + 1e-12)) * decade:.1g}")


def nice_above(value: float) -> float:
    """The smallest of 1, 2, 5 times a power of ten that is not below a value."""
    below = nice(value)
    if below >= value * (1 - 1e-12):
        return below
    return float(f"{below * (2.5 if f'{below:e}'[0] == '2' else 2.0):.1g}")


def longest(timestep_s: float, steps: int) -> float:
    """The duration of so many steps at most, in s."""
    return min(LONGEST_S, nice(steps * timestep_s))


# The start.


def _best_start(name: str, path: Path, model: mujoco.MjModel) -> tuple[int | None, Start, ConsistentStart]:
    """Of the model's own pose and its keyframes the one that closing moves least.

    A keyframe named ``start`` is the author's choice, and ``consistent_start`` begins with it by itself.
    """
    keys = [element_name(model, mujoco.mjtObj.mjOBJ_KEY, key) for key in range(model.nkey)]
    candidates = [keys.index(KEYFRAME)] if KEYFRAME in keys else [None, *range(min(model.nkey, KEYS))]
    best: tuple[int | None, Start, ConsistentStart] | None = None
    failure: InputError | None = None
    for key in candidates:
        implied = key is None or keys[key] == KEYFRAME
        given = Start() if implied else _by_name(model, model.key_qpos[key], model.key_qvel[key])
        case = Case(name, path, CaseFile(title=name, start=given))
        loops = prepare(load_model(path), integrator="rk4")
        ignore_inequalities(loops)
        try:
            start = consistent_start(loops, case)
        except InputError as error:
            failure = failure or error
            continue
        if best is None or start.moved < best[2].moved - AS_IT_STANDS:
            closed = given if start.moved <= AS_IT_STANDS else _by_name(model, start.qpos, start.qvel)
            best = key, closed, start
    if best is None:
        raise failure or InputError(f"{path}: no start")
    return best


def _by_name(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray) -> Start:
    """A start that gives every named joint; velocities only if something moves."""
    places: dict[str, float | list[float]] = {}
    rates: dict[str, float | list[float]] = {}
    for index in range(model.njnt):
        joint = model.joint(index)
        if joint.name:
            address, dof = int(joint.qposadr[0]), int(joint.dofadr[0])
            count, rate = {0: (7, 6), 1: (4, 3)}.get(int(model.jnt_type[index]), (1, 1))
            place, speed = qpos[address : address + count].tolist(), qvel[dof : dof + rate].tolist()
            places[joint.name] = place[0] if count == 1 else place
            if any(speed):
                rates[joint.name] = speed[0] if rate == 1 else speed
    return Start(qpos=places, qvel=rates)


def _origin(model: mujoco.MjModel, key: int | None) -> str:
    return "the model's own pose" if key is None else f"keyframe '{element_name(model, mujoco.mjtObj.mjOBJ_KEY, key)}'"


def _controls(model: mujoco.MjModel, key: int | None) -> dict[str, float]:
    if key is None:
        return {}
    values = {model.actuator(index).name: float(model.key_ctrl[key, index]) for index in range(model.nu)}
    return {actuator: value for actuator, value in values.items() if actuator and value}


# The timestep.


def _draft(name: str, path: Path, found: Survey, timestep_s: float) -> Case:
    found.timestep_s = timestep_s
    file = CaseFile(
        title=name,
        run=RunDefaults(timestep_s=timestep_s, integrator=found.integrator, ignore_inequalities=found.ignoring),
        start=found.written,
        drive=Drive(ctrl={actuator: repr(value) for actuator, value in found.controls.items()}),
        baumgarte=found.baumgarte,
    )
    return Case(name, path, file)


def _choose_timestep(found: Survey, draft: Callable[[float], Case]) -> None:
    """Halves the model's own timestep until the exact run agrees with the one at half of it."""
    own = float(found.model.opt.timestep)
    span = f"over {PROBE_STEPS * own:.3g} s"
    halving = f"halving it changes the exact {found.integrator} run by"
    halvings = HALVINGS if INTEGRATORS[found.integrator].order > 1 else 0
    changes: list[float] = []
    path = _exact_run(draft(own), PROBE_STEPS)
    for index in range(halvings + 1):
        finer = _exact_run(draft(own / 2 ** (index + 1)), PROBE_STEPS * 2 ** (index + 1))
        changes.append(_apart(found.model, path, finer[::2]))
        if changes[-1] <= AGREES:
            break
        path = finer
    if changes[-1] <= AGREES:
        found.timestep_s = own / 2 ** (len(changes) - 1)
        found.timestep_reason = f"{halving} {changes[-1]:.1e} {span}"
        if len(changes) > 1:
            found.timestep_reason += f", at the model's own {own:g} s by {changes[0]:.1e}"
        return
    found.timestep_s = own
    found.timestep_reason = f"{halving} {changes[0]:.1e} {span}"
    if halvings:
        found.notes.append(
            f"no timestep down to {own / 2**halvings:.3g} s makes exact runs agree within {AGREES:g}: look for stiff "
            "drives, singular poses, or a start from which the mechanism is thrown about"
        )
    else:
        found.notes.append(
            f"{found.integrator} is of first order: what it adds itself is as large as these {changes[0]:.1e}"
        )


def _exact_run(case: Case, steps: int) -> np.ndarray:
    """Coordinates (steps + 1, nq) of the exact free run; NaN from where it diverged.

    Raises:
        RefusedError: as ``survey``.
    """
    run = case.file.run
    conditions = Conditions(duration_s=(steps + 1) * (run.timestep_s or 0.0))  # a row is of the start of a step
    prepared = PreparedCase(case, None, run.integrator, "default", conditions)
    (table,), ending = fitting_path(prepared, Baumgarte()).free(SolverSpec(REFERENCE), "hard", TRACKED)
    if ending is not None and isinstance(ending.error, RefusedError):
        raise ending.error
    path = np.full((steps + 1, prepared.model.nq), np.nan)
    path[: len(table)] = np.array(table.frame()["qpos"].to_list()).reshape(-1, prepared.model.nq)
    return path


def _apart(model: mujoco.MjModel, path: np.ndarray, other: np.ndarray) -> float:
    """Largest difference in any coordinate; infinite where one of them diverged."""
    if not (np.isfinite(path).all() and np.isfinite(other).all()):
        return math.inf
    apart, largest = np.zeros(model.nv), 0.0
    for one, two in zip(path, other, strict=True):
        mujoco.mj_differentiatePos(model, apart, 1.0, one, two)
        largest = max(largest, float(np.abs(apart).max()))
    return largest
