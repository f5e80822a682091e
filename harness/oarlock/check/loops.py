"""The loops of a model: its equalities, which of them belong together, and what their rows hold, alone and together."""

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from oarlock.check.assembly import Assembly, Row
from oarlock.check.rank import (
    FLOOR,
    Spectrum,
    circuits,
    null_basis,
    row_scales,
    spectrum,
    zero_rows,
)
from oarlock.mechanism import Equality, element_name

PARALLEL = 1e-5
"""rad. Two axes that differ by less are meant to be parallel: six digits of a quaternion are 1e-6."""

ORDERS = 24
"""So many orders of the rows are tried for small dependent sets."""

MOVES = 1e-6
"""Of the largest velocity of a motion that the rows admit: a coordinate with less does not take part."""

Shape = Literal["planar", "spatial", "coupling"]

_JOINT = mujoco.mjtObj.mjOBJ_JOINT
_BALL, _FREE = int(mujoco.mjtJoint.mjJNT_BALL), int(mujoco.mjtJoint.mjJNT_FREE)
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True)
class Path:
    """The part of the kinematic tree that an equality closes to a loop.

    Attributes:
        joints: on the way from one end to the other; of a coupling, those that it couples.
        dofs: theirs.
        shape: ``planar``: hinges parallel, slides across them; ``spatial``; ``coupling``: a joint or tendon equality.
        normal: of the plane, world axes (3); None where there is none.
    """

    joints: tuple[int, ...]
    dofs: tuple[int, ...]
    shape: Shape
    normal: np.ndarray | None


@dataclass(frozen=True)
class Loop:
    """One active equality.

    Attributes:
        equality: kind, name, bodies.
        ends: names of its two bodies, joints or tendons; of a coupling to a constant only one.
        rows: with labels and units.
        zero_rows: labels of those that hold nothing at this pose, such as the one across a planar loop's plane.
        path: the joints that it closes to a loop.
        group: number of its group.
        removable: the rank without it is the same: at this pose it holds nothing that the others do not hold.
        freed: degrees of freedom that leaving it out would add.
    """

    equality: Equality
    ends: tuple[str, ...]
    rows: tuple[Row, ...]
    zero_rows: tuple[str, ...]
    path: Path
    group: int
    removable: bool
    freed: int

    @property
    def name(self) -> str:
        """Of the equality."""
        return self.equality.name


@dataclass(frozen=True)
class Dependency:
    """Rows of which each follows from the others, and from no fewer.

    Attributes:
        equalities: whose they are; a single one repeats itself.
        rows: the rows, with their part (1 for the largest) where each block's largest row has length 1.
    """

    equalities: tuple[str, ...]
    rows: tuple[tuple[Row, float], ...]

    @property
    def proportional(self) -> bool:
        """Whether one row is a multiple of another."""
        return len(self.rows) == 2


@dataclass(frozen=True)
class Group:
    """Equalities that share degrees of freedom, directly or through others. Ranks of groups add up.

    Attributes:
        equalities: names.
        joints: names of those that its loops pass.
        rows: how many, zero ones included.
        zero: how many of them are zero.
        spectrum: singular values at which the rank was decided.
        dofs: degrees of freedom of its joints, before it is closed.
        shape: ``planar`` if all of its loops are, in one plane.
        normal: of that plane, world axes (3).
        dependencies: one for every redundant row that is not zero.
        still: names of joints that no motion moves at this pose: locked, or in a dead point.
    """

    equalities: tuple[str, ...]
    joints: tuple[str, ...]
    rows: int
    zero: int
    spectrum: Spectrum
    dofs: int
    shape: Shape
    normal: np.ndarray | None
    dependencies: tuple[Dependency, ...]
    still: tuple[str, ...]

    @property
    def rank(self) -> int:
        """Independent rows."""
        return self.spectrum.rank

    @property
    def redundancy(self) -> int:
        """Rows beyond the rank, zero ones included."""
        return self.rows - self.rank

    @property
    def dof(self) -> int:
        """Degrees of freedom that are left."""
        return self.dofs - self.rank


@dataclass(frozen=True)
class Loops:
    """The loops of a model at one pose.

    Attributes:
        loops: one an active equality.
        groups: independent of one another.
        closed: whether the pose is; if not, ranks are those of the nearest pose that was found.
        qpos: the pose (nq).
        nv: degrees of freedom of the model without its loops.
        null: orthonormal basis (n, n − rank) of the multipliers that do nothing, null(Jᵀ), group by group.
    """

    loops: tuple[Loop, ...]
    groups: tuple[Group, ...]
    closed: bool
    qpos: np.ndarray
    nv: int
    null: np.ndarray

    @property
    def rows(self) -> int:
        """Rows of all active equalities."""
        return sum(group.rows for group in self.groups)

    @property
    def rank(self) -> int:
        """Independent rows."""
        return sum(group.rank for group in self.groups)

    @property
    def redundancy(self) -> int:
        """Rows beyond the rank, zero ones included."""
        return self.rows - self.rank

    @property
    def dof(self) -> int:
        """Degrees of freedom of the whole model."""
        return self.nv - self.rank

    @property
    def near_singular(self) -> bool:
        """Whether the rank of a group is doubtful here."""
        return any(group.spectrum.near_singular for group in self.groups)


