"""Which forces between the parts of a closed chain a rigid model determines, direction by direction.

Multipliers that differ by a null vector n of Jᵀ give the same motion. What such a difference makes of the force and the
torque that go through an equality, F n, is what nobody can know: with a basis N of null(Jᵀ), range(F N) are the
directions that are free, and its orthogonal complement those that are unique (Frączek & Wojtyra, Mechanism and Machine
Theory 46 (2011) 312–334). Only the range is used, which is the same for every basis.

- Equalities between the same two bodies are one joint: two connects make a hinge, and how the force along their line is
  shared by the two is a question of the modelling. So they are also looked at together, as one force and torque about
  the middle of their anchors.
- A joint of the tree carries what the loops put on the bodies beyond it.
- Across the plane of a planar loop nothing holds and nothing is held: those directions are *idle*, neither unique nor
  free. The same goes for rows that are zero, for the torque about a hinge, for the force along a slide.

Directions turn with the mechanism. They are told in the frame, of the world or of one of the two bodies, in which they
turn least along the motion.
"""

from dataclasses import dataclass
from itertools import groupby
from typing import Literal

import mujoco
import numpy as np

from oarlock.base.vectors import crossed
from oarlock.cases.case_file import Reactions
from oarlock.diagnosis.loops.directions import WORLD, Directions, told
from oarlock.diagnosis.loops.forces import BodyWrench, body_wrenches
from oarlock.diagnosis.loops.loops import Group, Loops, loops_at
from oarlock.mechanics.names import element_name
from oarlock.mechanics.reactions import VANISHES
from oarlock.poses.assembly import Assembly

SAMPLES = 24
"""So many poses of a motion at most, equally spaced, are closed and looked at."""

FEWEST, WORK = 8, 2_000_000
"""Of many rows they are fewer: so many numbers of J in all, but no fewer poses than that."""

AROUND = 0.3
"""rad or m. Without a motion, so far from the start are the poses that are looked at."""

WIDE = 30
"""Beyond so many vectors of three components their range is that of their 3 × 3 matrix of products, which squares do no
harm: what counts is tenths, or rounding far below ``VANISHES``."""

_BODY = mujoco.mjtObj.mjOBJ_BODY

Owner = Literal["equality", "together", "joint"]


@dataclass(frozen=True)
class Reaction:
    """What is known of the force and torque through an equality, through several together, or through a joint.

    Attributes:
        owner: which of the three.
        names: of the equalities, or of the body's joints.
        bodies: between which it acts; (body, parent) of a joint; empty for couplings.
        force: of the force.
        torque: of the torque, about the anchor or the middle of the anchors; None for a connect alone.
        coupled: of a joint or tendon equality, whether its multiplier is unique; None for others.
    """

    owner: Owner
    names: tuple[str, ...]
    bodies: tuple[str, ...]
    force: Directions | None
    torque: Directions | None
    coupled: bool | None

    @property
    def unique(self) -> bool:
        """Whether all of it is determined, idle directions aside."""
        return self.verdict == "unique"

    @property
    def verdict(self) -> Reactions:
        """Whether all, some or no directions of it are determined, idle ones aside."""
        if self.coupled is not None:
            return "unique" if self.coupled else "not unique"
        parts = [part for part in (self.force, self.torque) if part is not None]
        if not any(part.free for part in parts):
            return "unique"
        return "partly unique" if any(part.unique for part in parts) else "not unique"


@dataclass(frozen=True)
class Redundancy:
    """The rows beyond the rank, by their cause.

    Attributes:
        mechanism: constraints that the mechanism itself has too many.
        modelling: rows that repeat others between the same two bodies, as two connects that make a hinge.
        idle: constraints across the plane of planar loops, and zero rows.
    """

    mechanism: int
    modelling: int
    idle: int

    def __str__(self) -> str:
        return f"mechanism {self.mechanism}, modelling + {self.modelling}, idle + {self.idle}"


@dataclass(frozen=True)
class Uniqueness:
    """Of a whole model.

    Attributes:
        equalities: one an active equality.
        together: one for every two bodies with several equalities between them.
        joints: one for every body whose joints take part in a loop, about its first joint's anchor.
        redundancy: of the groups, in their order.
        poses: at how many closed poses of the same rank it was looked.
    """

    equalities: tuple[Reaction, ...]
    together: tuple[Reaction, ...]
    joints: tuple[Reaction, ...]
    redundancy: tuple[Redundancy, ...]
    poses: int


