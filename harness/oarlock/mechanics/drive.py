"""The drive of a model: controls as laws of time, evaluated at every stage of the integrator, or held over a step.

And equalities that are switched on and off between steps, as a program does that writes ``data.eq_active``; and mocap
bodies that it moves.
"""

import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import Self

import mujoco

from oarlock.base.core import TimeLaw
from oarlock.base.errors import RefusedError, choose
from oarlock.cases.case import Case
from oarlock.mechanics.mocap import MOCAP, MocapLaw, require_part
from oarlock.mechanics.names import element_name

OFF = 1e-3
"""Part of a timestep by which a time may miss its multiples: times are sums of timesteps."""

ACTIVE = "active:"
"""Before the name of an equality whose law is given: it is active while the law is positive."""


class Drive:
    """Writes controls into ``data.ctrl``. An actuator without a name is addressed by number, ``#3``.

    Attributes:
        laws: pairs of an actuator's number and its law.
        switches: pairs of an equality's number and its law.
        mocaps: the poses of mocap bodies that are given.
        step_s: s, of a whole step: equalities are switched and mocap bodies moved at its multiples only.
        held: whether controls change there only as well; else they follow their laws at every stage of the integrator.

    Raises:
        InputError: the case names an actuator, an equality or a mocap body that the model does not have.
    """

    def __init__(self, model: mujoco.MjModel, case: Case):
        given = case.file.drive
        what = f"actuator in [drive] of case '{case.name}'"
        self._take(model, given.laws(), float(model.opt.timestep), given.held, what)

    @classmethod
    def of(
        cls,
        model: mujoco.MjModel,
        laws: Mapping[str, TimeLaw],
        step_s: float,
        held: bool,
        what: str,
        logs: Collection[str] = (),
    ) -> Self:
        """A drive of laws by name: of actuators, which a message calls ``what``, equalities and mocap bodies.

        Args:
            model: whose they are.
            laws: those of equalities after ``ACTIVE``, those of parts of poses after ``MOCAP``.
            step_s: as the attribute.
            held: as the attribute.
            what: see above.
            logs: names of those that are a log's.

        Raises:
            InputError: an actuator, an equality, a mocap body or a part of its pose that there is not.
        """
        drive = cls.__new__(cls)
        drive._take(model, laws, step_s, held, what, logs)
        return drive

    def _take(
        self,
        model: mujoco.MjModel,
        laws: Mapping[str, TimeLaw],
        step_s: float,
        held: bool,
        what: str,
        logs: Collection[str] = (),
    ) -> None:
        actuators = [element_name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, index) for index in range(model.nu)]
        equalities = [element_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, index) for index in range(model.neq)]
        self.laws: list[tuple[int, TimeLaw]] = []
        self.switches: list[tuple[int, TimeLaw]] = []
        poses: dict[str, dict[str, TimeLaw]] = {}
        logged: set[str] = set()
        for name, law in laws.items():
            if name.startswith(ACTIVE) and name not in actuators:
                equality = choose(f"equality after '{ACTIVE}'", name.removeprefix(ACTIVE), equalities)
                self.switches.append((equalities.index(equality), law))
                continue
            if name.startswith(MOCAP) and name not in actuators:
                body, part = require_part(model, name)
                poses.setdefault(body, {})[part] = law
                logged |= {body} if name in logs else set()
                continue
            choose(what, name, actuators)
            self.laws.append((actuators.index(name), law))
        self.mocaps = [MocapLaw(model, body, parts, step_s, body in logged) for body, parts in poses.items()]
        self.step_s, self.held = step_s, held
        self._model = model

    def apply(self, data: mujoco.MjData) -> None:
        """Writes the controls at ``data.time``, the start of a step; one that is held stays until its time is over.

        Raises:
            RefusedError: a law has no finite value at that time.
        """
        if self.between:
            if self.begins_step(data.time):
                self._switch(data)
                self.move(data)
            elif self.held:
                return
        self._write(data)

    @property
    def between(self) -> bool:
        """Whether something is written between steps only."""
        return bool(self.held or self.switches or self.mocaps)

    def begins_step(self, time: float) -> bool:
        """Whether a time, s, is one at which a whole step starts."""
        ticks = time / self.step_s
        return abs(ticks - round(ticks)) <= OFF

    def move(self, data: mujoco.MjData) -> None:
        """Moves the mocap bodies to where they are at ``data.time``.

        Raises:
            RefusedError: as ``MocapLaw.at``.
        """
        for law in self.mocaps:
            data.mocap_pos[law.mocap], data.mocap_quat[law.mocap] = law.at(data.time)

    def apply_at_stage(self, data: mujoco.MjData) -> None:
        """Writes the controls at the time of a later stage of a step; one that is held stays as it is.

        Raises:
            RefusedError: a law has no finite value at that time.
        """
        if not self.held:
            self._write(data)

    def _switch(self, data: mujoco.MjData) -> None:
        for index, law in self.switches:
            data.eq_active[index] = _value(law, data.time) > 0.0

    def _write(self, data: mujoco.MjData) -> None:
        for index, law in self.laws:
            data.ctrl[index] = _value(law, data.time)

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Installs the drive as MuJoCo's control hook for the time of the block, unless its controls are held.

        MuJoCo's own integrators then evaluate it at every stage. The hook is global to the process, and MuJoCo also
        calls it while it compiles another model, so it answers for this drive's model only.
        """
        if not self.laws or self.held:
            yield
            return
        address = self._model._address

        def control(model: mujoco.MjModel, data: mujoco.MjData) -> None:
            if model._address == address:
                self._write(data)

        mujoco.set_mjcb_control(control)
        try:
            yield
        finally:
            mujoco.set_mjcb_control(None)


def _value(law: TimeLaw, time: float) -> float:
    value = law.at(time)
    if not math.isfinite(value):
        raise RefusedError(f"{law!r} is {value} at t = {time:g} s, expected a finite control")
    return value
