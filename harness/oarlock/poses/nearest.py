"""The closed pose nearest to a given one: of all poses that equalities and ranges admit, that with the least change.

    min ½ ‖x‖²   with   r(q₀ ⊞ x) = 0   inside of all ranges,

x in radians, lengths over the mechanism's arm (``chart``): what turns or slides furthest, not what is heaviest. The
metric of M, in which a step projects, makes light links pay: they are flung around to spare a heavy one some degrees,
and a joint that takes no part in a loop is moved along. Every group of equalities that share joints is looked at by
itself.

From a closed pose the minimum is found along the poses that are closed, by Newton's method on the Lagrangian: with a
basis Z of what the rows admit and the multipliers of Jᵀλ = −x the step is

    p = Z u,   Zᵀ (1 + Σ λᵢ ∇²rᵢ) Z u = −Zᵀ x,   inside of ranges,

closed again and halved until the norm falls; it never rises. As there may be several such poses (an elbow up or down),
the search begins anew from poses around the given one, drawn inside of the ball that the best pose so far leaves.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.errors import choose
from oarlock.base.text import called
from oarlock.mechanics.coupled import COUPLED
from oarlock.mechanics.engine_version import tendon_dofs
from oarlock.mechanics.inequalities import row_name
from oarlock.mechanics.names import element_name
from oarlock.poses.assembly import Assembly
from oarlock.poses.chart import INSET, Chart, Seen, arm_of, bounds, fenced
from oarlock.poses.paths import path_of, share_dofs

STARTS, FEWEST, LARGE = 24, 6, 1200
"""Searches from other poses around the given one, for every group: of many coordinates fewer, LARGE over their number,
for each costs more."""

REACHES = (0.2, 0.5, 1.0, 2.0, np.pi)
"""rad. How far around the given pose they begin while none has closed."""

STEPS = 60
"""Of one search for the minimum, at most."""

SETTLED = 1e-10
"""rad. A step that is shorter ends the search."""

FLAT = 0.05
"""Curvature that is taken at least, of that without loops: where the true one is less, or negative, a step is only a
descent."""

BETTER = 1e-9
"""rad. A pose has to be nearer by so much to be taken in place of an earlier one."""

AT_BOUND = 1e-8
"""rad. A coordinate that is so near to a bound is at it."""

_DIFFERENCE = 1e-6
"""rad. Step of the differences that the curvature of the rows is computed from."""

_HALVINGS = 12
_JOINT = mujoco.mjtObj.mjOBJ_JOINT
_ALONG_TENDON = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON)


@dataclass(frozen=True)
class Outside:
    """A joint or tendon that rests beyond its range.

    Attributes:
        limit: in words, such as ``limit of joint 'knee'``.
        by: how far.
        unit: ``m`` or ``rad``; ``m or rad`` of a tendon along joints of both kinds.
    """

    limit: str
    by: float
    unit: str


@dataclass(frozen=True)
class Nearest:
    """The closed pose nearest to a given one.

    Attributes:
        qpos: the pose (nq).
        norm: what leads there, rad: lengths over ``arm``.
        arm: a length that counts as a radian, m.
        held: joints of open loops that were not to move.
        detour: whether it was found only from other poses than the given one.
        limits: whether ranges were kept.
    """

    qpos: np.ndarray
    norm: float
    arm: float
    held: tuple[str, ...]
    detour: bool
    limits: bool


def driven_joints(model: mujoco.MjModel) -> tuple[int, ...]:
    """The joints that actuators act on themselves."""
    kinds = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    return tuple(dict.fromkeys(model.actuator_trnid[np.isin(model.actuator_trntype, kinds), 0].tolist()))


def joints_called(model: mujoco.MjModel, names: tuple[str, ...]) -> tuple[int, ...]:
    """The joints of some names, or of numbers in ``#`` form.

    Raises:
        InputError: there is no such joint.
    """
    every = [element_name(model, _JOINT, joint) for joint in range(model.njnt)]
    return tuple(every.index(choose("joint to hold", name, every)) for name in names)


def outside_ranges(model: mujoco.MjModel, qpos: np.ndarray, data: mujoco.MjData | None = None) -> tuple[Outside, ...]:
    """The joints and tendons that a pose (nq) has beyond their ranges, furthest first.

    Args:
        model: any; left alone.
        qpos: the pose.
        data: mocap bodies, which tendons may lead to.
    """
    least, most = bounds(model).T
    by = np.maximum(least - qpos, qpos - most)
    names = {int(address): joint for joint, address in enumerate(model.jnt_qposadr)}
    beyond = [
        Outside(
            f"limit of {called('joint', element_name(model, _JOINT, names[address]))}",
            float(by[address]),
            COUPLED["joints"].unit(model, names[address]),
        )
        for address in np.flatnonzero(by > 0.0).tolist()
    ]
    assembly = fenced(model, data)
    assembly.place(qpos)
    own, there = assembly.model, assembly.data
    for row in range(there.ne, there.nefc):
        if there.efc_pos[row] < -INSET:  # a length or the angle of a ball is computed, and rounded
            along = COUPLED["tendons" if there.efc_type[row] == _ALONG_TENDON else "joints"]
            unit = along.unit(own, int(there.efc_id[row]))
            beyond.append(Outside(row_name(own, there, row), -float(there.efc_pos[row]), unit))
    return tuple(sorted(beyond, key=lambda one: -one.by))


def nearest(
    model: mujoco.MjModel,
    given: np.ndarray,
    data: mujoco.MjData | None = None,
    *,
    held: tuple[int, ...] = (),
    limits: bool = True,
    tolerance: float = 0.0,
) -> Nearest | None:
    """Finds it; None if no pose around closes the loops with all of that.

    Args:
        model: any; left alone.
        given: the pose q₀ (nq).
        data: mocap bodies and which equalities are active.
        held: joints that stay as they are.
        limits: whether to stay inside of ranges.
        tolerance: groups of equalities that are open by less, m or rad, stay as they are.
    """
    assembly = fenced(model, data)
    arm = arm_of(assembly)
    assembly.place(given)
    rest = assembly.residual()
    found, square, detour = given.copy(), 0.0, False
    holding: list[int] = []
    for numbers, dofs in groups_of(assembly):
        rows = assembly.rows_of_all(numbers)
        owners = model.dof_jntid[dofs]
        free = [dof for dof in dofs if model.dof_jntid[dof] not in held]
        chart = Chart(assembly, given, free, rows, arm, bounds(model) if limits else None)
        closed = np.abs(rest[rows]).max(initial=0.0) <= tolerance
        if closed and (not free or chart.inside(chart.see(np.zeros(chart.size)))):
            continue
        holding += [joint for joint in held if joint in owners]
        best = _search(chart)
        if best is None:
            return None
        seen, roundabout = best
        change = np.zeros(model.nv)
        change[chart.dofs] = seen.x * chart.unit
        mujoco.mj_integratePos(model, found, change, 1.0)
        square, detour = square + float(seen.x @ seen.x), detour or roundabout
    names = tuple(element_name(model, _JOINT, joint) for joint in dict.fromkeys(holding))
    return Nearest(found, float(np.sqrt(square)), arm, names, detour, limits)


def nearest_kept(
    model: mujoco.MjModel,
    given: np.ndarray,
    data: mujoco.MjData | None = None,
    *,
    held: tuple[int, ...] = (),
    tolerance: float = 0.0,
) -> tuple[Nearest | None, bool]:
    """The nearest pose that keeps what can be kept: joints that are held and ranges, else ranges, else neither.

    Args:
        model: as of ``nearest``; so are the others.
        given: the pose (nq).
        data: mocap bodies and which equalities are active.
        held: joints that stay as they are, where the rest can close.
        tolerance: of closed groups, m or rad.

    Returns:
        The pose, None where none closes; and whether the joints were held.
    """
    tries: list[tuple[tuple[int, ...], bool]] = [((), True), ((), False)]
    if held:
        tries.insert(0, (held, True))
    for joints, limits in tries:
        found = nearest(model, given, data, held=joints, limits=limits, tolerance=tolerance)
        if found is not None:
            return found, joints == held
    return None, False


def groups_of(assembly: Assembly) -> list[tuple[list[int], list[int]]]:
    """Equalities that share joints or a limited tendon, and the degrees of freedom that they concern.

    A joint that no equality concerns is a group without equalities. The pose of the assembly must be placed.
    """
    model = assembly.model
    paths = [path_of(model, assembly.data, equality) for equality in assembly.equalities]
    found = [(numbers, {dof for one in numbers for dof in paths[one].dofs}) for numbers in share_dofs(paths)]
    taken = set().union(*(dofs for _, dofs in found))
    alone = [dof for dof in range(model.nv) if dof not in taken]
    found += [
        ([], {dof for dof in alone if model.dof_jntid[dof] == joint})
        for joint in sorted({*model.dof_jntid[alone].tolist()})
    ]
    for tendon in np.flatnonzero(model.tendon_limited):
        moved = set(tendon_dofs(model, int(tendon)))
        joined = [group for group in found if group[1] & moved]
        if len(joined) > 1:
            numbers = sorted(number for group in joined for number in group[0])
            apart = [group for group in found if not group[1] & moved]
            found = [*apart, (numbers, set().union(*(dofs for _, dofs in joined)))]
    return [(numbers, sorted(dofs)) for numbers, dofs in sorted(found, key=lambda group: min(group[1], default=-1))]


def _search(chart: Chart) -> tuple[Seen, bool] | None:
    """The nearest of the minima that are found, and whether the given pose itself led to none."""
    origin = np.zeros(chart.size)
    first = chart.close(origin)
    best = _descend(chart, first) if first is not None else None
    rng = np.random.default_rng(0)
    starts = max(FEWEST, min(STARTS, LARGE // max(chart.size, 1)))
    for number in range(starts):
        far = _norm(best) if best is not None else REACHES[number * len(REACHES) // starts]
        if far <= BETTER:
            break
        way = rng.normal(size=chart.size)
        way *= far * rng.uniform(0.3, 1.2) / max(float(np.linalg.norm(way)), 1e-300)
        there = chart.close(np.clip(way, chart.low, chart.high))
        if there is None:
            continue
        there = _descend(chart, there)
        if best is None or _norm(there) < _norm(best) - BETTER:
            best = there
    return None if best is None else (best, first is None)


def _norm(seen: Seen | None) -> float:
    return np.inf if seen is None else float(np.linalg.norm(seen.x))


def _descend(chart: Chart, seen: Seen) -> Seen:
    """Follows the closed poses from one to the nearest around."""
    for _ in range(STEPS):
        _, _, right, rank = seen.split()
        free = right[rank:].T
        if not free.shape[1]:
            return seen
        step = _newton_step(chart, seen, free)
        if np.abs(step).max(initial=0.0) <= SETTLED:
            return seen
        step *= min(1.0, 1.0 / float(np.abs(step).max()))
        for _ in range(_HALVINGS):
            there = chart.close(seen.x + step)
            if there is not None and _norm(there) < _norm(seen):
                break
            step = 0.5 * step
        else:
            return seen
        if _norm(seen) - _norm(there) <= 1e-14 * _norm(seen):
            return there
        seen = there
    return seen


def _newton_step(chart: Chart, seen: Seen, free: np.ndarray) -> np.ndarray:
    """Newton's step along the directions ``free`` (k, d) that the rows admit, inside of ranges."""
    # At a bound that keeps a coordinate from zero its part of Jᵀλ = −x is the bound's.
    kept = ((seen.x <= chart.low + AT_BOUND) & (seen.x > 0.0)) | ((seen.x >= chart.high - AT_BOUND) & (seen.x < 0.0))
    go = ~kept
    multipliers = -np.linalg.lstsq(seen.rows[:, go].T, seen.x[go], rcond=1e-9)[0]
    shape = np.eye(free.shape[1])
    if np.abs(multipliers).max(initial=0.0) > 0.0:
        bent = np.empty_like(shape)
        for column, way in enumerate(free.T):
            ahead = chart.see(seen.x + _DIFFERENCE * way)
            behind = chart.see(seen.x - _DIFFERENCE * way)
            bent[:, column] = free.T @ ((ahead.rows - behind.rows).T @ multipliers) / (2.0 * _DIFFERENCE)
        shape = shape + 0.5 * (bent + bent.T)
    values, vectors = np.linalg.eigh(shape)
    values = np.maximum(np.abs(values), FLAT)
    root = np.sqrt(values)[:, None] * vectors.T  # B = Lᵀ L
    along = -vectors @ ((vectors.T @ (free.T @ seen.x)) / values)
    return chart.step(seen, free @ along, free, root)
