"""The drive of a model: controls as laws of time, evaluated at every stage of the integrator, or held over a step."""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Self

import mujoco

from oarlock.base.core import TimeLaw
from oarlock.base.errors import RefusedError, choose
from oarlock.cases.case import Case
from oarlock.mechanics.names import element_name

OFF = 1e-3
"""Part of the time that a control is held for by which a time may miss its multiples: times are sums of timesteps."""


class Drive:
    """Writes controls into ``data.ctrl``. An actuator without a name is addressed by number, ``#3``.

    Attributes:
        laws: pairs of an actuator's number and its law.
        held_s: s; controls change at multiples of it only, at the start of a step. None: they follow their laws at
            every stage of the integrator.

    Raises:
        InputError: the case names an actuator that the model does not have.
    """

    def __init__(self, model: mujoco.MjModel, case: Case):
        given = case.file.drive
        held_s = float(model.opt.timestep) if given.held else None
        self._take(model, given.laws(), held_s, f"actuator in [drive] of case '{case.name}'")

    @classmethod
    def of(cls, model: mujoco.MjModel, laws: Mapping[str, TimeLaw], held_s: float | None, what: str) -> Self:
        """A drive of laws by the names of actuators, which a message calls ``what``.

        Raises:
            InputError: an actuator that the model does not have.
        """
        drive = cls.__new__(cls)
        drive._take(model, laws, held_s, what)
        return drive

    def _take(self, model: mujoco.MjModel, laws: Mapping[str, TimeLaw], held_s: float | None, what: str) -> None:
        actuators = [element_name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, index) for index in range(model.nu)]
        self.laws: list[tuple[int, TimeLaw]] = []
        for name, law in laws.items():
            choose(what, name, actuators)
            self.laws.append((actuators.index(name), law))
        self.held_s = held_s
        self._model = model

    def apply(self, data: mujoco.MjData) -> None:
        """Writes the controls at ``data.time``, the start of a step; one that is held stays until its time is over.

        Raises:
            RefusedError: a law has no finite value at that time.
        """
        if self.held_s is not None:
            ticks = data.time / self.held_s
            if not abs(ticks - round(ticks)) <= OFF:
                return
        self._write(data)

    def apply_at_stage(self, data: mujoco.MjData) -> None:
        """Writes the controls at the time of a later stage of a step; one that is held stays as it is.

        Raises:
            RefusedError: a law has no finite value at that time.
        """
        if self.held_s is None:
            self._write(data)

    def _write(self, data: mujoco.MjData) -> None:
        time = data.time
        for index, law in self.laws:
            value = law.at(time)
            if not math.isfinite(value):
                raise RefusedError(f"{law!r} is {value} at t = {time:g} s, expected a finite control")
            data.ctrl[index] = value

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Installs the drive as MuJoCo's control hook for the time of the block, unless its controls are held.

        MuJoCo's own integrators then evaluate it at every stage. The hook is global to the process, and MuJoCo also
        calls it while it compiles another model, so it answers for this drive's model only.
        """
        if not self.laws or self.held_s is not None:
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
