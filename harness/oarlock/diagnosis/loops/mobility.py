"""Whether a closed mechanism can move, and what keeps it from moving.

Closed is not enough: a mechanism whose lengths are a little off may close in one pose and be locked there. So a closed
pose is left by a small step along every motion that its rows admit, and closed again: a real motion gets away, one that
the rows admit at this pose only snaps back.
"""

import copy
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.loops import Loops, scaled_rows
from oarlock.diagnosis.loops.rank import block_scales, spectrum
from oarlock.diagnosis.loops.release import find_release
from oarlock.mechanics.names import element_name
from oarlock.poses.assembly import Assembly
from oarlock.poses.paths import PARALLEL, path_of

PROBE = 0.02
"""rad or m. A step along a motion, longer than what separates a double root from two, shorter than a limb."""

GETS_AWAY = 0.1
"""Of that step: who is left with less was pulled back. Closing moves what is light, and straightens half of a chain."""

TILTED = 0.5
"""rad. A hinge that stands further off the others' axis is not meant to be parallel to them."""

_JOINT = mujoco.mjtObj.mjOBJ_JOINT
_SLIDE, _HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)


@dataclass(frozen=True)
class Tilt:
    """A hinge or slide that alone keeps a loop from being planar.

    Attributes:
        joint: its name.
        equality: that closes the loop.
        radians: between its axis and where the others want it.
    """

    joint: str
    equality: str
    radians: float
    axis: tuple[float, ...] = ()


@dataclass(frozen=True)
class Mobility:
    """Whether a group of equalities can move at a closed pose.

    Attributes:
        equalities: of the group.
        dof: degrees of freedom of its rows at the pose.
        near: the fewest at closed poses around it: ``dof`` unless the pose is singular.
        moves: whether there are such poses: with False it is locked, whatever the rows say.
        kept: smallest singular value of its rank, of the largest: a mechanism that is locked because of a small error
            has a small one.
        rigid: the same of the geometry alone, whatever the masses: the rows of each block to a longest one of length 1,
            then every column to length 1.
        dofs: degrees of freedom that the group takes hold of.
        frees: equalities without which it would have a degree of freedom.
        slide: along what the pin of the only one would have to slide for it to move, in words; empty: nothing of it.
    """

    equalities: tuple[str, ...]
    dof: int
    near: int
    moves: bool
    kept: float
    frees: tuple[str, ...]
    slide: str = ""
    rigid: float = 0.0
    dofs: tuple[int, ...] = ()

    @property
    def locked(self) -> bool:
        """Whether nothing of it can move."""
        return not self.moves

    @property
    def singular(self) -> bool:
        """Whether more motions are admitted here than around."""
        return self.moves and self.dof > self.near


def find_mobility(assembly: Assembly, loops: Loops) -> tuple[Mobility, ...]:
    """How every group can move from the present pose, which is closed and of these loops; the pose is kept.

    Equalities between ends that no joint moves are left out: they have nothing to lock.
    """
    pose = assembly.data.qpos.copy()
    found = []
    for number, group in enumerate(loops.groups):
        if not group.dofs:
            continue
        members = loops.members(number)
        reached = list(reached_from(assembly, admitted(assembly, members, loops.dofs(number), pose), pose))
        moves = bool(reached)
        near = min([group.dof, *(group.dofs - _rank_of(assembly, members, there) for there in reached)])
        freed = {one for one in members if loops.loops[one].freed}
        if not moves and group.dof:  # ranks tell what is admitted here, and not what gets away
            freed |= {one for one in members if _moves_without(assembly, members, loops.dofs(number), one, pose)}
        frees = tuple(loops.loops[one].name for one in members if one in freed)
        slide = "" if moves or len(members) > 1 else find_release(assembly, members[0], loops.dofs(number), pose)
        stiff = 0.0 if moves else rigidity(assembly, members, loops.dofs(number), pose)
        shape = group.spectrum.kept, frees, slide, stiff, tuple(loops.dofs(number))
        found.append(Mobility(group.equalities, group.dof, near, moves, *shape))
    assembly.place(pose)
    return tuple(found)


def rigidity(assembly: Assembly, members: list[int], dofs: list[int], pose: np.ndarray) -> float:
    """Smallest singular value of the rank of some equalities, of the largest, by their geometry alone.

    A heavy link makes it small in the metric of the masses, and a torquescale in that of the rows.
    """
    assembly.place(pose)
    jacobian = assembly.jacobian()
    scales = block_scales(np.linalg.norm(jacobian, axis=1), assembly.blocks)
    rows = (scales[:, None] * jacobian)[assembly.rows_of_all(members)][:, dofs]
    lengths = np.linalg.norm(rows, axis=0)
    return spectrum(np.linalg.svd(rows[:, lengths > 0.0] / lengths[lengths > 0.0], compute_uv=False)).kept