def find_loops(model: mujoco.MjModel, data: mujoco.MjData | None = None) -> Loops:
    """The loops at the closed pose nearest to that of ``data``, or of the model's own.

    Args:
        model: any; left alone.
        data: pose, mocap bodies and which equalities are active; left alone.

    Raises:
        InputError: an active flex equality.
    """
    assembly = Assembly(model, data)
    return loops_at(assembly, assembly.close())


def loops_at(assembly: Assembly, closed: bool = True) -> Loops:
    """The loops at an assembly's present pose, whose position stage is valid."""
    model, data = assembly.model, assembly.data
    jacobian = assembly.jacobian()
    zero = zero_rows(jacobian) if len(jacobian) else np.zeros(0, dtype=bool)
    whitened = assembly.whitened(jacobian)
    whitened[zero] = 0.0
    scales = row_scales(whitened, assembly.blocks)
    scales[zero] = 0.0
    scaled = scales[:, None] * whitened
    paths = [path_of(model, data, equality) for equality in assembly.equalities]
    members = _groups(paths)
    groups, bases, loops = [], [], {}
    for number, chosen in enumerate(members):
        rows = np.concatenate([np.arange(len(assembly.rows))[assembly.rows_of(one)] for one in chosen])
        found = spectrum(np.linalg.svd(scaled[rows], compute_uv=False))
        null = null_basis(scaled[rows], found.rank, scales[rows])
        dofs = sorted({dof for one in chosen for dof in paths[one].dofs})
        joints = sorted({joint for one in chosen for joint in paths[one].joints})
        for one in chosen:
            own = np.isin(rows, np.arange(len(assembly.rows))[assembly.rows_of(one)])
            # The rank without it: its part of null(Jᵀ) has full row rank exactly if nothing is lost.
            lost = int(own.sum()) - _rank_of_part(null[own])
            loops[one] = _loop(assembly, one, paths[one], number, zero, lost)
        shape, normal = _shape([paths[one] for one in chosen])
        groups.append(
            Group(
                equalities=tuple(assembly.equalities[one].name for one in chosen),
                joints=tuple(element_name(model, _JOINT, joint) for joint in joints),
                rows=len(rows),
                zero=int(zero[rows].sum()),
                spectrum=found,
                dofs=len(dofs),
                shape=shape,
                normal=normal,
                dependencies=_dependencies(assembly, rows, scaled[rows], found.rank, zero[rows]),
                still=_still(model, jacobian[np.ix_(rows, dofs)] * scales[rows, None], found.rank, dofs, joints),
            )
        )
        whole = np.zeros((len(assembly.rows), null.shape[1]))
        whole[rows] = null
        bases.append(whole)
    return Loops(
        loops=tuple(loops[one] for one in sorted(loops)),
        groups=tuple(groups),
        closed=closed,
        qpos=data.qpos.copy(),
        nv=model.nv,
        null=np.hstack(bases) if bases else np.zeros((0, 0)),
    )


def _rank_of_part(part: np.ndarray) -> int:
    """Rank of some rows (m, k) of an orthonormal basis: they carry tenths, or rounding."""
    return int((np.linalg.svd(part, compute_uv=False) > FLOOR**0.5).sum()) if part.size else 0


def _loop(assembly: Assembly, one: int, path: Path, group: int, zero: np.ndarray, lost: int) -> Loop:
    model, equality = assembly.model, assembly.equalities[one]
    rows = assembly.rows[assembly.rows_of(one)]
    if equality.kind in ("connect", "weld"):
        ends = tuple(element_name(model, mujoco.mjtObj.mjOBJ_BODY, body) for body in equality.bodies)
    else:
        kind = _JOINT if equality.kind == "joint" else mujoco.mjtObj.mjOBJ_TENDON
        ids = int(model.eq_obj1id[equality.index]), int(model.eq_obj2id[equality.index])
        ends = tuple(element_name(model, kind, index) for index in ids if index >= 0)
    labels = tuple(row.label for row, none in zip(rows, zero[assembly.rows_of(one)], strict=True) if none)
    return Loop(equality, ends, tuple(rows), labels, path, group, removable=lost == 0, freed=lost)


# Paths.


def path_of(model: mujoco.MjModel, data: mujoco.MjData, equality: Equality) -> Path:
    """The joints that an equality closes to a loop; axes are those of the present pose."""
    first, second = int(model.eq_obj1id[equality.index]), int(model.eq_obj2id[equality.index])
    if equality.kind == "joint":
        joints = [joint for joint in (first, second) if joint >= 0]
        return Path(tuple(joints), tuple(int(model.jnt_dofadr[joint]) for joint in joints), "coupling", None)
    if equality.kind == "tendon":
        dofs = sorted({dof for tendon in (first, second) if tendon >= 0 for dof in _tendon_dofs(model, tendon)})
        joints = sorted({int(model.dof_jntid[dof]) for dof in dofs})
        return Path(tuple(joints), tuple(dofs), "coupling", None)
    above = [_to_world(model, body) for body in equality.bodies]
    bodies = sorted(set(above[0]) ^ set(above[1]))
    starts, counts = model.body_jntadr, model.body_jntnum
    joints = [joint for body in bodies for joint in range(starts[body], starts[body] + counts[body])]
    dofs = [
        dof
        for body in bodies
        for dof in range(model.body_dofadr[body], model.body_dofadr[body] + model.body_dofnum[body])
    ]
    normal = _common_normal(model, data, joints)
    return Path(tuple(map(int, joints)), tuple(map(int, dofs)), "spatial" if normal is None else "planar", normal)


