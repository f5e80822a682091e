"""Freedoms of driven loops that nothing drives: they sag, collapse or swing however well the loops hold.

Of the motions N that the rows of a group admit, actuators with moments R drive as many as R N has independent rows.
What is left of a velocity without the part of least kinetic energy that moves the actuators as much is undriven,

    v = N c,    c_u = c − M_N⁻¹ (R N)ᵀ (R N M_N⁻¹ (R N)ᵀ)⁺ R v    with M_N = Nᵀ M N

How far it takes the bodies over the run tells whether it matters: a rod that turns between two balls about its own
axis takes nothing anywhere. Groups that one actuator moves together, by a tendon, are looked at together: it drives
their sum, and what is between them goes its own way.
"""

import copy
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.loops import Loops
from oarlock.diagnosis.loops.mobility import Mobility
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.diagnosis.runs.walking import own_copy, walk
from oarlock.mechanics.controls import drive
from oarlock.mechanics.engine_version import full_mass
from oarlock.mechanics.load import collected_warnings
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

TURNS = 0.1
"""rad: a free body that turns less by itself is not told."""

HEAVY = 1e4
"""Times its inertia: so much a free body gets that is not to turn."""

_RANK = 1e-6
"""Relative: of what drives a motion less than that, nothing does."""

_ONE = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_SLIDE, _FREE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_FREE)
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
class Coupling:
    """A joint equality, joint1 = offset + ratio · joint2, both counted from the model's own pose."""

    joint1: str
    joint2: str
    offset: float
    ratio: float

    @property
    def written(self) -> str:
        """As MJCF."""
        polynomial = f"{self.offset:.6g} {self.ratio:g} 0 0 0"
        return f'<joint joint1="{self.joint1}" joint2="{self.joint2}" polycoef="{polynomial}"/>'


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
        couplings: that keep it, in place of springs.
        turning: a free body that nothing drives turns, by ``turned`` rad in all; ``unturned``: how far the body goes
            in a run in which it does not turn, m; None: as far.
        together: joints of several groups that one actuator moves together; empty: it is about one group.
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
    couplings: tuple[Coupling, ...] = ()
    together: tuple[str, ...] = ()
    turning: str = ""
    turned: float = 0.0
    unturned: float | None = None


@dataclass
class _Ways:
    """How far undriven motions take joints (nv) and bodies (nbody), and turn these (nbody, rad), over a run."""

    joints: np.ndarray
    bodies: np.ndarray
    turns: np.ndarray


def find_undriven(
    recording: Recording,
    loops: Loops,
    mobility: tuple[Mobility, ...],
    size: float,
    coupled: Callable[[Sequence[Coupling]], mujoco.MjModel | None] = lambda _: None,
) -> tuple[Undriven, ...]:
    """Looks at the groups that an actuator drives.

    Args:
        recording: MuJoCo's run as configured, to its end.
        loops: at the closed start.
        mobility: of its groups.
        size: of the loops, m.
        coupled: makes the model with more couplings; None where that cannot be had.
    """
    model = recording.model
    if not model.nu or recording.end.how != "finished" or recording.steps < 2:
        return ()
    found = []
    freedom = {one.equalities: one.near for one in mobility if one.moves}
    for numbers in _together(recording, loops):
        near = sum(freedom.get(loops.groups[number].equalities, 0) for number in numbers)
        one = _Group(recording, loops, numbers, near) if near else None
        if one is None or one.driven >= near:
            continue
        # A pendulum on a string is what nothing drives, and what is pushed by others; a linkage is to be driven.
        pinned = any(loops.loops[member].equality.kind.joins_points for member in one.members)
        ways = one.ways(recording.qpos)
        if ways.bodies.max(initial=0.0) > FAR * size:
            made = _undriven(recording, one, ways, size, coupled)
            # What grips an object adapts to it: fingers on one tendon are to differ where they touch something.
            if numbers[1:] and made.falls <= FALLS and any(push.kind == "contact" for push in recording.pushes):
                continue
            if one.driven or (pinned and near == 1 and made.falls > FALLS):
                found.append(made)
    return tuple(found)


