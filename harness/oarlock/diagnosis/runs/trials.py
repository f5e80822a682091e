"""Runs of MuJoCo with other settings: how far the loops open, what the energy does, and what it costs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from hashlib import blake2b

import mujoco
import numpy as np

from oarlock.base.numbers import exact
from oarlock.cases.integrators import INTEGRATORS
from oarlock.diagnosis.loops.gaps import gaps
from oarlock.diagnosis.runs.overrun import Overrun, Overruns
from oarlock.diagnosis.runs.solving import Solving
from oarlock.diagnosis.runs.walking import End, diverged, energy_error, other_power, own_copy, walk
from oarlock.mechanics.controls import drive
from oarlock.mechanics.flexes import without_flexes
from oarlock.mechanics.inequalities import IGNORED
from oarlock.mechanics.load import collected_warnings
from oarlock.mechanics.names import Equality, equalities
from oarlock.mechanics.prepare import integrator_of, set_integrator
from oarlock.poses.layout import Layout, RowColumns
from oarlock.stepping.closing import CONSISTENT, close
from oarlock.stepping.projection import Projector, gap
from oarlock.stepping.solvers import REFERENCE, SolverSpec

DISTURBANCES = (0.05, 0.01)
"""Deviations of what disturbs a start, rad or m, and per s; the smaller one where the larger cannot be closed."""

_BLOCK = 1024

TICKS = 64
"""Steps between two looks at the clock: one may take as long as three steps, where it is a call of the system."""


@dataclass(frozen=True)
class Setting:
    """A timestep and an integrator, with one solref and solimp for every equality, or the model's own.

    Attributes:
        integrator: by its name.
        solref, solimp: None: as authored.
        solving: solver, iterations and tolerance; None: as authored.
    """

    timestep_s: float
    integrator: str
    solref: tuple[float, float] | None = None
    solimp: tuple[float, float, float, float, float] | None = None
    solving: Solving | None = None

    @classmethod
    def authored(cls, model: mujoco.MjModel) -> "Setting":
        """What the model has."""
        return cls(float(model.opt.timestep), integrator_of(model).name)

    @property
    def evaluations(self) -> int:
        """Of the model in a step."""
        return INTEGRATORS[self.integrator].stages

    def steps(self, duration_s: float) -> int:
        """Steps of a run of that duration."""
        return max(1, round(duration_s / self.timestep_s))

    def apply(self, model: mujoco.MjModel) -> None:
        """Sets it, in place; equalities of flexes keep their own."""
        model.opt.timestep = self.timestep_s
        set_integrator(model, self.integrator)
        ours = [equality.index for equality in equalities(model) if equality.kind.known]
        if self.solref is not None:
            model.eq_solref[ours] = self.solref
        if self.solimp is not None:
            model.eq_solimp[ours] = self.solimp
        if self.solving is not None:
            self.solving.apply(model)

    def option_attributes(self) -> dict[str, str]:
        """Attributes of ``<option>``."""
        given = {"timestep": exact(self.timestep_s), "integrator": INTEGRATORS[self.integrator].mjcf}
        return given | (self.solving.attributes() if self.solving is not None else {})

    def equality_attributes(self) -> dict[str, str]:
        """Attributes of every equality; none where they stay as authored."""
        given = {"solref": self.solref, "solimp": self.solimp}
        return {name: " ".join(map(exact, values)) for name, values in given.items() if values is not None}

    @property
    def mjcf(self) -> str:
        """The settings as MJCF, to paste."""
        lines = [_element("option", self.option_attributes())]
        if attributes := self.equality_attributes():
            lines.append(f"<default>{_element('equality', attributes)}</default>")
            lines.append("<!-- an equality with a class, solref or solimp of its own needs these attributes itself -->")
        return "\n".join(lines)


def _element(tag: str, attributes: dict[str, str]) -> str:
    written = " ".join(f'{name}="{value}"' for name, value in attributes.items())
    return f"<{tag} {written}/>"


@dataclass(frozen=True)
class Start:
    """Where a run starts, with its loops closed: qpos (nq), qvel (nv), act (na; zero if None); a name for tables."""

    qpos: np.ndarray
    qvel: np.ndarray
    act: np.ndarray | None = None
    name: str = "own"


@dataclass(frozen=True)
class Trial:
    """What one run gave.

    Attributes:
        label: what the setting is, in a word or two.
        start: name of the start.
        drift: largest gap of any equality over the run, m or rad, as of ``gaps``; infinite if it diverged.
        equality: whose it is; unit: of it; time_s: when.
        opening: largest gap of any equality at the start, m or rad.
        energy_error: largest energy that came from nowhere, J, as ``Recording.energy_error``; kinetic_energy: the
            largest, J.
        steps: of the run, had it stayed finite; taken: those that it took.
        cost: evaluations of the model relative to the run as authored; None of a run that diverged.
        predicted: the drift that was expected, where one was.
        overruns: ranges of joints and tendons that were left.
    """

    label: str
    setting: Setting
    start: str
    drift: float
    equality: Equality
    unit: str
    time_s: float
    opening: float
    energy_error: float
    kinetic_energy: float
    steps: int
    taken: int
    end: End
    cost: float | None = None
    predicted: float | None = None
    overruns: tuple[Overrun, ...] = ()

    @property
    def evaluations(self) -> int:
        """Of the model, over all steps: what the run costs, whatever machine it is made on."""
        return self.steps * self.setting.evaluations

    def against(self, authored: "Trial") -> "Trial":
        """With its cost relative to another trial's."""
        finished = self.end.how == "finished"
        return replace(self, cost=self.evaluations / authored.evaluations if finished else None)


