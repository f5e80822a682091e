"""How far a run goes beyond the ranges of joints and tendons: what MuJoCo's soft limits give way."""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.text import called
from oarlock.mechanics.coupled import COUPLED
from oarlock.mechanics.names import element_name

_TURNS = (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL)
_OFF = mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT


@dataclass(frozen=True)
class Overrun:
    """A range that is left.

    Attributes:
        limit: in words, such as ``limit of joint 'knee'``.
        by: how far at most, in ``unit``.
    """

    limit: str
    by: float
    unit: str


class Overruns:
    """Collects how far states are beyond the ranges of hinges, slides and tendons, as far as these act."""

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        acts = not model.opt.disableflags & _OFF
        self._joints = np.flatnonzero(model.jnt_limited.astype(bool) & ~np.isin(model.jnt_type, _TURNS) & acts)
        self._tendons = np.flatnonzero(model.tendon_limited.astype(bool) & acts)
        self._addresses = model.jnt_qposadr[self._joints]
        self._low, self._high = np.vstack([model.jnt_range[self._joints], model.tendon_range[self._tendons]]).T
        self._most = np.zeros(len(self._low))

    def see(self, data: mujoco.MjData) -> None:
        """Looks at a state whose position stage is done."""
        if len(self._low):
            values = np.concatenate([data.qpos[self._addresses], data.ten_length[self._tendons]])
            np.maximum(self._most, np.maximum(self._low - values, values - self._high), out=self._most)

    @property
    def found(self) -> tuple[Overrun, ...]:
        """The ranges that were left, in the order of the model."""
        every = [("joint", COUPLED["joints"], joint) for joint in self._joints.tolist()]
        every += [("tendon", COUPLED["tendons"], tendon) for tendon in self._tendons.tolist()]
        return tuple(
            Overrun(
                f"limit of {called(what, element_name(self._model, sort.object_type, index))}",
                by,
                sort.unit(self._model, index),
            )
            for (what, sort, index), by in zip(every, self._most.tolist(), strict=True)
            if by > 0.0
        )
