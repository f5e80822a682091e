"""The drive of a model: controls as laws of time, evaluated at the time of every stage of the integrator."""

import math
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

from oarlock.base.core import TimeLaw
from oarlock.base.errors import RefusedError, choose
from oarlock.cases.case import Case
from oarlock.mechanics.names import element_name


class Drive:
    """Writes the controls of a case into ``data.ctrl``. An actuator without a name is addressed by number, ``#3``.

    Attributes:
        laws: pairs of an actuator's number and its law.

    Raises:
        InputError: the case names an actuator that the model does not have.
    """

    def __init__(self, model: mujoco.MjModel, case: Case):
        actuators = [element_name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, index) for index in range(model.nu)]
        self.laws: list[tuple[int, TimeLaw]] = []
        for name, law in case.file.drive.laws().items():
            choose(f"actuator in [drive] of case '{case.name}'", name, actuators)
            self.laws.append((actuators.index(name), law))
        self._model = model

    def apply(self, data: mujoco.MjData) -> None:
        """Writes the controls at ``data.time``.

        Raises:
            RefusedError: a law has no finite value at that time.
        """
        time = data.time
        for index, law in self.laws:
            value = law.at(time)
            if not math.isfinite(value):
                raise RefusedError(f"{law!r} is {value} at t = {time:g} s, expected a finite control")
            data.ctrl[index] = value

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Installs the drive as MuJoCo's control hook for the time of the block.

        MuJoCo's own integrators then evaluate it at every stage. The hook is global to the process, and MuJoCo also
        calls it while it compiles another model, so it answers for this drive's model only.
        """
        if not self.laws:
            yield
            return
        address = self._model._address

        def control(model: mujoco.MjModel, data: mujoco.MjData) -> None:
            if model._address == address:
                self.apply(data)

        mujoco.set_mjcb_control(control)
        try:
            yield
        finally:
            mujoco.set_mjcb_control(None)
