"""Spatial tendons that an equality couples: the lever that they have, and the one with which the others agree."""

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.errors import few
from oarlock.base.text import quoted
from oarlock.diagnosis.loops.loops import MOVES, Loop, Loops
from oarlock.diagnosis.loops.mobility import admitted
from oarlock.mechanics.coupled import coupled_ids
from oarlock.mechanics.engine_version import tendon_dofs
from oarlock.mechanics.names import element_name
from oarlock.poses.assembly import Assembly

STEP = 1e-6
"""rad or m, both ways: so small that a path bends no more than rounding."""

FITS = 0.1
"""Relative: another side site gives a lever that agrees within that."""

SITES = 32
"""So many side sites are tried."""

_GEOMS = (int(mujoco.mjtWrap.mjWRAP_SPHERE), int(mujoco.mjtWrap.mjWRAP_CYLINDER))
_PATH = int(mujoco.mjtWrap.mjWRAP_JOINT)


@dataclass(frozen=True)
class Lever:
    """A spatial tendon about one joint.

    Attributes:
        tendon, joint: their names.
        given: dL/dq, m per rad or m.
        wanted: with which the others agree.
        geoms: names of those that it wraps.
        sidesite: that of a geom with which the lever agrees, and what it then is; None: none is known.
    """

    tendon: str
    joint: str
    given: float
    wanted: float
    geoms: tuple[str, ...]
    sidesite: tuple[str, str, float] | None

    def __str__(self) -> str:
        said = (
            f"its tendon {quoted(self.tendon)} changes by {self.given:.3g} m per unit of {quoted(self.joint)}, where "
        )
        said += f"{self.wanted:.3g} would agree"
        if self.geoms:
            said += f"; look at its path round {few([quoted(name) for name in self.geoms])}"
        if self.sidesite is not None:
            geom, site, value = self.sidesite
            said += f': with <geom geom="{geom}" sidesite="{site}"/> it is {value:.3g}'
        return said


def find_lever(assembly: Assembly, loops: Loops, loop: Loop, rest: Sequence[int]) -> Lever | None:
    """The lever of a coupling with a spatial tendon that one joint of a held set moves; None where there is none.

    Args:
        assembly: whatever its pose.
        loops: at a closed pose.
        loop: the coupling.
        rest: numbers of the other equalities of the set.
    """
    model = assembly.model
    ids = coupled_ids(model, loop.equality.index) if loop.equality.kind.holds == "tendons" else []
    spatial = [one for one in ids if model.wrap_type[model.tendon_adr[one]] != _PATH]
    if len(ids) != 2 or len(spatial) != 1:
        return None
    tendon, other = spatial[0], next(one for one in ids if one not in spatial)
    motion = _motion(assembly, loops, loop, list(rest))
    moving = [dof for dof in tendon_dofs(model, tendon) if abs(motion[dof]) > MOVES]
    if len(moving) != 1:
        return None
    dof = moving[0]
    given = _rate(model, assembly, loops.qpos, tendon, np.eye(model.nv)[dof])
    slope = _slope(assembly, loop, ids[1])
    follows = _rate(model, assembly, loops.qpos, other, motion) / motion[dof]
    wanted = slope * follows if tendon == ids[0] else follows / slope if slope else 0.0
    if not wanted or abs(given - wanted) <= STEP * abs(wanted):
        return None
    wraps = list(_wraps(model, tendon))
    geoms = tuple(element_name(model, mujoco.mjtObj.mjOBJ_GEOM, int(model.wrap_objid[at])) for at in wraps)
    return Lever(
        element_name(model, mujoco.mjtObj.mjOBJ_TENDON, tendon),
        element_name(model, mujoco.mjtObj.mjOBJ_JOINT, int(model.dof_jntid[dof])),
        given,
        wanted,
        geoms,
        _other_side(assembly, loops.qpos, tendon, dof, wraps, wanted),
    )


def _motion(assembly: Assembly, loops: Loops, loop: Loop, rest: list[int]) -> np.ndarray:
    """The motion (nv) that a coupling takes from those that the others of its set admit, 1 at its largest; or zeros."""
    dofs, place = loops.dofs(loop.group), next(at for at, one in enumerate(loops.loops) if one is loop)
    free = admitted(assembly, rest, dofs, loops.qpos)
    left = admitted(assembly, [*rest, place], dofs, loops.qpos)
    taken = free - free @ left.T @ left
    _, sizes, directions = np.linalg.svd(taken, full_matrices=False)
    if not len(sizes) or sizes[0] <= MOVES:
        return np.zeros(assembly.model.nv)
    return directions[0] / np.abs(directions[0]).max()


def _rate(model: mujoco.MjModel, assembly: Assembly, qpos: np.ndarray, tendon: int, motion: np.ndarray) -> float:
    """How fast a tendon grows along a motion (nv), m."""
    data, lengths = mujoco.MjData(model), []
    data.mocap_pos[:], data.mocap_quat[:] = assembly.data.mocap_pos, assembly.data.mocap_quat
    for step in (STEP, -STEP):
        data.qpos[:] = qpos
        mujoco.mj_integratePos(model, data.qpos, motion, step)
        mujoco.mj_fwdPosition(model, data)
        lengths.append(float(data.ten_length[tendon]))
    return (lengths[0] - lengths[1]) / (2.0 * STEP)


def _slope(assembly: Assembly, loop: Loop, second: int) -> float:
    model, data = assembly.model, assembly.data
    x = float(data.ten_length[second] - model.tendon_length0[second])
    polynomial = model.eq_data[loop.equality.index, :5]
    return float(np.polynomial.polynomial.polyval(x, np.polynomial.polynomial.polyder(polynomial)))


def _wraps(model: mujoco.MjModel, tendon: int) -> Iterator[int]:
    first = int(model.tendon_adr[tendon])
    for at in range(first, first + int(model.tendon_num[tendon])):
        if int(model.wrap_type[at]) in _GEOMS:
            yield at


def _other_side(
    assembly: Assembly, qpos: np.ndarray, tendon: int, dof: int, wraps: list[int], wanted: float
) -> tuple[str, str, float] | None:
    """A side site with which the lever agrees, of those on the body of the geom first."""
    model = assembly.model
    for at in wraps:
        geom = int(model.wrap_objid[at])
        body = int(model.geom_bodyid[geom])
        sites = sorted(range(model.nsite), key=lambda site: int(model.site_bodyid[site]) != body)
        for site in sites[:SITES]:
            if site == int(model.wrap_prm[at]):
                continue
            own = copy.copy(model)
            own.wrap_prm[at] = site
            value = _rate(own, assembly, qpos, tendon, np.eye(model.nv)[dof])
            if abs(value - wanted) <= FITS * abs(wanted):
                name = element_name(model, mujoco.mjtObj.mjOBJ_GEOM, geom)
                return name, element_name(model, mujoco.mjtObj.mjOBJ_SITE, site), value
    return None