def _together(recording: Recording, loops: Loops) -> list[list[int]]:
    """Numbers of groups, those together that some actuator moves at once."""
    data = recording.restart(recording.model)
    data.qpos[:] = loops.qpos
    mujoco.mj_fwdPosition(recording.model, data)
    every = moments(recording.model, data)
    sets = [{number} for number in range(len(loops.groups))]
    for row in every:
        own = {number for number in range(len(loops.groups)) if np.any(row[loops.dofs(number)])}
        if len(own) > 1:
            joined = own.union(*(one for one in sets if one & own))
            sets = [one for one in sets if not one & own] + [joined]
    return sorted(sorted(one) for one in sets)


class _Group:
    """The motions of a group, or of several that share an actuator, at poses of a run."""

    def __init__(self, recording: Recording, loops: Loops, numbers: list[int], dof: int):
        self.model, self.dof = recording.model, dof
        self.parts = [loops.dofs(number) for number in numbers]
        self.dofs = sorted({at for dofs in self.parts for at in dofs})
        self.members = sorted({member for number in numbers for member in loops.members(number)})
        self.equalities = [name for number in numbers for name in loops.groups[number].equalities]
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
        joints, bodies, turns = np.zeros(model.nv), np.zeros(model.nbody), np.zeros(model.nbody)
        jacobian, rotation = np.zeros((2, 3, model.nv))
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
                mujoco.mj_jacBodyCom(model, data, jacobian, rotation, body)
                bodies[body] += float(np.linalg.norm(jacobian @ free))
                turns[body] += float(np.linalg.norm(rotation @ free))
        return _Ways(joints, bodies, turns)

    def _below(self, body: int) -> list[int]:
        """A body, and those that are rigidly joined to it."""
        return [body, *np.flatnonzero(self.model.body_weldid == body).tolist()]

    def load(self, motions: np.ndarray) -> np.ndarray:
        """What weight and springs do along motions at the present pose."""
        data = self._assembly.data
        data.qvel[:] = 0.0
        mujoco.mj_fwdVelocity(self._assembly.model, data)  # whose Jacobian is dense, as its data has it
        return motions @ (data.qfrc_passive - data.qfrc_bias)


def _undriven(
    recording: Recording,
    one: _Group,
    ways: _Ways,
    size: float,
    coupled: Callable[[Sequence[Coupling]], mujoco.MjModel | None],
) -> Undriven:
    model, loose = recording.model, one.dof - one.driven
    body = int(ways.bodies.argmax())
    drives = one.at(recording.qpos[0])[1][one.actuators]
    several = [sum(bool(np.any(row[part])) for part in one.parts) > 1 for row in drives]
    shared = [row for row, wide in zip(drives, several, strict=True) if wide]
    driven = {int(dof) for row, wide in zip(drives, several, strict=True) if not wide for dof in np.flatnonzero(row)}
    free = [dof for dof in one.dofs if dof not in driven]
    free = [dof for dof in free if model.jnt_type[model.dof_jntid[dof]] in _ONE]
    # Of what one tendon drives: those that it pulls come first, for they are what is to be coupled.
    pulled = {int(dof) for row in shared for dof in np.flatnonzero(row)}
    free.sort(key=lambda dof: (dof not in pulled, -ways.joints[dof] * (1.0 if _turns(model, dof) else 1.0 / size)))
    joints = [(_name(model, at), float(ways.joints[at]), "rad" if _turns(model, at) else "m") for at in free]
    weightless = copy.deepcopy(model)
    weightless.opt.gravity[:] = 0.0
    again = rerun(recording, weightless)
    rest = 1.0 if again is None else float(one.ways(again.qpos).bodies[body] / ways.bodies[body])
    springs: tuple[Spring, ...] = ()
    couplings, left = _coupled(recording, one, shared, body, coupled)
    if left is None or left > LEAVES * ways.bodies[body]:
        couplings = ()
        springs, left = _kept(recording, one, [dof for dof in free if dof not in pulled], size, body)
    kept = left is not None and left <= LEAVES * ways.bodies[body]
    turning, unturned = (-1, None) if free else _unturned(recording, one, ways, body)
    return Undriven(
        equality=one.equalities[0],
        others=tuple(one.equalities[1:]),
        dof=one.dof,
        driven=one.driven,
        actuators=tuple(element_name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, index) for index in one.actuators),
        joints=tuple(joints[: max(1, loose) + 1]),
        body=element_name(model, _BODY, body),
        way=float(ways.bodies[body]),
        falls=max(0.0, 1.0 - rest),
        springs=springs if kept else (),
        left=left if kept else None,
        couplings=couplings if kept else (),
        turning=element_name(model, _BODY, turning) if turning >= 0 else "",
        turned=float(ways.turns[turning]) if turning >= 0 else 0.0,
        unturned=unturned,
        together=tuple(_name(model, dof) for dof in sorted(pulled)) if one.parts[1:] else (),
    )