def _tendon_dofs(model: mujoco.MjModel, tendon: int) -> list[int]:
    start = int(model.ten_J_rowadr[tendon])
    return model.ten_J_colind[start : start + int(model.ten_J_rownnz[tendon])].tolist()


def _to_world(model: mujoco.MjModel, body: int) -> list[int]:
    found = []
    while body:
        found.append(body)
        body = int(model.body_parentid[body])
    return found


def _common_normal(model: mujoco.MjModel, data: mujoco.MjData, joints: list[int]) -> np.ndarray | None:
    """The normal (3) of the plane that joints move in, or None."""
    kinds = model.jnt_type[joints]
    if not len(joints) or np.isin(kinds, (_BALL, _FREE)).any():
        return None
    axes = data.xaxis[joints]
    hinges, slides = axes[kinds != _SLIDE], axes[kinds == _SLIDE]
    if len(hinges):
        normal = hinges[0]
    else:
        sizes, directions = np.linalg.svd(slides)[1:]
        if len(slides) < 2 or sizes[1] <= PARALLEL:
            return None  # a straight line is in many planes
        normal = directions[2]
    tilts = np.linalg.norm(np.cross(hinges, normal), axis=1) if len(hinges) else np.zeros(0)
    if tilts.max(initial=0.0) > PARALLEL or np.abs(slides @ normal).max(initial=0.0) > PARALLEL:
        return None
    largest = int(np.abs(normal).argmax())
    return normal * np.sign(normal[largest])


def _groups(paths: list[Path]) -> list[list[int]]:
    """Numbers of the paths that share degrees of freedom, directly or through others."""
    groups: list[tuple[set[int], list[int]]] = []
    for number, path in enumerate(paths):
        dofs, members = set(path.dofs), [number]
        apart = []
        for other_dofs, others in groups:
            if dofs & other_dofs:
                dofs |= other_dofs
                members = others + members
            else:
                apart.append((other_dofs, others))
        groups = [*apart, (dofs, members)]
    return sorted(sorted(members) for _, members in groups)


def _shape(paths: list[Path]) -> tuple[Shape, np.ndarray | None]:
    shapes = [path for path in paths if path.shape != "coupling"]
    if not shapes:
        return "coupling", None
    normals = [path.normal for path in shapes if path.normal is not None]
    if len(normals) < len(shapes) or np.linalg.norm(np.cross(normals, normals[0]), axis=1).max() > PARALLEL:
        return "spatial", None
    return "planar", normals[0]


# What rows hold together.


def _dependencies(
    assembly: Assembly, rows: np.ndarray, scaled: np.ndarray, rank: int, zero: np.ndarray
) -> tuple[Dependency, ...]:
    """One for every redundant row that is not zero, those of the fewest equalities first."""
    live = np.flatnonzero(~zero)
    if rank == len(live):
        return ()
    null = np.linalg.svd(scaled[live])[0][:, rank:]
    owners = np.array([assembly.rows[row].equality for row in rows[live]])
    count = len(live)
    shifts = np.unique(np.linspace(0, count, min(ORDERS, count), endpoint=False).astype(int))
    orders = [np.roll(np.arange(count)[::-1], shift) for shift in shifts]
    found = np.hstack([circuits(null, order) for order in orders])
    ranked = sorted(found.T, key=lambda one: (len(set(owners[one != 0])), int((one != 0).sum())))
    chosen: list[np.ndarray] = []
    for candidate in ranked:
        if np.linalg.matrix_rank(np.array([*chosen, candidate]), tol=1e-3) > len(chosen):
            chosen.append(candidate)
        if len(chosen) == null.shape[1]:
            break
    return tuple(
        Dependency(
            tuple(dict.fromkeys(owners[one != 0].tolist())),
            tuple((assembly.rows[rows[live[at]]], float(one[at])) for at in np.flatnonzero(one)),
        )
        for one in chosen
    )


def _still(
    model: mujoco.MjModel, jacobian: np.ndarray, rank: int, dofs: list[int], joints: list[int]
) -> tuple[str, ...]:
    """Names of the joints that no motion of the group moves, from its scaled rows (n, dofs)."""
    motions = np.linalg.svd(jacobian)[2][rank:]
    owners = model.dof_jntid[dofs]
    still = [joint for joint in joints if np.abs(motions[:, owners == joint]).max(initial=0.0) <= MOVES]
    return tuple(element_name(model, _JOINT, joint) for joint in still)
