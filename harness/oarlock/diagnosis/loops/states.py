"""Random consistent states of a model: poses of ``spread``, velocities from the null space of the rows."""

import copy
from pathlib import Path

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.cases.case import load_case
from oarlock.cases.motion import Motion
from oarlock.diagnosis.loops.poses import nearest_closed
from oarlock.diagnosis.loops.spread import Spread, spread
from oarlock.mechanics.given import Model, path_of
from oarlock.mechanics.load import load_model
from oarlock.mechanics.names import coordinates, element_name
from oarlock.poses.assembly import Assembly
from oarlock.poses.chart import arm_of, bounds, fenced, lengths
from oarlock.stepping.beginning import beginning_of_file
from oarlock.stepping.start import consistent_start

_FREE, _BALL, _HINGE = (int(getattr(mujoco.mjtJoint, f"mjJNT_{name}")) for name in ("FREE", "BALL", "HINGE"))

Drawn = tuple[
    np.ndarray,
    np.ndarray,
    np.ndarray,
    np.ndarray,
    np.ndarray,
    np.ndarray,
    tuple[str, ...],
    tuple[str, ...],
    float,
    tuple[bool, ...],
]
"""As the attributes of ``Samples``, from ``qpos`` on."""


def start_of(model: Model, keyframe: str | None) -> tuple[str, mujoco.MjModel, mujoco.MjData]:
    """Its name, the model, and a data at its start: that of a case, else by the rule of ``stepping.beginning``.

    Raises:
        InputError: as ``sample``.
    """
    path = path_of(model)
    if Path(path).is_file():
        name = str(model) if model is path else Path(path).stem
        model = load_model(Path(path))
    else:
        case = load_case(path)
        name, model = str(path), load_model(case.model_path, case.parameters)
        if keyframe is None:
            dense = copy.copy(model)
            dense.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
            data = mujoco.MjData(model)
            data.qpos[:] = consistent_start(dense, case).qpos
            return name, model, data
    begins = beginning_of_file(model, Motion(keyframe=keyframe))  # moves mocap bodies of the model
    data = mujoco.MjData(model)
    data.qpos[:] = begins.qpos
    return name, model, data


def draw(model: mujoco.MjModel, data: mujoco.MjData, own: int, others: int, seed: int, speed: float) -> Drawn:
    """Draws states: so many of the start's own branch, and so many of others, in a random order.

    Args:
        model: any with equalities; left alone.
        data: the start, mocap bodies, and which equalities are active.
        own: of the start's branch.
        others: of other branches, of the same where there are none.
        seed: of the random numbers.
        speed: root mean square of the velocities at the start, rad/s, lengths over the arm.

    Raises:
        InputError: the start cannot be closed inside of ranges, or nothing can move.
    """
    pose = nearest_closed(model, data.qpos.copy(), np.zeros(model.nv), data)
    if not pose.closed:
        raise InputError(f"no pose near the start closes the loops ({'; '.join(map(str, pose.culprits))})")
    if pose.outside:
        beyond = pose.outside[0]
        raise InputError(f"the closed start is beyond the {beyond.limit} by {beyond.by:.3g}, expected it inside")
    assembly = fenced(model, data)
    groups = spread(assembly, pose.qpos, own, others, seed, bounds(model))
    if all(group.rank == len(group.dofs) for group in groups):
        raise InputError("nothing can move at the start: 0 degrees of freedom, expected at least one")
    order = np.random.default_rng([seed, len(groups)]).permutation(own + others)
    qpos = _together(model, pose.qpos, groups)[order]
    branch = _labels(groups)[order]
    singular = _nearness(groups)[order]
    rank = sum(group.rank for group in groups)
    qvel, left, energy = _velocities(Assembly(model, data), pose.qpos, qpos, rank, seed, speed)
    names = tuple(entry["name"] for entry in coordinates(model))
    return (
        qpos,
        qvel,
        branch,
        singular,
        left,
        _depths(model, data, qpos),
        names,
        speed_names(model),
        energy,
        _turning(model),
    )