def _unturned(recording: Recording, one: _Group, ways: _Ways, body: int) -> tuple[int, float | None]:
    """The free body of a group that turns most, and how far another goes in a run in which it hardly turns."""
    model = copy.deepcopy(recording.model)
    joints = {int(model.dof_jntid[dof]) for dof in one.dofs}
    bodies = {int(model.jnt_bodyid[joint]): joint for joint in joints if model.jnt_type[joint] == _FREE}
    turning = max(bodies, key=lambda each: float(ways.turns[each]), default=-1)
    if turning < 0 or ways.turns[turning] <= TURNS:
        return -1, None
    first = int(model.jnt_dofadr[bodies[turning]]) + 3
    model.dof_armature[first : first + 3] += HEAVY * float(model.body_inertia[turning].max())
    again = rerun(recording, model)
    left = None if again is None else float(one.ways(again.qpos).bodies[body])
    return turning, left if left is not None and left <= LEAVES * ways.bodies[body] else None


def _coupled(
    recording: Recording,
    one: _Group,
    shared: list[np.ndarray],
    body: int,
    coupled: Callable[[Sequence[Coupling]], mujoco.MjModel | None],
) -> tuple[tuple[Coupling, ...], float | None]:
    """Couplings of what one actuator pulls in several groups, and how far the body goes in a run with them.

    Each joint follows the first of them, as far as that moves and in the direction in which the actuator pulls both.
    """
    model = recording.model
    if len(shared) != 1 or len(one.parts) - 1 != one.dof - one.driven:
        return (), None
    pulled = [[int(dof) for dof in part if shared[0][dof]] for part in one.parts]
    if any(len(dofs) != 1 or model.jnt_type[model.dof_jntid[dofs[0]]] not in _ONE for dofs in pulled):
        return (), None
    first, *others = [dofs[0] for dofs in pulled]
    found = []
    for dof in others:
        ratio = math.copysign(1.0, shared[0][first] * shared[0][dof])
        places = [int(model.jnt_qposadr[model.dof_jntid[at]]) for at in (first, dof)]
        moved = [float(recording.qpos[0, place] - model.qpos0[place]) for place in places]
        offset = moved[0] - ratio * moved[1]
        found.append(Coupling(_name(model, first), _name(model, dof), 0.0 if abs(offset) < 1e-9 else offset, ratio))
    with_them = coupled(found)
    if with_them is None:
        return (), None
    with_them = own_copy(with_them)
    data = recording.restart(with_them)
    with np.errstate(all="ignore"), collected_warnings():
        poses = [data.qpos.copy() for _ in walk(with_them, data, drive(with_them, recording.laws), recording.steps)]
    if len(poses) < recording.steps or not np.isfinite(poses[-1]).all():
        return (), None
    return tuple(found), float(one.ways(np.array(poses)).bodies[body])


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
