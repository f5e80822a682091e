"""Freedoms of driven loops that nothing drives: they sag, collapse or swing however well the loops hold.

Of the motions N that the rows of a group admit, actuators with moments R drive as many as R N has independent rows.
What is left of a velocity without the part of least kinetic energy that moves the actuators as much is undriven,

    v = N c,    c_u = c − M_N⁻¹ (R N)ᵀ (R N M_N⁻¹ (R N)ᵀ)⁺ R v    with M_N = Nᵀ M N

How far it takes the bodies over the run tells whether it matters: a rod that turns between two balls about its own
axis takes nothing anywhere.
"""

import copy
import itertools
import math
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.loops import Group, Loops
from oarlock.diagnosis.loops.mobility import Mobility
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.mechanics.engine_version import full_mass
from oarlock.mechanics.names import element_name
from oarlock.mechanics.servos import moments
from oarlock.poses.assembly import Assembly

SAMPLES = 60
"""Poses of the run that are looked at."""

FAR = 0.1
"""Of the mechanism's size: a body that undriven motions take less far hardly shows."""

SAG = 0.05
"""rad, or of the mechanism's size on a slide: what a stiffness that is tried leaves under the load at the start."""

SWING_HZ = 3.0
"""At least, of a stiffness that is tried where no load asks for one."""

FALLS = 0.5
"""Of the way of a group that nothing drives: so much of it is to be its weight's."""

LEAVES = 0.5
"""Of the way: with a stiffness that is named less is left."""

_RANK = 1e-6
"""Relative: of what drives a motion less than that, nothing does."""

_ONE = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)
_JOINT, _BODY = mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_BODY


@dataclass(frozen=True)
class Spring:
    """A joint spring that keeps an undriven freedom.

    Attributes:
        joint: its name; stiffness, damping: of it, per rad or m; reference: where it rests, rad or m.
    """

    joint: str
    stiffness: float
    damping: float
    reference: float
    slides: bool


@dataclass(frozen=True)
class Undriven:
    """A group of loops with more freedom than drives.

    Attributes:
        equality: one of it; others: the rest.
        dof, driven: how many degrees of freedom it has, and how many of them actuators drive.
        actuators: names of those.
        joints: those that no actuator drives and that move most in it, with how far they go, rad or m.
        body: that goes furthest; way: how far, m.
        falls: part of the way that is gone without gravity.
        springs: that keep it; left: the way of the body in a run with them, m; None: they do not, or were not tried.
    """

    equality: str
    others: tuple[str, ...]
    dof: int
    driven: int
    actuators: tuple[str, ...]
    joints: tuple[tuple[str, float, str], ...]
    body: str
    way: float
    falls: float
    springs: tuple[Spring, ...] = ()
    left: float | None = None


@dataclass
class _Ways:
    """How far undriven motions take joints (nv) and bodies (nbody) over a run."""

    joints: np.ndarray
    bodies: np.ndarray


def find_undriven(
    recording: Recording, loops: Loops, mobility: tuple[Mobility, ...], size: float
) -> tuple[Undriven, ...]:
    """Looks at the groups that an actuator drives.

    Args:
        recording: MuJoCo's run as configured, to its end.
        loops: at the closed start.
        mobility: of its groups.
        size: of the loops, m.
    """
    model = recording.model
    if not model.nu or recording.end.how != "finished" or recording.steps < 2:
        return ()
    found = []
    for number, group in enumerate(loops.groups):
        near = next((one.near for one in mobility if one.equalities == group.equalities and one.moves), 0)
        one = _Group(recording, loops, number, near) if near else None
        if one is None or one.driven >= near:
            continue
        # A pendulum on a string is what nothing drives, and what is pushed by others; a linkage is to be driven.
        pinned = any(loops.loops[member].equality.kind.joins_points for member in loops.members(number))
        ways = one.ways(recording.qpos)
        if ways.bodies.max(initial=0.0) > FAR * size:
            made = _undriven(recording, one, group, near, ways, size)
            if one.driven or (pinned and near == 1 and made.falls > FALLS):
                found.append(made)
    return tuple(found)


