"""The two ends of a loop that is to be closed: frames that bodies carry, by the names of sites, frames or bodies."""

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import mujoco
import numpy as np

from oarlock.base.errors import InputError, few, one_line
from oarlock.diagnosis.edit.changes import free_name
from oarlock.mechanics.load import collected_warnings
from oarlock.mechanics.names import element_name

_SITE, _BODY = mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_BODY

_LISTED = 8
"""Names of a message at most, where none is spelt alike."""


@dataclass(frozen=True)
class End:
    """A frame that a body carries.

    Attributes:
        name: what it was called.
        body: number of the body; 0: the world.
        pos: its origin in the body's frame, (3), m; quat: its axes there.
        site: name of the site that it is; empty: there is none yet.
        moving: whether it was named as a body that is more than a frame, so that a point of it has to be chosen.
    """

    name: str
    body: int
    pos: np.ndarray
    quat: np.ndarray
    site: str = ""
    moving: bool = False

    def world(self, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
        """Its origin (3) and axes, a quaternion, in the world."""
        position, turned = np.zeros(3), np.zeros(4)
        mujoco.mju_rotVecQuat(position, self.pos, data.xquat[self.body])
        mujoco.mju_mulQuat(turned, data.xquat[self.body], self.quat)
        return data.xpos[self.body] + position, turned

    def along(self, distance: float) -> np.ndarray:
        """The point on its z axis at a distance, in the body's frame, (3), m."""
        axis = np.zeros(3)
        mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, distance]), self.quat)
        return self.pos + axis


class Ends:
    """Finds ends in a model by name.

    Args:
        path: MJCF file, which is sound.
    """

    def __init__(self, path: Path):
        with collected_warnings():
            self._spec = mujoco.MjSpec.from_file(str(path))
            self._sites = [site.name for site in self._spec.sites if site.name]
            self._frames = [frame.name for frame in self._spec.frames if frame.name]
            self._bodies = [body.name for body in self._spec.bodies if body.name]
        self._taken = {*self._sites}

    @property
    def names(self) -> list[str]:
        """Every name of a site, a frame or a body."""
        return list(dict.fromkeys([*self._sites, *self._frames, *self._bodies]))

    def find(self, names: Sequence[str]) -> list[End]:
        """The ends of some names: of a site before a frame, and of that before a body.

        Raises:
            InputError: nothing is called so.
        """
        for name in names:
            self._require(name)
        probes = []
        for name in names:
            if name in self._sites:
                probes.append(name)
                continue
            probe = free_name("probe", {*self._taken})
            self._taken.add(probe)
            probes.append(probe)
            self._add_probe(name, probe)
        try:
            with collected_warnings():
                model = self._spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise InputError(f"MuJoCo refuses the model with a site more: {one_line(error)}") from None
        return [self._end(model, name, probe) for name, probe in zip(names, probes, strict=True)]

    def _require(self, name: str) -> None:
        every = self.names
        if name not in every:
            alike = get_close_matches(name, every, n=4)
            expected = few(alike, "or") or (f"one of: {few(every, most=_LISTED)}" if every else "names in the model")
            raise InputError(f"no site, frame or body '{name}', expected {expected}")

    def _add_probe(self, name: str, probe: str) -> None:
        if name in self._frames:
            frame = self._spec.frame(name)
            site = frame.parent.add_site(name=probe)
            site.set_frame(frame)
        else:
            self._spec.body(name).add_site(name=probe)

    def _end(self, model: mujoco.MjModel, name: str, probe: str) -> End:
        site = mujoco.mj_name2id(model, _SITE, probe)
        moving = False
        if probe != name and name not in self._frames:
            moving = not _is_frame(self._spec.body(name))
        return End(
            name,
            int(model.site_bodyid[site]),
            model.site_pos[site].copy(),
            model.site_quat[site].copy(),
            name if probe == name else "",
            moving,
        )


def _is_frame(body: mujoco.MjsBody) -> bool:
    """Whether a body is only a name for a place, as frames are in URDF: nothing but perhaps an inertia is there."""
    return bool(body.name != "world" and not body.joints and not body.geoms and not body.bodies)


def as_drawn(model: mujoco.MjModel, first: End, second: End, at: Sequence[float] | None) -> tuple[End, End]:
    """Two ends that meet in the model's own pose: at a point (3), world, or at the second one's origin.

    Their axes are those of the second one.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    origin, turned = second.world(data)
    point = origin if at is None else np.asarray(at, dtype=float)
    found = []
    for end in (first, second):
        inverse, pos, quat = np.zeros(4), np.zeros(3), np.zeros(4)
        mujoco.mju_negQuat(inverse, data.xquat[end.body])
        mujoco.mju_rotVecQuat(pos, point - data.xpos[end.body], inverse)
        mujoco.mju_mulQuat(quat, inverse, turned)
        found.append(End(end.name, end.body, pos, quat))
    return found[0], found[1]


def require_apart(model: mujoco.MjModel, first: End, second: End) -> None:
    """Checks that two ends can move against each other.

    Raises:
        InputError: they are parts of one body.
    """
    if model.body_weldid[first.body] == model.body_weldid[second.body]:
        name = element_name(model, _BODY, int(model.body_weldid[first.body]))
        raise InputError(
            f"'{first.name}' and '{second.name}' are parts of one body, '{name}', expected two that can move apart"
        )
