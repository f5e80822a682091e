"""J̇v: the part of the constraints' acceleration that needs no acceleration of the coordinates.

The rows of a kind of equality are MuJoCo's own, and J̇v is the exact time derivative of their Jacobian, times v:

- connect: p₁ − p₂ of the anchors.
- weld: the same of its anchors, then τ Im(q̄₂ q₁) with the orientations q₁ (with the relative pose) and q₂ as
  quaternions and τ the torque scale; its rate is ½τ Im(q̄₂ (ω₁ − ω₂) q₁), and with q̇ = ½ωq the rate of that is
  ½τ Im(q̄₂ (α₁ − α₂ + ω₁×ω₂ − ½|ω₁ − ω₂|²) q₁), where α = J̇v of a body's rotation.
- joint and tendon: y − p(x) with a quartic p, y and x measured from the model's own pose; J̇v = ÿ − p'(x) ẍ − p''(x) ẋ²,
  where ÿ and ẍ are 0 for joints and fixed tendons.
"""

from collections.abc import Sequence
from typing import NoReturn, Protocol

import mujoco
import numpy as np

from oarlock.errors import InputError
from oarlock.kinematics import Kinematics, Point
from oarlock.mechanism import Equality, equalities
from oarlock.tendons import Tendon
from oarlock.vectors import Quaternion, Vector, conjugate, cross, dot, horner, minus, plus, product


class _Rows(Protocol):
    """The rows of one equality."""

    bodies: list[int]
    """Those whose motion they need."""

    def bends(self, data: mujoco.MjData, kinematics: Kinematics) -> Sequence[float]:
        """J̇v of every row, given the motion of their bodies."""
        ...


class _Connect:
    def __init__(self, ends: tuple[Point, Point]):
        self._ends = ends
        self.bodies = [end.body for end in ends]

    def bends(self, data: mujoco.MjData, kinematics: Kinematics) -> Vector:
        return kinematics.points_apart(data, self._ends)


class _Weld:
    def __init__(self, ends: tuple[Point, Point], turns: tuple[Quaternion, Quaternion], scale: float):
        self._ends, self._turns = ends, turns
        self._half_scale = 0.5 * scale
        self.bodies = [end.body for end in ends]

    def bends(self, data: mujoco.MjData, kinematics: Kinematics) -> list[float]:
        spin1, spin2 = (kinematics.spin(body) for body in self.bodies)
        apart = minus(spin1, spin2)
        bend1, bend2 = (kinematics.spin_bend(body) for body in self.bodies)
        x, y, z = plus(minus(bend1, bend2), cross(spin1, spin2))
        quat1, quat2 = (
            product(data.xquat[body].tolist(), turn) for body, turn in zip(self.bodies, self._turns, strict=True)
        )
        turned = product(conjugate(quat2), product((-0.5 * dot(apart, apart), x, y, z), quat1))
        return [*kinematics.points_apart(data, self._ends), *(self._half_scale * entry for entry in turned[1:])]


class _Coupling:
    """y − p(x) of joints or tendons; a subclass says what x, ẋ, ẍ and ÿ are."""

    def __init__(self, coefficients: np.ndarray, coupled: bool):
        _, *linear = coefficients.tolist()
        self._first = [power * coefficient for power, coefficient in enumerate(linear, 1)]
        self._second = [power * coefficient for power, coefficient in enumerate(self._first[1:], 1)]
        self._coupled = coupled
        self.bodies: list[int] = []

    def bends(self, data: mujoco.MjData, kinematics: Kinematics) -> list[float]:
        bend = self._bend(data, kinematics, 0)
        if self._coupled:
            x, rate = self._argument(data)
            bend -= horner(self._first, x) * self._bend(data, kinematics, 1) + horner(self._second, x) * rate * rate
        return [bend]

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


def _ends(model: mujoco.MjModel, equality: Equality) -> tuple[Point, Point]:
    """The anchors of a connect or weld."""
    first, second = (
        Point(body, equality.sites[end] if equality.sites else None, tuple(equality.anchor(model, end).tolist()))
        for end, body in enumerate(equality.bodies)
    )
    return first, second


def _weld(model: mujoco.MjModel, equality: Equality) -> _Weld:
    if equality.sites:
        turns = model.site_quat[equality.sites[0]].tolist(), model.site_quat[equality.sites[1]].tolist()
    else:
        turns = model.eq_data[equality.index, 6:10].tolist(), (1.0, 0.0, 0.0, 0.0)
    return _Weld(_ends(model, equality), turns, float(model.eq_data[equality.index, 10]))


class Curvature:
    """J̇v of the active rows: connect, weld, joint and tendon equalities.

    Raises:
        InputError: an active equality of another kind, at once or when it is switched on.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData):
        self._rows: dict[int, _Rows] = {}
        self._unknown: dict[int, Equality] = {}
        for equality in equalities(model):
            index = equality.index
            if equality.kind == "connect":
                self._rows[index] = _Connect(_ends(model, equality))
            elif equality.kind == "weld":
                self._rows[index] = _weld(model, equality)
            elif equality.kind == "joint":
                self._rows[index] = _Joints(model, index)
            elif equality.kind == "tendon":
                self._rows[index] = _Tendons(model, index)
            else:
                self._unknown[index] = equality
                if data.eq_active[index]:
                    self._refuse(index)
        self._kinematics = Kinematics(model, (body for rows in self._rows.values() for body in rows.bodies))

    def _refuse(self, index: int) -> NoReturn:
        equality = self._unknown[index]
        raise InputError(
            f"equality '{equality.name}' is a {equality.kind}, expected connect, weld, joint or tendon: "
            "J̇v of other kinds is not known"
        )

    def write(self, data: mujoco.MjData, out: np.ndarray) -> None:
        """Writes J̇v (ne; m/s² or rad/s²) of a state whose position and velocity stages are done.

        Goes by the rows that MuJoCo made: it leaves out an equality whose rows are zero throughout.

        Raises:
            InputError: an equality of another kind was switched on, or a tendon's length has no second derivative.
        """
        self._kinematics.read(data)
        owners = data.efc_id[: data.ne].tolist()
        bends: list[float] = []
        while len(bends) < len(owners):
            index = owners[len(bends)]
            rows = self._rows.get(index)
            if rows is None:
                self._refuse(index)
            bends += rows.bends(data, self._kinematics)
        out[:] = bends


def curvature_from_reference(data: mujoco.MjData) -> np.ndarray:
    """J̇v (ne) recovered from MuJoCo's own reference acceleration, aref = −B Jv − K d r − J̇v.

    Right for connects and welds since MuJoCo 3.7; MuJoCo leaves the term out for joint and tendon equalities. Used to
    check ``Curvature``, not in its place.
    """
    ne = data.ne
    stiffness, damping, impedance, _ = data.efc_KBIP[:ne].T
    return -damping * data.efc_vel[:ne] - stiffness * impedance * data.efc_pos[:ne] - data.efc_aref[:ne]