class _Group:
    """A group's motions at poses of a run."""

    def __init__(self, recording: Recording, loops: Loops, number: int, dof: int):
        self.model = recording.model
        self.dofs, self.members, self.dof = loops.dofs(number), loops.members(number), dof
        data = recording.restart(self.model)
        recording.layout.activate(data)  # a flex is left as MuJoCo has it
        self._assembly = Assembly(self.model, data)
        self._free = len(self.dofs) - dof
        motions, drives = self.at(loops.qpos)
        sizes = np.linalg.svd(drives @ motions.T, compute_uv=False)
        scale = float(np.linalg.norm(drives, axis=1).max(initial=0.0))
        self.driven = int((sizes > _RANK * scale).sum()) if scale else 0
        self.actuators = [int(one) for one in np.flatnonzero(np.abs(drives @ motions.T).max(axis=1) > _RANK * scale)]

    def at(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Motions (dof, nv) that the rows admit, and moments of the actuators (nu, nv)."""
        self._assembly.place(pose)
        rows = self._assembly.jacobian()[self._assembly.rows_of_all(self.members)][:, self.dofs]
        motions = np.zeros((self.dof, self.model.nv))
        motions[:, self.dofs] = np.linalg.svd(rows)[2][self._free :]
        return motions, moments(self.model, self._assembly.data)

    def undriven(self, motions: np.ndarray, drives: np.ndarray) -> np.ndarray:
        """A projector (dof, dof) of the coefficients of motions to those that no actuator drives."""
        mass = motions @ full_mass(self.model, self._assembly.data) @ motions.T
        moved = drives @ motions.T
        free = np.linalg.solve(mass, moved.T)
        return np.eye(len(mass)) - free @ np.linalg.pinv(moved @ free, rcond=_RANK, hermitian=True) @ moved

    def ways(self, poses: np.ndarray) -> _Ways:
        """Over a run (T, nq)."""
        model, data = self._assembly.model, self._assembly.data
        poses = poses[np.unique(np.linspace(0, len(poses) - 1, SAMPLES).astype(int))]
        joints, bodies = np.zeros(model.nv), np.zeros(model.nbody)
        jacobian = np.zeros((3, model.nv))
        own = sorted({body for dof in self.dofs for body in self._below(int(model.dof_bodyid[dof]))})
        for here, there in itertools.pairwise(poses):
            if not np.isfinite(there).all():
                break
            motions, drives = self.at(here)
            change = np.zeros(model.nv)
            mujoco.mj_differentiatePos(model, change, 1.0, here, there)
            mass = motions @ full_mass(model, data)
            along = np.linalg.solve(mass @ motions.T, mass[:, self.dofs] @ change[self.dofs])
            free = motions.T @ (self.undriven(motions, drives) @ along)
            joints += np.abs(free)
            for body in own:
                mujoco.mj_jacBodyCom(model, data, jacobian, None, body)
                bodies[body] += float(np.linalg.norm(jacobian @ free))
        return _Ways(joints, bodies)

    def _below(self, body: int) -> list[int]:
        """A body, and those that are rigidly joined to it."""
        return [body, *np.flatnonzero(self.model.body_weldid == body).tolist()]

    def load(self, motions: np.ndarray) -> np.ndarray:
        """What weight and springs do along motions at the present pose."""
        data = self._assembly.data
        data.qvel[:] = 0.0
        mujoco.mj_fwdVelocity(self._assembly.model, data)  # whose Jacobian is dense, as its data has it
        return motions @ (data.qfrc_passive - data.qfrc_bias)


def _undriven(recording: Recording, one: _Group, group: Group, dof: int, ways: _Ways, size: float) -> Undriven:
    model = recording.model
    body = int(ways.bodies.argmax())
    driven = {int(dof) for index in one.actuators for dof in np.flatnonzero(one.at(recording.qpos[0])[1][index])}
    free = [dof for dof in one.dofs if dof not in driven]
    free = [dof for dof in free if model.jnt_type[model.dof_jntid[dof]] in _ONE]
    free.sort(key=lambda dof: -ways.joints[dof] * (1.0 if _turns(model, dof) else 1.0 / size))
    joints = [(_name(model, at), float(ways.joints[at]), "rad" if _turns(model, at) else "m") for at in free]
    weightless = copy.deepcopy(model)
    weightless.opt.gravity[:] = 0.0
    again = rerun(recording, weightless)
    rest = 1.0 if again is None else float(one.ways(again.qpos).bodies[body] / ways.bodies[body])
    springs, left = _kept(recording, one, free, size, body)
    kept = left is not None and left <= LEAVES * ways.bodies[body]
    return Undriven(
        equality=group.equalities[0],
        others=group.equalities[1:],
        dof=dof,
        driven=one.driven,
        actuators=tuple(element_name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, index) for index in one.actuators),
        joints=tuple(joints[: max(1, dof - one.driven) + 1]),
        body=element_name(model, _BODY, body),
        way=float(ways.bodies[body]),
        falls=max(0.0, 1.0 - rest),
        springs=springs if kept else (),
        left=left if kept else None,
    )


def _kept(
    recording: Recording, one: _Group, free: list[int], size: float, body: int
) -> tuple[tuple[Spring, ...], float | None]:
    """Springs on as many joints as there are undriven freedoms, and how far the body goes in a run with them."""
    model = copy.deepcopy(recording.model)
    motions, drives = one.at(recording.qpos[0])
    basis = np.linalg.svd(one.undriven(motions, drives))[0][:, : one.dof - one.driven]
    motions = basis.T @ motions
    mass = motions @ full_mass(model, one._assembly.data) @ motions.T
    load = one.load(motions)
    chosen: list[int] = []
    for dof in free:
        held = np.linalg.svd(motions[:, [*chosen, dof]], compute_uv=False)
        if held[-1] > 0.05 * np.abs(motions).max() and len(chosen) < len(motions):
            chosen.append(dof)
    if len(chosen) < len(motions):
        return (), None
    springs = []
    moved = motions[:, chosen]
    torque = np.linalg.solve(moved, load)  # of the joints, that bears the load
    inertia = np.linalg.inv(moved) @ mass @ np.linalg.inv(moved).T
    for place, dof in enumerate(chosen):
        reach = SAG if _turns(model, dof) else SAG * size
        inert = float(inertia[place, place])
        stiffness = max(abs(float(torque[place])) / reach, inert * (2.0 * math.pi * SWING_HZ) ** 2)
        stiffness = float(f"{1.05 * stiffness:.2g}")
        damping = float(f"{math.sqrt(stiffness * inert):.2g}")
        joint = int(model.dof_jntid[dof])
        reference = float(recording.qpos[0, model.jnt_qposadr[joint]])
        model.jnt_stiffness.reshape(model.njnt, -1)[joint, 0] = stiffness
        model.qpos_spring[model.jnt_qposadr[joint]] = reference
        model.dof_damping.reshape(model.nv, -1)[dof, 0] += damping
        springs.append(Spring(_name(model, dof), stiffness, damping, reference, not _turns(model, dof)))
    again = rerun(recording, model)
    return tuple(springs), None if again is None else float(one.ways(again.qpos).bodies[body])


def _turns(model: mujoco.MjModel, dof: int) -> bool:
    return model.jnt_type[model.dof_jntid[dof]] != _SLIDE


def _name(model: mujoco.MjModel, dof: int) -> str:
    return element_name(model, _JOINT, int(model.dof_jntid[dof]))
