"""A compiled model of MuJoCo read as a mechanism: bodies, points that equalities join, and what acts besides.

Of MuJoCo only the arrays are known, and the numbers that its enumerations have.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

FREE, BALL, SLIDE, HINGE = range(4)
"""Members of mjtJoint."""

CONNECT, WELD, JOINT, TENDON = range(4)
"""Members of mjtEq; those above are of flexes, or kinds that are not known here."""

WRAP_JOINT, WRAP_PULLEY, WRAP_SITE = 1, 2, 3
"""Members of mjtWrap; those above are geoms."""

SITE = 6
"""Member of mjtObj."""

_OFF = {"constraint": 1, "equality": 2, "frictionloss": 4, "limit": 8, "contact": 16, "gravity": 128}
"""Members of mjtDisableBit."""

_PARENT_FILTER = 1024

QPOS = (7, 4, 1, 1)
"""Entries of qpos that a kind of joint has."""

DOFS = (6, 3, 1, 1)
"""Degrees of freedom of it."""

KINDS = ("connect", "weld", "joint", "tendon", "flex", "flexvert", "flexstrain", "distance")


@dataclass(frozen=True)
class Joining:
    """A connect or weld: a point of one body held on a point of another.

    Attributes:
        index: number among the equalities.
        bodies: the two bodies.
        places: the two points, each in the frame of its body (m).
        turns: orientation of each point's frame in its body, w x y z; of a weld the two frames agree.
        scale: of the rows that turn; 0 of a connect, which has none.
    """

    index: int
    bodies: tuple[int, int]
    places: tuple[np.ndarray, np.ndarray]
    turns: tuple[np.ndarray, np.ndarray]
    scale: float

    @property
    def size(self) -> int:
        """Number of rows."""
        return 6 if self.scale else 3


class Compiled:
    """The model.

    Args:
        arrays: every numeric array and size under its own name, and lists of names such as ``joint_names``.
    """

    def __init__(self, arrays: dict[str, np.ndarray]):
        self._arrays = arrays

    def __getattr__(self, name: str) -> np.ndarray:
        try:
            return self.__dict__["_arrays"][name]
        except KeyError:
            raise AttributeError(f"the compiled model has no '{name}'") from None

    def get(self, name: str) -> np.ndarray:
        """An array that not every version of MuJoCo has; empty where it is missing."""
        return self._arrays.get(name, np.zeros(0))

    def size(self, name: str) -> int:
        """A size, such as ``nv``; 0 where the version has none."""
        return int(self._arrays.get(name, 0))

    def name(self, sort: str, index: int) -> str:
        """Name of an element; its number, such as ``#3``, where it has none."""
        names = self._arrays.get(f"{sort}_names")
        return (str(names[index]) if names is not None and index < len(names) else "") or f"#{index}"

    def called(self, sort: str, index: int) -> str:
        """An element in words, such as ``equality 'pin'``; one that is described, as ``geom of 'base'``, stands so."""
        name = self.name(sort, index)
        if name.startswith("#") or " of '" in name:
            return f"{sort} {name}" if name.startswith("#") else name
        return f"{sort} '{name}'"

    def on(self, what: str) -> bool:
        """Whether the model's flags leave a part of the physics on."""
        return not int(self.opt_disableflags) & _OFF[what]

    @property
    def gravity(self) -> np.ndarray:
        """m/s²."""
        return np.asarray(self.opt_gravity, dtype=float) if self.on("gravity") else np.zeros(3)

    def joints(self, body: int) -> range:
        """Numbers of the joints of a body."""
        first = int(self.body_jntadr[body])
        return range(first, first + int(self.body_jntnum[body])) if first >= 0 else range(0)

    # Equalities.

    def active(self) -> list[int]:
        """Numbers of the equalities that are on."""
        if not (self.on("constraint") and self.on("equality")):
            return []
        return np.flatnonzero(self.eq_active0).tolist() if self.size("neq") else []

    def joinings(self) -> list[Joining]:
        """The connects and welds that are on."""
        return [self._joining(index) for index in self.active() if self.eq_type[index] in (CONNECT, WELD)]

    def _joining(self, index: int) -> Joining:
        first, second = int(self.eq_obj1id[index]), int(self.eq_obj2id[index])
        data, weld = self.eq_data[index], self.eq_type[index] == WELD
        scale = float(data[10]) if weld else 0.0
        if self.eq_objtype[index] == SITE:
            sites = (first, second)
            bodies = int(self.site_bodyid[first]), int(self.site_bodyid[second])
            places = self.site_pos[first], self.site_pos[second]
            turns = [unit(self.site_quat[site]) for site in sites]
        else:
            bodies = first, second
            # The anchor of a weld is a point of the second body, its pose is that of the second in the first.
            places = (data[3:6], data[0:3]) if weld else (data[0:3], data[3:6])
            turns = [unit(data[6:10]) if weld else NO_TURN, NO_TURN]
        return Joining(index, bodies, (places[0], places[1]), (turns[0], turns[1]), scale)

    def rows(self) -> int:
        """Rows of the active equalities; of kinds that are not known here none."""
        sizes = (3, 6, 1, 1)
        return sum(sizes[kind] for kind in self.eq_type[self.active()] if kind <= TENDON) if self.active() else 0

    def expressed(self) -> list[str]:
        """Kinds of the equalities that are on."""
        return sorted({KINDS[kind] for kind in self.eq_type[self.active()].tolist()}) if self.active() else []

    def facts(self) -> dict[str, object]:
        """What a program that has everything of the model has of it: masses by body, equalities, rows."""
        masses = {self.name("body", body): float(self.body_mass[body]) for body in range(1, int(self.nbody))}
        return {
            "total_mass": sum(masses.values()),
            "body_masses": masses,
            "equalities": [self.name("equality", index) for index in self.active()],
            "rows": self.rows(),
            "cone": None,
        }

    # What an engine of rigid bodies and bilateral constraints has no words for.

    def foreign(self, states: dict[str, np.ndarray]) -> Iterator[tuple[str, str]]:
        """Yields what acts besides rigid bodies, joints and equalities at any of the states, each with why."""
        for flex in range(self.size("nflex")):
            yield self.called("flex", flex), "a deformable body"
        for plugin in range(self.size("nplugin")):
            yield self.called("plugin", plugin), "code of MuJoCo's"
        for index in self.active():
            kind = int(self.eq_type[index])
            if kind > TENDON:
                name = KINDS[kind] if kind < len(KINDS) else f"kind {kind}"
                yield self.called("equality", index), f"an equality of kind {name}"
        for actuator in np.flatnonzero(self.get("actuator_armature")).tolist():
            yield self.called("actuator", actuator), "an actuator with armature"
        if self.on("constraint"):
            yield from self._friction()
            yield from self.limits(states["qpos"])
            yield from self._contacts(states)

    def _friction(self) -> Iterator[tuple[str, str]]:
        if not self.on("frictionloss"):
            return
        joints = dict.fromkeys(self.dof_jntid[np.flatnonzero(self.dof_frictionloss)].tolist())
        for joint in joints:
            yield self.called("joint", joint), "friction loss"
        if self.size("ntendon"):
            for tendon in np.flatnonzero(self.tendon_frictionloss).tolist():
                yield self.called("tendon", tendon), "friction loss"

    def limits(self, qpos: np.ndarray) -> Iterator[tuple[str, str]]:
        """Yields the limits that act at any of some positions (n, nq)."""
        if not (self.on("constraint") and self.on("limit")):
            return
        for joint in np.flatnonzero(self.jnt_limited).tolist():
            at, (low, high) = int(self.jnt_qposadr[joint]), self.jnt_range[joint]
            if self.jnt_type[joint] == BALL:
                turns = qpos[:, at : at + 4]
                angle = 2.0 * np.arctan2(np.linalg.norm(turns[:, 1:], axis=1), np.abs(turns[:, 0]))
                room = max(low, high) - angle
            else:
                room = np.minimum(qpos[:, at] - low, high - qpos[:, at])
            if (room < self.jnt_margin[joint]).any():
                yield self.called("joint", joint), "its limit acts"
        if self.size("ntendon"):
            for tendon in np.flatnonzero(self.tendon_limited).tolist():
                yield from self._tendon_limit(tendon, qpos)

    def _tendon_limit(self, tendon: int, qpos: np.ndarray) -> Iterator[tuple[str, str]]:
        first, count = int(self.tendon_adr[tendon]), int(self.tendon_num[tendon])
        path = range(first, first + count)
        if self.wrap_type[first] != WRAP_JOINT:
            yield self.called("tendon", tendon), "its limit may act"
            return
        length = sum(self.wrap_prm[at] * qpos[:, int(self.jnt_qposadr[self.wrap_objid[at]])] for at in path)
        low, high = self.tendon_range[tendon]
        if (np.minimum(length - low, high - length) < self.tendon_margin[tendon]).any():
            yield self.called("tendon", tendon), "its limit acts"

    def _contacts(self, states: dict[str, np.ndarray]) -> Iterator[tuple[str, str]]:
        """Contacts of the states, where they were counted (``ncon``); else geoms that could ever touch."""
        if not self.on("contact"):
            return
        if "ncon" in states:
            touching = int((np.asarray(states["ncon"]) > 0).sum())
            if touching:
                yield "contacts", f"bodies touch in {touching} of {len(states['ncon'])} states"
        elif (pair := self._first_pair()) is not None:
            yield "contacts", f"{self.called('geom', pair[0])} and {self.called('geom', pair[1])} may touch"

    def _first_pair(self) -> tuple[int, int] | None:
        if self.size("npair"):
            return int(self.pair_geom1[0]), int(self.pair_geom2[0])
        excluded = set(self.get("exclude_signature").astype(int).tolist())
        welded, filtered = self.body_weldid, not int(self.opt_disableflags) & _PARENT_FILTER
        able = np.flatnonzero((self.geom_contype != 0) | (self.geom_conaffinity != 0)).tolist()
        for at, first in enumerate(able):
            for second in able[at + 1 :]:
                meets = self.geom_contype[first] & self.geom_conaffinity[second]
                if not (meets or self.geom_contype[second] & self.geom_conaffinity[first]):
                    continue
                bodies = int(self.geom_bodyid[first]), int(self.geom_bodyid[second])
                own = [int(welded[body]) for body in bodies]
                if own[0] == own[1] or (bodies[0] << 16) + bodies[1] in excluded:
                    continue
                above = [int(welded[self.body_parentid[body]]) for body in own]
                if filtered and all(own) and (above[0] == own[1] or above[1] == own[0]):
                    continue
                return first, second
        return None


