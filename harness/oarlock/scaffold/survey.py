"""What a model that nobody has described yet turns out to be: start, timestep, duration, and bounds for its figures.

Everything is computed or measured, with the reason in words beside it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np

from oarlock.base.errors import RefusedError
from oarlock.cases.case import Case
from oarlock.cases.case_file import Baumgarte, CaseFile, RunDefaults, Start
from oarlock.cases.conditions import Conditions
from oarlock.cases.drive import Drive, MocapPart
from oarlock.cases.integrators import INTEGRATORS, IntegratorName
from oarlock.cases.motion import NO_KEYFRAME, RULE, Motion
from oarlock.mechanics import controls
from oarlock.mechanics.controls import Laws
from oarlock.mechanics.drive import ACTIVE
from oarlock.mechanics.inequalities import ignore_inequalities
from oarlock.mechanics.load import load_model
from oarlock.mechanics.mocap import require_part
from oarlock.mechanics.names import element_name
from oarlock.mechanics.prepare import integrator_of, prepare
from oarlock.poses.nearest import driven_joints, nearest_kept
from oarlock.stepping.beginning import KEYFRAME, Beginning, beginning_of_case, beginning_of_file, own_integrator
from oarlock.stepping.closing import CONSISTENT, require_rows
from oarlock.stepping.paths import fitting_path
from oarlock.stepping.prepared import PreparedCase
from oarlock.stepping.projection import TRACKED
from oarlock.stepping.solvers import REFERENCE, SolverSpec
from oarlock.stepping.start import ConsistentStart, consistent_start

AS_IT_STANDS = 1e-9
"""rad or m. A start that closing moves by less counts as closed: the digits of its file."""

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
        controls: the controls; driven: the same in words.
        timestep_reason: why this timestep.
        notes: what an author should know.
    """

    model: mujoco.MjModel
    integrator: IntegratorName
    ignoring: bool
    start: ConsistentStart
    origin: str
    written: Start
    controls: Laws
    driven: str
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
    def drive(self) -> Drive:
        """The controls as a case has them."""
        return _drive(self.model, self.controls, self.held)

    @property
    def held(self) -> bool:
        """Whether a case has to say that controls are held over a step."""
        return self.controls.held and not self.controls.constant

    @property
    def own_timestep(self) -> bool:
        """Whether the model's own timestep is kept."""
        return self.timestep_s == float(self.model.opt.timestep)


def survey(name: str, path: Path, *, ignoring: bool, asked: Motion = RULE) -> Survey:
    """Looks at a model.

    Args:
        name: name of the case, for messages.
        path: the MJCF file.
        ignoring: without contacts, limits and friction.
        asked: where it starts and what drives it, in place of what ``stepping.beginning`` says.

    Raises:
        RefusedError: contacts that are no constraint rows, and they are not to be ignored; a law has no value.
        InputError: the model cannot be loaded, or no start of it can be closed.
    """
    model = load_model(path)
    integrator, substituted = own_integrator(model)
    begins = beginning_of_file(model, asked)
    written, start = _start(name, path, begins, model)
    found = Survey(model, integrator, ignoring, start, begins.begins, written, begins.laws, begins.driven)
    _choose_timestep(found, lambda timestep: _draft(name, path, found, timestep))
    found.duration_s = longest(found.timestep_s, STEPS if model.nv <= LARGE else STEPS_LARGE)
    if start.dof == 0:
        found.notes.append("0 degrees of freedom: at this start the mechanism is locked, and nothing can move")
    if substituted:
        found.notes.append(substituted)
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


def _drive(model: mujoco.MjModel, laws: Laws, held: bool) -> Drive:
    """Such laws as a case has them."""
    ctrl: dict[str, str] = {}
    active: dict[str, str] = {}
    mocap: dict[str, dict[MocapPart, str]] = {}
    actuators = controls.actuators(model)
    for name, law in laws.items():
        if name in actuators:
            ctrl[name] = law
        elif name.startswith(ACTIVE):
            active[name.removeprefix(ACTIVE)] = law
        else:
            body, part = require_part(model, name)
            mocap.setdefault(body, {})[part] = law
    return Drive(ctrl=ctrl, active=active, mocap=mocap, held=held and bool(ctrl))


# The start.


def _start(name: str, path: Path, begins: Beginning, model: mujoco.MjModel) -> tuple[Start, ConsistentStart]:
    """The start that a case has to give, and what it is once it is closed."""
    keys = [element_name(model, mujoco.mjtObj.mjOBJ_KEY, key) for key in range(model.nkey)]
    given = keys[begins.key] if begins.key is not None else NO_KEYFRAME if KEYFRAME in keys else None
    drive = _drive(model, begins.laws, begins.laws.held)
    case = Case(name, path, CaseFile(title=name, start=Start(keyframe=given), drive=drive))
    loops = prepare(load_model(path), integrator="rk4")
    ignore_inequalities(loops)
    own = beginning_of_case(loops, case)
    start = consistent_start(loops, case, begins=replace(own, qpos=_nearest(model, begins)))
    moved = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, moved, 1.0, own.qpos, start.qpos)
    start = replace(start, moved=float(np.abs(moved).max()))
    if start.moved <= AS_IT_STANDS:
        return case.file.start, start
    return _by_name(model, given, start.qpos, start.qvel), start


def _nearest(model: mujoco.MjModel, begins: Beginning) -> np.ndarray:
    """The closed pose (nq) nearest to a start, with driven joints held and ranges kept where they can be.

    Where there is none, or nothing is open, the start itself.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = begins.qpos
    controls.drive(model, begins.laws).apply(data)
    require_rows(model, data)
    found, _ = nearest_kept(model, begins.qpos, data, held=driven_joints(model), tolerance=CONSISTENT)
    return begins.qpos if found is None else found.qpos


def _by_name(model: mujoco.MjModel, keyframe: str | None, qpos: np.ndarray, qvel: np.ndarray) -> Start:
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
    return Start(keyframe=keyframe, qpos=places, qvel=rates)


# The timestep.


def _draft(name: str, path: Path, found: Survey, timestep_s: float) -> Case:
    found.timestep_s = timestep_s
    file = CaseFile(
        title=name,
        run=RunDefaults(timestep_s=timestep_s, integrator=found.integrator, ignore_inequalities=found.ignoring),
        start=found.written,
        drive=found.drive,
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
    if math.isinf(changes[0]):
        found.timestep_reason = f"the exact {found.integrator} run does not get through {span[5:]}"
        found.notes.append(f"{found.timestep_reason}: look for an actuator or a spring that it makes unstable")
    elif halvings:
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
