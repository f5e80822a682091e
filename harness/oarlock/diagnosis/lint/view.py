"""A model at its start as lints look at it, and what they have to say of it."""

import copy
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import mujoco
import numpy as np

from oarlock.diagnosis.loops.held import Held, find_held
from oarlock.diagnosis.loops.loops import Group, Loops, loops_at
from oarlock.diagnosis.loops.mobility import Tilt, find_mobility, find_tilts
from oarlock.diagnosis.loops.poses import ClosedPose
from oarlock.mechanics.load import collected_warnings
from oarlock.mechanics.names import Equality, element_name, equalities
from oarlock.mechanics.servos import moments
from oarlock.poses.assembly import Assembly

BODY, JOINT, TENDON = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_TENDON


@dataclass(frozen=True)
class Remark:
    """Something that a lint has to say: a finding that does not know its file.

    Attributes:
        code: of the catalogue.
        line: one line with figures and units.
        element: name of the equality or other element; empty: the model as a whole.
        severity: None: that of the catalogue.
        figures: the same for a program.
    """

    code: str
    line: str
    element: str = ""
    severity: Literal["error", "warning", "note"] | None = None
    figures: dict[str, Any] = field(default_factory=dict)


class View:
    """A model at one pose.

    Attributes:
        model: the user's; left alone.
        data: its own data at the start; all that belongs to a position is valid. Its controls are those of the run
            as far as they are constant, else 0.
        equalities: those that are active there.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, pose: ClosedPose | None = None):
        """Looks at the state of a data; with ``pose`` the loops need not be found again."""
        self.model, self.data, self._pose = model, mujoco.MjData(model), pose
        self.data.qpos[:], self.data.qvel[:], self.data.eq_active[:] = data.qpos, data.qvel, data.eq_active
        self.data.mocap_pos[:], self.data.mocap_quat[:] = data.mocap_pos, data.mocap_quat
        self.data.ctrl[:] = data.ctrl
        with collected_warnings():  # what MuJoCo's memory does not suffice for, the run tells
            mujoco.mj_fwdPosition(model, self.data)
            mujoco.mj_fwdVelocity(model, self.data)
        off = mujoco.mjtDisableBit.mjDSBL_EQUALITY | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        every = [] if model.opt.disableflags & off else equalities(model)
        self.equalities: list[Equality] = [one for one in every if data.eq_active[one.index]]

    @property
    def posed(self) -> bool:
        """Whether the closed pose near the start was looked for."""
        return self._pose is not None

    @cached_property
    def given(self) -> Assembly:
        """Of the loops, at the start itself."""
        assembly = Assembly(self.model, self.data)
        assembly.place(self.data.qpos)
        return assembly

    @cached_property
    def assembly(self) -> Assembly:
        """Of the loops, at the closed pose near the start if there is one."""
        assembly = Assembly(self.model, self.data)
        if self._pose is not None:
            assembly.place(self._pose.qpos)
        return assembly

    @cached_property
    def loops(self) -> Loops:
        """At that pose."""
        if self._pose is not None:
            return self._pose.loops
        return loops_at(self.assembly, self.assembly.close(), dependent=False)

    @cached_property
    def held(self) -> tuple[Held, ...]:
        """What an actuator drives and equalities hold at that pose; not what a constant or a mocap body holds."""
        if not self.model.nu or not self.equalities or not self.loops.closed:
            return ()
        driven = np.flatnonzero(moments(self.model, self.data).any(axis=0))
        found = find_held(self.assembly, self.loops, driven.tolist())
        return tuple(one for one in found if not self._meant(one))

    def _meant(self, one: Held) -> bool:
        own = [self.loops.loops[member] for member in one.members]
        mocap = any(self.model.body_mocapid[body] >= 0 for loop in own for body in loop.equality.bodies)
        return mocap or all(len(loop.path.joints) <= 1 for loop in own)

    def joints(self, dofs: Iterable[int]) -> list[str]:
        """Names of the joints of some degrees of freedom, each once."""
        return [*dict.fromkeys(element_name(self.model, JOINT, int(self.model.dof_jntid[dof])) for dof in dofs)]

    def freedom(
        self, group: Group, one: Equality, change: Callable[[mujoco.MjModel, mujoco.MjData, Equality], None]
    ) -> int:
        """Degrees of freedom that a group truly has with one of its equalities changed, in a copy of the model."""
        model, data = copy.copy(self.model), mujoco.MjData(self.model)
        data.qpos[:] = self.loops.qpos
        data.eq_active[:] = self.data.eq_active
        data.mocap_pos[:], data.mocap_quat[:] = self.data.mocap_pos, self.data.mocap_quat
        change(model, data, one)
        assembly = Assembly(model, data)
        if not assembly.close():
            return 0
        loops = loops_at(assembly, dependent=False)
        # By their numbers: a weld without a name is called another way as a connect.
        own = {loop.equality.index for loop in self.loops.loops if loop.name in group.equalities}
        names = {loop.name for loop in loops.loops if loop.equality.index in own}
        return sum(each.near for each in find_mobility(assembly, loops) if each.moves and names & {*each.equalities})

    def tilts(self, names: set[str]) -> tuple[Tilt, ...]:
        """Joints of some loops that alone are not in the plane of most."""
        return find_tilts(self.assembly, names)

    def around(self, joints: Iterable[int]) -> list[str]:
        """Names of the equalities whose loops, or those that share joints with them, pass one of some joints."""
        if not self.equalities:
            return []
        names = {element_name(self.model, JOINT, joint) for joint in joints}
        return [name for group in self.loops.groups if names & {*group.joints} for name in group.equalities]

    def body(self, index: int) -> str:
        """Name of a body."""
        return element_name(self.model, BODY, index)

    def geoms_of(self, body: int) -> np.ndarray:
        """Numbers of the geoms of a body and of what is welded to it by having no joint; of the world's its own."""
        model = self.model
        if body == 0:
            return np.flatnonzero(model.geom_bodyid == 0)
        return np.flatnonzero(model.body_weldid[model.geom_bodyid] == model.body_weldid[body])

    @cached_property
    def size(self) -> float:
        """Of the mechanism, m: half the diagonal of a box around all bodies' origins, centres of mass and joints."""
        data = self.data
        points = [data.xpos[1:], data.xipos[1:], data.xanchor]
        every = np.vstack([part for part in points if len(part)])
        return 0.5 * float(np.linalg.norm(every.max(axis=0) - every.min(axis=0)))


def told(value: float) -> str:
    """A length or angle for a line, three digits."""
    return f"{value:.3g}"


def point(values: np.ndarray) -> str:
    """A point for a line, as in a file."""
    return f"({' '.join(f'{0.0 if abs(value) < 5e-7 else value:.4g}' for value in values)})"
