"""What a mechanism presses against at a state: limits of its joints and tendons, and contacts of its bodies."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from oarlock.diagnosis.runs.separation import separated
from oarlock.diagnosis.runs.walking import own_copy
from oarlock.mechanics.coupled import COUPLED
from oarlock.mechanics.engine_version import tendon_dofs
from oarlock.mechanics.inequalities import ELLIPTIC, KINDS, row_name, row_unit

_TURNS = (int(mujoco.mjtJoint.mjJNT_BALL), int(mujoco.mjtJoint.mjJNT_FREE))


@dataclass(frozen=True)
class Obstacle:
    """A limit or a contact that pushes.

    Attributes:
        name: in words, such as ``limit of joint 'knee'``.
        force: of it, N m about a hinge or ball, else N; of a contact along the normal, all its points together.
        force_unit: of that.
        joint, tendon: number of what a limit is of; −1: of nothing such.
        range: of a limit, low and high, in ``unit``.
        by: how far it is beyond that, in ``unit``.
        unit: rad or m.
        bodies: numbers of the two of a contact, sorted; empty of a limit.
        depth: by which these overlap at the start, m.
        outside: whether one of them does not belong to the mechanism.
    """

    name: str
    force: float
    force_unit: str
    joint: int = -1
    tendon: int = -1
    range: tuple[float, float] = (-np.inf, np.inf)
    by: float = 0.0
    unit: str = "m"
    bodies: tuple[int, ...] = ()
    depth: float = 0.0
    outside: bool = False

    def stops(self, value: float) -> bool:
        """Whether a value (rad or m) lies beyond a limit."""
        return not self.range[0] <= value <= self.range[1]


def mechanism(model: mujoco.MjModel, dofs: Iterable[int]) -> set[int]:
    """Numbers of the bodies that some degrees of freedom move, and of those in one tree with them."""
    roots = {int(model.body_rootid[model.dof_bodyid[dof]]) for dof in dofs}
    return {body for body in range(1, model.nbody) if int(model.body_rootid[body]) in roots}


def obstacles(model: mujoco.MjModel, first: mujoco.MjData, data: mujoco.MjData, dofs: set[int]) -> list[Obstacle]:
    """The limits and contacts that push against what some degrees of freedom move.

    Args:
        model: any.
        first: the start, with its contacts.
        data: a state, with its forces.
        dofs: of the mechanism.
    """
    own, moved = mechanism(model, dofs), _moved(model, dofs)
    found: dict[tuple, Obstacle] = {}
    for row in range(data.ne, data.nefc):
        kind, index, force = int(data.efc_type[row]), int(data.efc_id[row]), float(data.efc_force[row])
        if KINDS[kind] == "limit" and force > 0.0:
            one = _limit(model, data, row)
            passed = [int(model.jnt_dofadr[index])] if one.joint >= 0 else tendon_dofs(model, index)
            if not dofs.isdisjoint(passed):
                found[kind, index] = one
        elif KINDS[kind] == "contact" and force > 0.0:
            bodies = _bodies(model, data, index)
            across = kind == ELLIPTIC and (int(data.efc_type[row - 1]), int(data.efc_id[row - 1])) == (kind, index)
            if across or len(bodies) != 2 or moved.isdisjoint(bodies):
                continue
            known = found.get(bodies)
            if known is None:
                name, outside = row_name(model, data, row), not own.issuperset(bodies)
                depth = _depth(model, first, bodies)
                known = Obstacle(name, 0.0, "N", bodies=bodies, depth=depth, outside=outside)
            found[bodies] = replace(known, force=known.force + force)
    return list(found.values())


def freed(model: mujoco.MjModel, chosen: Iterable[Obstacle]) -> mujoco.MjModel | None:
    """A copy of a model without some obstacles; None where contacts cannot be taken out of it."""
    every = list(chosen)
    pairs = {(one.bodies[0], one.bodies[1]) for one in every if one.bodies}
    own = separated(model, pairs) if pairs else own_copy(model)
    if own is not None:
        own.jnt_limited[[one.joint for one in every if one.joint >= 0]] = 0
        own.tendon_limited[[one.tendon for one in every if one.tendon >= 0]] = 0
    return own


def _moved(model: mujoco.MjModel, dofs: set[int]) -> set[int]:
    """Numbers of the bodies that some degrees of freedom move."""
    found = {int(model.dof_bodyid[dof]) for dof in dofs}
    for body in range(1, model.nbody):  # parents come first
        if int(model.body_parentid[body]) in found:
            found.add(body)
    return found


def _limit(model: mujoco.MjModel, data: mujoco.MjData, row: int) -> Obstacle:
    index, by = int(data.efc_id[row]), max(0.0, -float(data.efc_pos[row]))
    of_tendon = int(data.efc_type[row]) == int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON)
    sort = COUPLED["tendons" if of_tendon else "joints"]
    low, high = (model.tendon_range if of_tendon else model.jnt_range)[index].tolist()
    if not of_tendon and model.jnt_type[index] in _TURNS:
        low = -high
    return Obstacle(
        name=row_name(model, data, row),
        force=float(data.efc_force[row]),
        force_unit=row_unit(model, data, row),
        joint=-1 if of_tendon else index,
        tendon=index if of_tendon else -1,
        range=(low, high),
        by=by,
        unit=sort.unit(model, index),
    )


def _bodies(model: mujoco.MjModel, data: mujoco.MjData, contact: int) -> tuple[int, ...]:
    geoms = [int(geom) for geom in data.contact[contact].geom]
    return tuple(sorted(int(model.geom_bodyid[geom]) for geom in geoms)) if min(geoms) >= 0 else ()


def _depth(model: mujoco.MjModel, first: mujoco.MjData, bodies: tuple[int, ...]) -> float:
    every = [-float(first.contact[at].dist) for at in range(first.ncon) if _bodies(model, first, at) == bodies]
    return max(0.0, *every) if every else 0.0