def reached_from(assembly: Assembly, motions: np.ndarray, pose: np.ndarray) -> Iterator[np.ndarray]:
    """Closed poses (nq) apart from a pose, along some motions (k, nv).

    Each motion and one of them all, both ways: at a singular pose a mixture of branches leads nowhere.
    """
    for motion in [*motions, motions.sum(axis=0)] if len(motions) else []:
        for step in (PROBE, -PROBE):
            there = pose.copy()
            mujoco.mj_integratePos(assembly.model, there, step * motion / np.abs(motion).max(), 1.0)
            assembly.place(there)
            if assembly.close() and np.abs(assembly.difference(pose, assembly.data.qpos)).max() > GETS_AWAY * PROBE:
                yield assembly.data.qpos.copy()


def _moves_without(assembly: Assembly, members: list[int], dofs: list[int], one: int, pose: np.ndarray) -> bool:
    """Whether the equalities of a group get away from a pose when one of them is left out."""
    own = copy.copy(assembly.data)
    own.qpos[:] = pose
    own.eq_active[assembly.equalities[one].index] = 0
    rest = Assembly(assembly.model, own)
    rest.place(pose)
    names = {assembly.equalities[member].name for member in members if member != one}
    left = [place for place, equality in enumerate(rest.equalities) if equality.name in names]
    return any(True for _ in reached_from(rest, admitted(rest, left, dofs, pose), pose))


def _rank_of(assembly: Assembly, members: list[int], pose: np.ndarray) -> int:
    """The rank of some equalities at a pose."""
    assembly.place(pose)
    rows = assembly.rows_of_all(members)
    scaled, _ = scaled_rows(assembly, assembly.jacobian())
    return spectrum(np.linalg.svd(scaled[rows], compute_uv=False)).rank


def admitted(assembly: Assembly, members: list[int], dofs: list[int], pose: np.ndarray) -> np.ndarray:
    """A basis (dof, nv) of the velocities that the rows of some equalities admit to the joints of their group."""
    assembly.place(pose)
    rows = assembly.jacobian()[assembly.rows_of_all(members)][:, dofs]
    scaled, _ = scaled_rows(assembly, assembly.jacobian())
    rank = spectrum(np.linalg.svd(scaled[assembly.rows_of_all(members)], compute_uv=False)).rank if members else 0
    kept = np.linalg.svd(rows)[2][rank:] if members else np.eye(len(dofs))
    motions = np.zeros((len(kept), assembly.model.nv))
    motions[:, dofs] = kept
    return motions


# Tilted axes.


def find_tilts(assembly: Assembly, names: set[str]) -> tuple[Tilt, ...]:
    """Joints of some loops that alone are not in the plane of most, with the axes of the model's own pose.

    There the author drew them; in another pose a tilted crank turns the axes after it too.
    """
    if not names:
        return ()
    model, own = assembly.model, mujoco.MjData(assembly.model)
    own.mocap_pos[:], own.mocap_quat[:] = assembly.data.mocap_pos, assembly.data.mocap_quat
    mujoco.mj_kinematics(model, own)
    found: dict[str, Tilt] = {}
    for equality in assembly.equalities:
        path = path_of(model, own, equality)
        hinges = [joint for joint in path.joints if model.jnt_type[joint] == _HINGE]
        if equality.name not in names or path.shape != "spatial" or len(hinges) < 3:
            continue
        axes = own.xaxis[hinges]
        off = np.linalg.norm(np.cross(axes[:, None], axes[None]), axis=2)
        normal = int((off <= PARALLEL).sum(axis=1).argmax())
        if 2 * int((off[normal] <= PARALLEL).sum()) <= len(hinges):
            continue
        angles = dict(zip(hinges, np.arcsin(np.minimum(off[normal], 1.0)).tolist(), strict=True))
        for joint in path.joints:
            if model.jnt_type[joint] == _SLIDE:
                angles[joint] = float(np.arcsin(min(1.0, abs(float(own.xaxis[joint] @ axes[normal])))))
        for joint, angle in angles.items():
            if PARALLEL < angle <= TILTED:
                name = element_name(model, _JOINT, joint)
                turns = model.jnt_type[joint] == _HINGE
                axis = _parallel(model, own, joint, axes[normal]) if turns else ()
                found.setdefault(name, Tilt(name, equality.name, angle, axis))
    return tuple(found.values())


def _parallel(model: mujoco.MjModel, data: mujoco.MjData, joint: int, along: np.ndarray) -> tuple[float, ...]:
    """The axis of a joint, in the frame of its body, that is parallel to a direction (3) of the world."""
    axis = data.xmat[model.jnt_bodyid[joint]].reshape(3, 3).T @ along
    axis *= 1.0 if axis @ model.jnt_axis[joint] >= 0.0 else -1.0
    return tuple(np.round(axis, 9).tolist())