def find_uniqueness(
    model: mujoco.MjModel, qpos: np.ndarray | None = None, data: mujoco.MjData | None = None
) -> Uniqueness:
    """Looks at the reactions of a model along a motion.

    Args:
        model: any; left alone.
        qpos: poses of a motion (T, nq), each is closed before it counts; None: poses around that of ``data``.
        data: start, mocap bodies, which equalities are active; left alone.

    Raises:
        InputError: as ``find_loops``.
    """
    assembly = Assembly(model, data)
    looked_at: list[tuple[Loops, list[_Look]]] = []
    most = min(SAMPLES, max(FEWEST, WORK // max(1, len(assembly.rows) * model.nv)))
    for pose in _poses(assembly) if qpos is None else qpos[np.unique(np.linspace(0, len(qpos) - 1, most).astype(int))]:
        assembly.place(pose)
        loops = loops_at(assembly, assembly.close(), dependent=False)
        looked_at.append((loops, _looks(assembly, loops)))
    # At a singular pose more is free than elsewhere: the rank of the motion counts.
    rank = max(loops.rank for loops, _ in looked_at)
    kept = [(loops, looks) for loops, looks in looked_at if loops.rank == rank]
    loops = kept[0][0]
    reactions = [_reaction(assembly, [looks[number] for _, looks in kept]) for number in range(len(kept[0][1]))]
    assembly.place(loops.qpos)
    return Uniqueness(
        equalities=tuple(one for one in reactions if one.owner == "equality"),
        together=tuple(one for one in reactions if one.owner == "together"),
        joints=tuple(one for one in reactions if one.owner == "joint"),
        redundancy=tuple(_redundancy(assembly, loops, number) for number in range(len(loops.groups))),
        poses=len(kept),
    )


def _poses(assembly: Assembly) -> list[np.ndarray]:
    """The start and poses on all sides of it, not closed yet."""
    start, rng = assembly.data.qpos.copy(), np.random.default_rng(0)
    found = [start]
    for _ in range(SAMPLES // 3):
        pose = start.copy()
        mujoco.mj_integratePos(assembly.model, pose, AROUND * rng.uniform(-1, 1, assembly.model.nv), 1.0)
        found.append(pose)
    return found


# One pose.


@dataclass(frozen=True)
class _Look:
    """What is free at one pose: ranges of forces and torques, world axes, (3, k) with orthonormal columns."""

    owner: Owner
    names: tuple[str, ...]
    bodies: tuple[int, ...]
    force: np.ndarray | None
    torque: np.ndarray | None
    idle: tuple[np.ndarray, np.ndarray]
    coupled: bool | None
    frames: tuple[np.ndarray, ...]


def _looks(assembly: Assembly, loops: Loops) -> list[_Look]:
    every = [body_wrenches(assembly, number) for number in range(len(assembly.equalities))]
    idle = [_idle(group) for group in loops.groups]
    free = _free_basis(assembly, loops, every, idle)
    found = [_equality_look(assembly, loops, number, every, free, idle) for number in range(len(every))]
    for group in range(len(loops.groups)):
        members = loops.members(group)
        found += [
            _pair_look(assembly, idle[group], pair, every, free) for pair in _pairs(assembly, members) if len(pair) > 1
        ]
        found += _joint_looks(assembly, loops, group, every, free, idle[group])
    return found


def _idle(group: Group) -> tuple[np.ndarray, np.ndarray]:
    """Directions of forces (3, 1) and torques (3, 2) across a planar group's plane; none for another."""
    if group.normal is None:
        return np.zeros((3, 0)), np.zeros((3, 0))
    normal = group.normal[:, None]
    return normal, np.linalg.svd(normal)[0][:, 1:]


_Idle = tuple[np.ndarray, np.ndarray]


def _without(directions: np.ndarray, rest: np.ndarray) -> np.ndarray:
    return rest - directions @ (directions.T @ rest)


def _free_basis(assembly: Assembly, loops: Loops, every: list[list[BodyWrench]], across: list[_Idle]) -> np.ndarray:
    """Basis (n, k) of null(Jᵀ), without what is idle."""
    free = loops.null.copy()
    for number, loop in enumerate(loops.loops):
        rows = assembly.rows_of(number)
        labels = [row.label for row in loop.rows]
        free[rows][[labels.index(label) for label in loop.zero_rows]] = 0.0
        group = loops.groups[loop.group]
        if loop.path.shape == "planar" and group.normal is not None:
            force, torque = across[loop.group]
            wrench = every[number][0]
            # Multipliers that only push across the plane or only turn out of it.
            works = np.vstack([_without(force, wrench.force), _without(torque, wrench.torque)])
            sizes, directions = np.linalg.svd(works)[1:]
            idle = directions[int((sizes > VANISHES * sizes.max(initial=0.0)).sum()) :].T
            free[rows] = _without(idle, free[rows])
    return free[:, free.any(axis=0)]


def _range(vectors: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """Orthonormal basis (3, m) of the range of vectors (3, k), given per unit multiplier."""
    if not vectors.any():
        return np.zeros((3, 0))
    if vectors.shape[1] > WIDE:
        squares, directions = np.linalg.eigh(vectors @ vectors.T)
        return directions[:, squares > np.square(VANISHES * scale)][:, ::-1]
    directions, sizes, _ = np.linalg.svd(vectors, full_matrices=False)
    return directions[:, sizes > VANISHES * scale]


def _equality_look(
    assembly: Assembly,
    loops: Loops,
    number: int,
    every: list[list[BodyWrench]],
    free: np.ndarray,
    across: list[_Idle],
) -> _Look:
    equality, loop, rows = assembly.equalities[number], loops.loops[number], assembly.rows_of(number)
    if not equality.kind.joins_points:
        coupled = bool(np.abs(free[rows]).max(initial=0.0) <= VANISHES)
        return _Look("equality", (equality.name,), (), None, None, across[loop.group], coupled, ())
    wrench = every[number][0]
    force, torque = across[loop.group]
    labels = [row.label for row in loop.rows]
    zero = [labels.index(label) for label in loop.zero_rows]
    force = _range(np.hstack([force, np.eye(3)[:, [at for at in zero if at < 3]]]))
    return _Look(
        "equality",
        (equality.name,),
        equality.bodies,
        _range(wrench.force @ free[rows]),
        _range(wrench.torque @ free[rows]) if equality.kind.turns else None,
        (force, torque),
        None,
        _frames(assembly, equality.bodies),
    )


def _pairs(assembly: Assembly, members: list[int]) -> list[list[int]]:
    """Connects and welds of a group by the two bodies between which they are."""

    def bodies(number: int) -> tuple[int, ...]:
        return tuple(sorted(assembly.equalities[number].bodies))

    chosen = [one for one in members if assembly.equalities[one].kind.joins_points]
    return [list(pair) for _, pair in groupby(sorted(chosen, key=bodies), key=bodies)]


def _pair_map(assembly: Assembly, pair: list[int], every: list[list[BodyWrench]]) -> np.ndarray:
    """Force and torque (6, rows) on the first's first body about the middle of the anchors, of all rows of a pair."""
    body = assembly.equalities[pair[0]].bodies[0]
    wrenches = [next(one for one in every[number] if one.body == body) for number in pair]
    middle = np.mean([one.point for one in wrenches], axis=0)
    return np.hstack([one.about(middle) for one in wrenches])


def _pair_look(
    assembly: Assembly, idle: _Idle, pair: list[int], every: list[list[BodyWrench]], free: np.ndarray
) -> _Look:
    bodies = assembly.equalities[pair[0]].bodies
    act = _pair_map(assembly, pair, every)
    both = act @ free[assembly.rows_of_all(pair)]
    force, torque = idle
    # Forces at points of one line have no torque about it: a hinge.
    none = np.linalg.svd(act[3:])[0][:, _count(act[3:] / _length(assembly)) :]
    return _Look(
        "together",
        tuple(assembly.equalities[one].name for one in pair),
        bodies,
        _range(_without(force, both[:3])),
        _range(_without(torque, both[3:]), _length(assembly)),
        (force, _range(np.hstack([torque, none]))),
        None,
        _frames(assembly, bodies),
    )


def _joint_looks(
    assembly: Assembly, loops: Loops, group: int, every: list[list[BodyWrench]], free: np.ndarray, idle: _Idle
) -> list[_Look]:
    model, data = assembly.model, assembly.data
    carried = _carried(assembly, loops.members(group), every, free)
    found = []
    for body in sorted({int(model.dof_bodyid[dof]) for dof in loops.dofs(group)}):
        joints = range(int(model.body_jntadr[body]), int(model.body_jntadr[body] + model.body_jntnum[body]))
        anchor = data.xanchor[joints[0]]
        through = carried[body].copy()
        through[3:] -= crossed(anchor, through[:3])
        bodies = body, int(model.body_parentid[body])
        axes = [(kind, data.xaxis[joint]) for joint in joints if (kind := _free_axis(model, data, joint, anchor))]
        moves = {kind: [axis for other, axis in axes if other == kind] for kind in ("slide", "hinge")}
        found.append(
            _Look(
                "joint",
                tuple(element_name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) for joint in joints),
                bodies,
                _range(_without(idle[0], through[:3])),
                _range(_without(idle[1], through[3:]), _length(assembly)),
                (
                    _range(np.column_stack([idle[0], *moves["slide"]])),
                    _range(np.column_stack([idle[1], *moves["hinge"]])),
                ),
                None,
                _frames(assembly, bodies),
            )
        )
    return found


def _free_axis(
    model: mujoco.MjModel, data: mujoco.MjData, joint: int, anchor: np.ndarray
) -> Literal["slide", "hinge"] | None:
    """Whether a joint's axis carries no force, or no torque about a point; None for ball and free joints."""
    kind = int(model.jnt_type[joint])
    if kind == mujoco.mjtJoint.mjJNT_SLIDE:
        return "slide"
    through = np.linalg.norm(data.xanchor[joint] - anchor) <= VANISHES * float(model.stat.extent)
    return "hinge" if kind == mujoco.mjtJoint.mjJNT_HINGE and through else None


def _carried(assembly: Assembly, members: list[int], every: list[list[BodyWrench]], free: np.ndarray) -> np.ndarray:
    """Force and torque about the world's origin on every body and all beyond it, (nbody, 6, k), of free multipliers."""
    model = assembly.model
    found = np.zeros((model.nbody, 6, free.shape[1]))
    for number in members:
        own = free[assembly.rows_of(number)]
        if not own.any():
            continue
        for wrench in every[number]:
            found[wrench.body] += wrench.about(np.zeros(3)) @ own
    for body in range(model.nbody - 1, 0, -1):  # a body comes after its parent
        found[int(model.body_parentid[body])] += found[body]
    return found


def _length(assembly: Assembly) -> float:
    return max(float(assembly.model.stat.extent), 1e-3)


def _frames(assembly: Assembly, bodies: tuple[int, ...]) -> tuple[np.ndarray, ...]:
    return tuple(assembly.data.xmat[body].reshape(3, 3).copy() for body in bodies)


# All poses.


def _reaction(assembly: Assembly, looks: list[_Look]) -> Reaction:
    first = looks[0]
    names = tuple(element_name(assembly.model, _BODY, body) for body in first.bodies)
    frames = {WORLD: [np.eye(3)] * len(looks)}
    for at, name in enumerate(names):
        frames.setdefault(name, [look.frames[at] for look in looks])

    def parts(which: Literal["force", "torque"], idle: int) -> Directions | None:
        bases = [basis for look in looks if (basis := getattr(look, which)) is not None]
        return told(bases, max(look.idle[idle].shape[1] for look in looks), frames) if bases else None

    coupled = None if first.coupled is None else all(look.coupled for look in looks)
    return Reaction(first.owner, first.names, names, parts("force", 0), parts("torque", 1), coupled)


def _redundancy(assembly: Assembly, loops: Loops, number: int) -> Redundancy:
    """Of one group, at the present pose, which is that of the loops."""
    group, members = loops.groups[number], loops.members(number)
    every = [body_wrenches(assembly, one) for one in range(len(assembly.equalities))]
    force, torque = _idle(group)
    modelling = idle = 0
    for pair in _pairs(assembly, members):
        act = _pair_map(assembly, pair, every)
        act[3:] /= _length(assembly)
        rank = _count(act)
        modelling += act.shape[1] - rank
        if group.normal is not None:
            idle += rank - _count(np.vstack([_without(force, act[:3]), _without(torque, act[3:])]))
    if group.normal is None:
        idle = group.zero
    return Redundancy(group.redundancy - modelling - idle, modelling, idle)


def _count(matrix: np.ndarray) -> int:
    return int((np.linalg.svd(matrix, compute_uv=False) > VANISHES).sum())