# Quaternions, w x y z.

NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])


def unit(quat: np.ndarray) -> np.ndarray:
    """A quaternion of norm 1, as MuJoCo makes it: one that is 0 turns nothing."""
    norm = np.linalg.norm(quat)
    return np.asarray(quat, dtype=float) / norm if norm > 1e-15 else NO_TURN


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The quaternion of turning by b, then by a; of any two quaternions their product."""
    return np.concatenate([[a[0] * b[0] - a[1:] @ b[1:]], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])


def conjugate(quat: np.ndarray) -> np.ndarray:
    """The quaternion of the way back."""
    return quat * np.array([1.0, -1.0, -1.0, -1.0])


def pure(vector: np.ndarray) -> np.ndarray:
    """A vector as a quaternion without a real part."""
    return np.concatenate([[0.0], vector])


def matrix(quat: np.ndarray) -> np.ndarray:
    """The rotation matrix (3, 3) of a unit quaternion."""
    w, x, y, z = quat
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def turned(quat: np.ndarray, spin: np.ndarray) -> np.ndarray:
    """The orientation after turning by a rotation vector (rad) in the axes of the body."""
    angle = float(np.linalg.norm(spin))
    half = 0.5 * spin * np.sinc(0.5 * angle / np.pi)
    return unit(product(quat, np.concatenate([[np.cos(0.5 * angle)], half])))


def moved(compiled: Compiled, qpos: np.ndarray, qvel: np.ndarray, time: float) -> np.ndarray:
    """The pose (nq) after going with velocities (nv) for a time (s), as MuJoCo's ``mj_integratePos``."""
    found = qpos.copy()
    for joint, kind in enumerate(compiled.jnt_type.tolist()):
        at, dof = int(compiled.jnt_qposadr[joint]), int(compiled.jnt_dofadr[joint])
        if kind == FREE:
            found[at : at + 3] += time * qvel[dof : dof + 3]
            at, dof = at + 3, dof + 3
        if kind in (FREE, BALL):
            found[at : at + 4] = turned(unit(found[at : at + 4]), time * qvel[dof : dof + 3])
        else:
            found[at] += time * qvel[dof]
    return found
