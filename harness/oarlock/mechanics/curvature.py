"""J̇v, the part of the constraints' acceleration that does not depend on the acceleration of the coordinates.

The exact time derivative of MuJoCo's own rows of J, times v:

- connect and weld: MuJoCo has it, because it asks them for aref = −B Jv − K d r − J̇v. Recovering J̇v from aref costs
  the rounding of the other two terms. Before 3.7 it left it out here too, and it is computed from the bodies' motion.
- joint and tendon: y − p(x) with a quartic p, y and x measured from the model's own pose; J̇v = ÿ − p'(x) ẍ − p''(x) ẋ²,
  where ÿ and ẍ are 0 for joints and fixed tendons. MuJoCo leaves it out of their aref.
"""

from collections.abc import Callable
from typing import NoReturn

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.vectors import horner
from oarlock.cases.equality_kinds import unknown
from oarlock.mechanics.engine_version import lacks_curvature
from oarlock.mechanics.joined import Joined
from oarlock.mechanics.kinematics import Kinematics
from oarlock.mechanics.names import Equality, equalities
from oarlock.mechanics.tendons import Tendon


class _Coupling:
    """J̇v of a row y − p(x) of joints or tendons. Subclasses say what x, ẋ, ẍ and ÿ are."""

    def __init__(self, coefficients: np.ndarray, coupled: bool):
        _, *linear = coefficients.tolist()
        self._first = [power * coefficient for power, coefficient in enumerate(linear, 1)]
        self._second = [power * coefficient for power, coefficient in enumerate(self._first[1:], 1)]
        self._coupled = coupled
        self.bodies: list[int] = []

    def bend(self, data: mujoco.MjData, kinematics: Kinematics) -> float:
        bend = self._bend(data, kinematics, 0)
        if self._coupled:
            x, rate = self._argument(data)
            bend -= horner(self._first, x) * self._bend(data, kinematics, 1) + horner(self._second, x) * rate * rate
        return bend

    def _bend(self, data: mujoco.MjData, kinematics: Kinematics, end: int) -> float:
        raise NotImplementedError

    def _argument(self, data: mujoco.MjData) -> tuple[float, float]:
        raise NotImplementedError


class _Joints(_Coupling):
    def __init__(self, model: mujoco.MjModel, index: int):
        joint = int(model.eq_obj2id[index])
        super().__init__(model.eq_data[index, :5], joint >= 0)
        self._qpos, self._dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        self._zero = float(model.qpos0[self._qpos])

    def _bend(self, data: mujoco.MjData, kinematics: Kinematics, end: int) -> float:
        return 0.0

    def _argument(self, data: mujoco.MjData) -> tuple[float, float]:
        return float(data.qpos[self._qpos]) - self._zero, float(data.qvel[self._dof])


class _Tendons(_Coupling):
    def __init__(self, model: mujoco.MjModel, index: int):
        ids = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        super().__init__(model.eq_data[index, :5], ids[1] >= 0)
        self._tendons = [Tendon(model, tendon) for tendon in ids if tendon >= 0]
        self.bodies = [body for tendon in self._tendons for body in tendon.bodies]
        self._second_id = ids[1]
        self._zero = float(model.tendon_length0[ids[1]])

    def _bend(self, data: mujoco.MjData, kinematics: Kinematics, end: int) -> float:
        return self._tendons[end].bend(data, kinematics)

    def _argument(self, data: mujoco.MjData) -> tuple[float, float]:
        return float(data.ten_length[self._second_id]) - self._zero, float(data.ten_velocity[self._second_id])


def bends(model: mujoco.MjModel, equality: Equality) -> bool:
    """Whether J̇v of a coupling can be other than 0: its polynomial, or the length of a tendon of it, is curved."""
    first, second = int(model.eq_obj1id[equality.index]), int(model.eq_obj2id[equality.index])
    if second >= 0 and model.eq_data[equality.index, 2:5].any():
        return True
    tendons = [tendon for tendon in (first, second) if tendon >= 0] if equality.kind.holds == "tendons" else []
    return any(model.wrap_type[model.tendon_adr[tendon]] != mujoco.mjtWrap.mjWRAP_JOINT for tendon in tendons)


_COUPLINGS: dict[str, Callable[[mujoco.MjModel, int], _Coupling]] = {"joints": _Joints, "tendons": _Tendons}


class Curvature:
    """Computes J̇v of the active rows of every kind of equality that is known.

    Args:
        lenient: rows of other kinds are left as MuJoCo has them, instead of being refused.

    Raises:
        InputError: an active equality is of another kind.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, *, lenient: bool = False):
        self._couplings: dict[int, _Coupling] = {}
        self._joined: dict[int, Joined] = {}
        self._unknown: dict[int, Equality] = {}
        for equality in equalities(model):
            index = equality.index
            if lacks_curvature(equality.kind) and equality.kind.joins_points:
                self._joined[index] = Joined(model, equality)
            elif lacks_curvature(equality.kind):
                self._couplings[index] = _COUPLINGS[equality.kind.holds](model, index)
            elif not equality.kind.known and not lenient:
                self._unknown[index] = equality
                if data.eq_active[index]:
                    self._refuse(index)
        owners = (*self._couplings.values(), *self._joined.values())
        bodies = [body for owner in owners for body in owner.bodies]
        self._kinematics = Kinematics(model, bodies)

    def _refuse(self, index: int) -> NoReturn:
        equality = self._unknown[index]
        raise InputError(f"{unknown(equality.name, equality.kind)}: J̇v of other kinds is not known")

    def write(self, data: mujoco.MjData, out: np.ndarray) -> None:
        """Writes J̇v (ne; m/s² or rad/s²) of a state whose position and velocity stages are done to ``out``.

        The rows are those that MuJoCo made: it leaves out an equality whose rows are all zero.

        Raises:
            InputError: an equality of another kind was switched on, or a tendon's length has no second derivative.
        """
        ne = data.ne
        law = data.efc_KBIP
        stiffness, damping, impedance = law[:ne, 0], law[:ne, 1], law[:ne, 2]
        asked = damping * data.efc_vel[:ne] + stiffness * impedance * data.efc_pos[:ne] + data.efc_aref[:ne]
        np.negative(asked, out)
        if not self._couplings and not self._joined and not self._unknown:
            return
        self._kinematics.read(data)
        last = -1
        for row, owner in enumerate(data.efc_id[:ne].tolist()):
            if owner in self._joined:
                if owner != last:  # all rows of one come one after another
                    bends = self._joined[owner].bends(data, self._kinematics)
                    out[row : row + len(bends)] = bends
                last = owner
            elif owner in self._couplings:
                out[row] = self._couplings[owner].bend(data, self._kinematics)
            elif owner in self._unknown:
                self._refuse(owner)
