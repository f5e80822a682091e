"""The loops of a model: its equalities, which of them belong together, and what their rows hold, alone and together."""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.rank import (
    FLOOR,
    ZERO_ROW,
    Spectrum,
    block_scales,
    circuits,
    null_basis,
    spectrum,
    zero_rows,
)
from oarlock.mechanics.coupled import coupled, coupled_ids
from oarlock.mechanics.folding import fold
from oarlock.mechanics.names import Equality, element_name
from oarlock.poses.assembly import Assembly
from oarlock.poses.layout import Row
from oarlock.poses.paths import Path, Shape, common_shape, path_of, share_dofs

ORDERS = 24
"""So many orders of the rows are tried for small dependent sets."""

SCALED = 90
"""So many poses of a motion, equally spaced, give the scales of its rows."""

MOVES = 1e-6
"""Of the largest velocity of a motion that the rows admit: a coordinate with less does not take part."""

_JOINT = mujoco.mjtObj.mjOBJ_JOINT


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

    def members(self, group: int) -> list[int]:
        """Numbers of the loops of a group."""
        return [number for number, loop in enumerate(self.loops) if loop.group == group]

    def dofs(self, group: int) -> list[int]:
        """Degrees of freedom of the joints of a group."""
        return sorted({dof for number in self.members(group) for dof in self.loops[number].path.dofs})

    @property
    def near_singular(self) -> bool:
        """Whether the rank of a group is doubtful here."""
        return any(group.spectrum.near_singular for group in self.groups)


def find_loops(model: mujoco.MjModel, data: mujoco.MjData | None = None) -> Loops:
    """The loops at the closed pose nearest to that of ``data``, or of the model's own.

    A pose that is a dead end stays open here; ``nearest_closed`` goes around it, and gives the loops too.

    Args:
        model: any; left alone.
        data: pose, mocap bodies and which equalities are active; left alone.

    Raises:
        InputError: an active flex equality.
    """
    assembly = Assembly(model, data)
    return loops_at(assembly, assembly.close())


def loops_at(assembly: Assembly, closed: bool = True, *, dependent: bool = True) -> Loops:
    """The loops at an assembly's present pose, whose position stage is valid.

    Without ``dependent`` dependencies and joints that stand still are left out: of many rows they take longer than all
    the rest.
    """
    model, data = assembly.model, assembly.data
    jacobian = assembly.jacobian()
    scaled, scales = scaled_rows(assembly, jacobian)
    zero = scales == 0.0
    paths = [path_of(model, data, equality) for equality in assembly.equalities]
    members = share_dofs(paths)
    groups, bases, loops = [], [], {}
    for number, chosen in enumerate(members):
        rows = assembly.rows_of_all(chosen)
        folded = fold(scaled[rows])
        found = spectrum(np.linalg.svd(folded.rows, compute_uv=False))
        null = null_basis(folded, found.rank, scales[rows])
        dofs = sorted({dof for one in chosen for dof in paths[one].dofs})
        joints = sorted({joint for one in chosen for joint in paths[one].joints})
        sizes = [assembly.equalities[one].rows for one in chosen]
        for one, own in zip(chosen, np.split(null, np.cumsum(sizes)[:-1]), strict=True):
            # The rank without it: its part of null(Jᵀ) has full row rank exactly if nothing is lost.
            lost = len(own) - _rank_of_part(own)
            loops[one] = _loop(assembly, one, paths[one], number, zero, lost)
        shape, normal = common_shape([paths[one] for one in chosen])
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
                dependencies=_dependencies(assembly, rows, scaled[rows], found.rank, zero[rows]) if dependent else (),
                still=_still(model, scales[rows, None] * jacobian[rows][:, dofs], found.rank, dofs, joints)
                if dependent
                else (),
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


def scaled_rows(assembly: Assembly, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of J (n, nv) in the metric of M, scaled by blocks, and their scales (n): 0 of a row that holds nothing."""
    zero = zero_rows(jacobian) if len(jacobian) else np.zeros(0, dtype=bool)
    whitened = assembly.whitened(jacobian)
    whitened[zero] = 0.0
    scales = block_scales(np.linalg.norm(whitened, axis=1), assembly.blocks)
    return scales[:, None] * whitened, scales


def scales_along(assembly: Assembly, qpos: np.ndarray) -> np.ndarray:
    """Scales (n) of the rows that serve a whole motion (T, nq), 0 of rows that never hold anything."""
    some = qpos[np.unique(np.linspace(0, len(qpos) - 1, SCALED).astype(int))]
    lengths = np.zeros(len(assembly.rows))
    for pose in some:
        assembly.place(pose)
        np.maximum(lengths, np.linalg.norm(assembly.whitened(assembly.jacobian()), axis=1), out=lengths)
    lengths[lengths <= ZERO_ROW * lengths.max(initial=0.0)] = 0.0
    return block_scales(lengths, assembly.blocks)


def _rank_of_part(part: np.ndarray) -> int:
    """Rank of some rows (m, k) of an orthonormal basis: they carry tenths, or rounding."""
    return int((np.linalg.eigvalsh(part @ part.T) > FLOOR).sum()) if part.size else 0


def _loop(assembly: Assembly, one: int, path: Path, group: int, zero: np.ndarray, lost: int) -> Loop:
    model, equality = assembly.model, assembly.equalities[one]
    rows = assembly.rows[assembly.rows_of(one)]
    if equality.kind.joins_points:
        ends = tuple(element_name(model, mujoco.mjtObj.mjOBJ_BODY, body) for body in equality.bodies)
    else:
        sort = coupled(equality.kind).object_type
        ends = tuple(element_name(model, sort, index) for index in coupled_ids(model, equality.index))
    labels = tuple(row.label for row, none in zip(rows, zero[assembly.rows_of(one)], strict=True) if none)
    return Loop(equality, ends, tuple(rows), labels, path, group, removable=lost == 0, freed=lost)


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