class Made:
    """Runs that were made: one that is asked for again is not made again."""

    def __init__(self):
        self._made: dict[tuple[object, ...], Trial] = {}

    def run(
        self,
        model: mujoco.MjModel,
        setting: Setting,
        start: Start,
        laws: dict[str, str],
        duration_s: float,
        label: str,
        predicted: float | None = None,
        tick: Callable[[], None] | None = None,
    ) -> Trial:
        """As ``run_trial``; what decides about a run is compared bit for bit, all of the model included."""
        buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, buffer)
        state = tuple(None if part is None else part.tobytes() for part in (start.qpos, start.qvel, start.act))
        key = (blake2b(buffer.tobytes()).digest(), setting, state, tuple(laws.items()), duration_s)
        if key not in self._made:
            self._made[key] = run_trial(model, setting, start, laws, duration_s, label, predicted, tick)
        return replace(self._made[key], label=label, start=start.name, predicted=predicted, cost=None)


def run_trial(
    model: mujoco.MjModel,
    setting: Setting,
    start: Start,
    laws: dict[str, str],
    duration_s: float,
    label: str,
    predicted: float | None = None,
    tick: Callable[[], None] | None = None,
) -> Trial:
    """Runs MuJoCo with a setting, and keeps the figures only.

    Args:
        model: the user's; it is left alone.
        setting: for the run.
        start: where it starts.
        laws: as of ``recording.record``.
        duration_s: how long.
        label: for the trial.
        predicted: the drift that is expected.
        tick: called every ``TICKS`` steps; what it raises ends the run.
    """
    own = own_copy(model)
    setting.apply(own)
    steps = setting.steps(duration_s)
    data = _data(own, start)
    layout = Layout.of(own, data.eq_active)
    driven = drive(own, laws)
    columns, block = RowColumns(layout), np.zeros((_BLOCK, layout.rows))
    energy, power = np.zeros((steps, 2)), np.zeros(steps)
    worst, overruns, taken = _Worst(own, layout), Overruns(own), 0
    with np.errstate(all="ignore"), collected_warnings():
        for step in walk(own, data, driven, steps):
            if tick is not None and step % TICKS == 0:
                tick()
            energy[step], power[step] = data.energy, other_power(data, layout.skipped)
            slot = step % _BLOCK
            if data.ne == layout.rows and not layout.skipped:
                block[slot] = data.efc_pos[: layout.rows]
            else:
                block[slot] = 0.0
                block[slot, columns.of(data)] = data.efc_pos[columns.rows(data)]
            overruns.see(data)
            taken = step + 1
            if slot == _BLOCK - 1:
                worst.see(block)
        worst.see(block[: taken % _BLOCK])
    finished = taken == steps
    errors = energy_error(energy[:taken], power[:taken], setting.timestep_s)
    return Trial(
        label=label,
        setting=setting,
        start=start.name,
        drift=worst.size if finished else float("inf"),
        equality=worst.equality,
        unit=worst.unit,
        time_s=worst.step * setting.timestep_s,
        opening=worst.opening,
        energy_error=float("nan") if driven.mocaps else float(np.abs(errors).max(initial=0.0)),
        kinetic_energy=float(energy[:taken, 1].max(initial=0.0)),
        steps=steps,
        taken=taken,
        end=End("finished", float(data.time)) if finished else diverged(own, data),
        predicted=predicted,
        overruns=overruns.found if finished else (),
    )


def _data(model: mujoco.MjModel, start: Start) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = start.qpos, start.qvel
    if start.act is not None:
        data.act[:] = start.act
    return data


class _Worst:
    """The largest gap of a run, whose rows come block by block."""

    def __init__(self, model: mujoco.MjModel, layout: Layout):
        self._model, self._layout, self._seen = model, layout, 0
        self.size, self.step, self.opening = 0.0, 0, 0.0
        self.equality = layout.equalities[0]
        self.unit = "m" if self.equality.kind.joins_points else self.equality.unit

    def see(self, block: np.ndarray) -> None:
        """Looks at the next rows, (steps, rows)."""
        for place, equality in enumerate(self._layout.equalities if len(block) else ()):
            for unit, sizes in gaps(self._model, equality, block[:, self._layout.of_equality(place)]).items():
                if not self._seen:
                    self.opening = max(self.opening, float(sizes[0]))
                at = int(sizes.argmax())
                if sizes[at] > self.size:
                    self.size, self.step = float(sizes[at]), self._seen + at
                    self.equality, self.unit = equality, unit
        self._seen += len(block)


def disturbed(model: mujoco.MjModel, start: Start, seed: int) -> Start | None:
    """A start with normal numbers added to all coordinates and velocities, then closed; None if it cannot be.

    Contacts and limits are not looked at: a disturbed start may touch what the given one does not.
    """
    own = own_copy(without_flexes(model))
    own.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    own.opt.disableflags |= IGNORED
    for size in DISTURBANCES:
        moved, pushed = np.random.default_rng(seed).normal(scale=size, size=(2, own.nv))
        data = _data(own, start)
        mujoco.mj_integratePos(own, data.qpos, moved, 1.0)
        data.qvel += pushed
        if not close(own, data, None) and gap(data) > CONSISTENT:
            continue
        mujoco.mj_fwdPosition(own, data)
        mujoco.mj_fwdVelocity(own, data)
        if data.ne:
            data.qvel += Projector(own, None, SolverSpec(REFERENCE)).correction(data, -data.efc_vel[: data.ne])
        return Start(data.qpos.copy(), data.qvel.copy(), start.act, f"disturbed {seed}")
    return None
