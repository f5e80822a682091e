"""Mocap bodies that move: poses as laws of time or a log's, as a program writes ``data.mocap_pos`` and ``mocap_quat``.

Parts of a pose have names: ``x``, ``y``, ``z``, m, in the world; of the orientation either ``qw``, ``qx``, ``qy``,
``qz``, a quaternion of any length > 0, or ``rx``, ``ry``, ``rz``, rad: axis times angle of the rotation, in the world.
What is left out of a position stays as the model has it; of an orientation it is 0, where another part of it is given.
"""

import math
from collections.abc import Iterable, Mapping
from typing import get_args

import mujoco
import numpy as np

from oarlock.base.core import TimeLaw
from oarlock.base.errors import InputError, RefusedError, choose
from oarlock.cases.drive import MocapPart
from oarlock.mechanics.names import element_name, equalities

MOCAP = "mocap:"
"""Before the name of a mocap body and a part of its pose, whose law is given: ``mocap:hand.x``."""

POSITION, QUATERNION, ROTATION = ("x", "y", "z"), ("qw", "qx", "qy", "qz"), ("rx", "ry", "rz")
PARTS: tuple[MocapPart, ...] = get_args(MocapPart)

SHORTEST = 1e-6
"""Length of a quaternion, at least: of a shorter one MuJoCo makes the identity."""

Pose = tuple[np.ndarray, np.ndarray]
"""Position (3), m, and quaternion (4) of any length > 0."""


def mocap_bodies(model: mujoco.MjModel) -> dict[str, int]:
    """Name of every mocap body → the number of the body."""
    numbers = np.flatnonzero(model.body_mocapid >= 0).tolist()
    return {element_name(model, mujoco.mjtObj.mjOBJ_BODY, body): body for body in numbers}


def mocap_parts(model: mujoco.MjModel) -> list[str]:
    """What laws of poses go by: ``mocap:hand.x``."""
    return [f"{MOCAP}{name}.{part}" for name in mocap_bodies(model) for part in PARTS]


def require_part(model: mujoco.MjModel, name: str) -> tuple[str, MocapPart]:
    """The body and the part that ``mocap:BODY.PART`` names.

    Raises:
        InputError: there is no such mocap body or part.
    """
    body, sign, part = name.removeprefix(MOCAP).rpartition(".")
    if not sign:
        raise InputError(f"'{name}' names no part of a pose, expected {MOCAP}BODY.PART with one of: {', '.join(PARTS)}")
    known = mocap_bodies(model)
    if not known:
        raise InputError(f"'{name}' names a mocap body, and the model has none, expected one")
    return choose(f"mocap body after '{MOCAP}'", body, list(known)), choose(f"part in '{name}'", part, list(PARTS))


class MocapLaw:
    """The pose of one mocap body.

    Attributes:
        name: of the body; ``body``: its number.
        mocap: its number among the mocap bodies.

    Args:
        model: whose body it is.
        name: of the body.
        laws: part → its law.
        step_s: s, of a whole step.
        logged: whether a part is a log's, whose values jump. Between the starts of two steps, where the exact solution
            asks for it, the pose then goes straight.

    Raises:
        InputError: the orientation is given twice.
    """

    def __init__(self, model: mujoco.MjModel, name: str, laws: Mapping[str, TimeLaw], step_s: float, logged: bool):
        self.name, self.body = name, mocap_bodies(model)[name]
        self.mocap = int(model.body_mocapid[self.body])
        self._laws, self._step_s, self._logged = dict(laws), step_s, logged
        self._own: Pose = model.body_pos[self.body].copy(), model.body_quat[self.body].copy()
        turned = [[part for part in parts if part in laws] for parts in (QUATERNION, ROTATION)]
        if all(turned):
            first, second = (f"'{MOCAP}{name}.{parts[0]}'" for parts in turned)
            raise InputError(
                f"both {first} and {second} turn the mocap body '{name}', expected qw qx qy qz or rx ry rz"
            )
        self._quaternion, self._rotation = map(bool, turned)

    @property
    def constant(self) -> bool:
        """Whether it stays where it is."""
        return all(law.is_constant for law in self._laws.values())

    def at(self, time: float) -> Pose:
        """The pose at a time, s: what is written before a step that starts there.

        Raises:
            RefusedError: a law has no finite value there, or the quaternion no direction.
        """
        position, quaternion = self._own
        position = np.array(
            [self._value(part, time, own) for part, own in zip(POSITION, position.tolist(), strict=True)]
        )
        if self._quaternion:
            quaternion = np.array([self._value(part, time) for part in QUATERNION])
            length = float(np.linalg.norm(quaternion))
            if not length >= SHORTEST:
                raise RefusedError(
                    f"the quaternion of the mocap body '{self.name}' has the length {length:.3g} at t = {time:g} s, "
                    "expected 1"
                )
        elif self._rotation:
            vector = np.array([self._value(part, time) for part in ROTATION])
            angle, quaternion = float(np.linalg.norm(vector)), np.array([1.0, 0.0, 0.0, 0.0])
            if angle > 0.0:
                mujoco.mju_axisAngle2Quat(quaternion, vector / angle, angle)
        return position, quaternion

    def along(self, time: float, began: float) -> Pose:
        """The pose at a time, s, of the whole step that began at another one, as a smooth function of ``time``.

        Of laws it is that of ``at``; of a log it goes straight to where the next step starts.

        Raises:
            RefusedError: as ``at``.
        """
        if not self._logged:
            return self.at(time)
        (here, first), (there, second) = self.at(began), self.at(began + self._step_s)
        part = (time - began) / self._step_s
        first, second = first / np.linalg.norm(first), second / np.linalg.norm(second)
        second = -second if first @ second < 0.0 else second  # both are the same orientation: the shorter way
        return here + part * (there - here), first + part * (second - first)

    def _value(self, part: str, time: float, own: float = 0.0) -> float:
        if part not in self._laws:
            return own
        value = self._laws[part].at(time)
        if not math.isfinite(value):
            named = f"{MOCAP}{self.name}.{part} = {self._laws[part]!r}"
            raise RefusedError(f"{named} is {value} at t = {time:g} s, expected a finite number")
        return value


def moved_equalities(model: mujoco.MjModel, moved: Iterable[int]) -> tuple[int, ...]:
    """Numbers of the equalities of which a side is on a body that moves with one of the bodies ``moved``."""
    on = np.isin(model.body_rootid, list(moved))
    sites, geoms = on[model.site_bodyid], on[model.geom_bodyid]
    kinds = mujoco.mjtWrap
    by_wrap = {kinds.mjWRAP_SITE: sites, kinds.mjWRAP_SPHERE: geoms, kinds.mjWRAP_CYLINDER: geoms}

    def moves(tendon: int) -> bool:
        path = range(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
        return any(
            bool(by_wrap[kind][model.wrap_objid[wrap]])
            for wrap in path
            if (kind := kinds(model.wrap_type[wrap])) in by_wrap
        )

    found = []
    for equality in equalities(model):
        ends = int(model.eq_obj1id[equality.index]), int(model.eq_obj2id[equality.index])
        if equality.kind.holds == "tendons":
            moving = any(moves(tendon) for tendon in ends if tendon >= 0)
        else:
            moving = any(on[body] for body in equality.bodies)
        if moving:
            found.append(equality.index)
    return tuple(found)