def _turning(model: mujoco.MjModel) -> tuple[bool, ...]:
    """Which entries of qpos are angles that turn on and on."""
    found = np.zeros(model.nq, dtype=bool)
    free = (model.jnt_type == _HINGE) & (model.jnt_limited == 0)
    found[model.jnt_qposadr[free]] = True
    return tuple(found.tolist())


def _together(model: mujoco.MjModel, start: np.ndarray, groups: list[Spread]) -> np.ndarray:
    """Poses (n, nq) of all groups at once."""
    found = np.tile(start, (len(groups[0].poses), 1))
    for group in groups:
        for joint in sorted(set(model.dof_jntid[group.dofs].tolist())):
            at = int(model.jnt_qposadr[joint])
            size = {_FREE: 7, _BALL: 4}.get(int(model.jnt_type[joint]), 1)
            found[:, at : at + size] = group.poses[:, at : at + size]
    return found


def _labels(groups: list[Spread]) -> np.ndarray:
    """A number for every combination of the groups' branches, the start's own first, then as they come."""
    combined = np.array([group.branch for group in groups]).T
    known: dict[tuple[int, ...], int] = {(0,) * len(groups): 0}
    return np.array([known.setdefault(tuple(row), len(known)) for row in combined.tolist()])


def _nearness(groups: list[Spread]) -> np.ndarray:
    """Smallest singular values over their medians, of the group where that is least; 1 where there are no rows."""
    ratios = [group.smallest / max(float(np.median(group.smallest)), 1e-300) for group in groups if group.rank]
    return np.min(ratios, axis=0) if ratios else np.ones(len(groups[0].poses))


def _velocities(
    assembly: Assembly, start: np.ndarray, qpos: np.ndarray, rank: int, seed: int, speed: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Velocities (n, nv), what rows are left open (n), and the mean energy of a degree of freedom, J."""
    nv = assembly.model.nv
    rng = np.random.default_rng([seed, nv, len(qpos)])
    unit = np.where(lengths(assembly.model), arm_of(assembly), 1.0)

    def admitted(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Hᵀ with M⁻¹ = Hᵀ H, (nv, nv), and the right vectors (rank, nv) of J Hᵀ."""
        assembly.place(pose)
        rows = assembly.whitened(assembly.jacobian())
        taken = np.linalg.svd(rows)[2][:rank] if len(rows) else np.zeros((0, nv))
        return assembly.whitened(np.eye(nv)), taken

    back, taken = admitted(start)
    spread_of = (back - (back @ taken.T) @ taken) / unit[:, None]
    scale = speed / max(float(np.sqrt((spread_of**2).sum() / nv)), 1e-300)
    qvel, left = np.zeros((len(qpos), nv)), np.zeros(len(qpos))
    for number, pose in enumerate(qpos):
        back, taken = admitted(pose)
        way = rng.normal(size=nv)
        for _ in range(2):  # twice: what rounding left the first time
            way = way - taken.T @ (taken @ way)
        qvel[number] = scale * (back @ way)
        left[number] = float(np.abs(assembly.residual()).max(initial=0.0))
    return qvel, left, 0.5 * scale**2


def _depths(model: mujoco.MjModel, data: mujoco.MjData, qpos: np.ndarray) -> np.ndarray:
    """How deep bodies are in one another (n), m."""
    there, found = copy.copy(data), np.zeros(len(qpos))
    for number, pose in enumerate(qpos):
        there.qpos[:] = pose
        mujoco.mj_fwdPosition(model, there)
        found[number] = max(0.0, float((-there.contact.dist).max(initial=0.0)))
    return found


def speed_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of the velocities (nv): the joint's, numbered where a joint has several."""
    found = []
    for dof in range(model.nv):
        joint = int(model.dof_jntid[dof])
        name = element_name(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
        several = model.jnt_type[joint] in (_FREE, _BALL)
        found.append(f"{name}[{dof - int(model.jnt_dofadr[joint])}]" if several else name)
    return tuple(found)
