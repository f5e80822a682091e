"""Wheels that are drawn to mesh, beside the ratio that a coupling has: a pair of gears tells it by its radii.

Two cylinders about the axes of parallel hinges, as far apart as their radii add up to, roll on one another:

    q₁ = ∓ (r₂/r₁) q₂    − where the axes point the same way; the other sign where one is inside of the other
"""

from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import JOINT, Remark, View, told
from oarlock.mechanics.coupled import coupled_ids
from oarlock.mechanics.names import element_name

MESH = 0.02
"""Of the distance of two axes: radii add up to it within so much, for teeth have a height."""

ALIKE = 0.03
"""Of a ratio: so near it is the one that is drawn."""

PARALLEL = 1e-3
"""Sine of the angle between two axes."""

_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
_CYLINDER = int(mujoco.mjtGeom.mjGEOM_CYLINDER)


def look(view: View) -> Iterator[Remark]:
    """A remark a coupling whose ratio is the inverse of the one that its wheels have, or has the other sign."""
    model, data = view.model, mujoco.MjData(view.model)
    mujoco.mj_kinematics(model, data)
    for one in view.equalities:
        ids = coupled_ids(model, one.index) if one.kind.holds == "joints" else []
        polynomial = model.eq_data[one.index, :5]
        if len(ids) != 2 or not polynomial[1] or polynomial[2:].any() or (model.jnt_type[ids] != _HINGE).any():
            continue
        given = float(polynomial[1])
        drawn = list(_ratios(view, data, ids[0], ids[1]))
        if not drawn or any(_alike(given, ratio) for ratio, *_ in drawn):
            continue
        for ratio, first, second in drawn:
            if _alike(given, 1.0 / ratio) and not _alike(abs(ratio), 1.0):
                yield _swapped(view, one.name, ids, given, (first, second))
            elif _alike(given, -ratio):
                yield _turned(view, one.name, ids, ratio, (first, second))
            else:
                continue
            break


def _ratios(view: View, data: mujoco.MjData, first: int, second: int) -> Iterator[tuple[float, float, float]]:
    """Of wheels on two hinges that mesh as they are drawn: q₁/q₂, and their radii."""
    axes, places = data.xaxis[[first, second]], data.xanchor[[first, second]]
    if float(np.linalg.norm(np.cross(axes[0], axes[1]))) > PARALLEL:
        return
    apart = places[1] - places[0]
    distance = float(np.linalg.norm(apart - (apart @ axes[0]) * axes[0]))
    if distance <= 0.0:
        return
    same = 1.0 if axes[0] @ axes[1] > 0.0 else -1.0
    for mine in _radii(view, data, first):
        for theirs in _radii(view, data, second):
            if abs(mine + theirs - distance) <= MESH * distance:
                yield -same * theirs / mine, mine, theirs
            elif abs(abs(mine - theirs) - distance) <= MESH * distance:
                yield same * theirs / mine, mine, theirs


def _radii(view: View, data: mujoco.MjData, joint: int) -> Iterator[float]:
    """Radii of the cylinders about the axis of a hinge that are on its body."""
    model = view.model
    axis, place = data.xaxis[joint], data.xanchor[joint]
    for geom in view.geoms_of(int(model.jnt_bodyid[joint])):
        if model.geom_type[geom] != _CYLINDER:
            continue
        along, away = data.geom_xmat[geom].reshape(3, 3)[:, 2], data.geom_xpos[geom] - place
        radius = float(model.geom_size[geom, 0])
        off = float(np.linalg.norm(away - (away @ axis) * axis))
        if float(np.linalg.norm(np.cross(along, axis))) <= PARALLEL and off <= MESH * radius:
            yield radius


def _alike(first: float, second: float) -> bool:
    return abs(first - second) <= ALIKE * abs(second)


def _named(view: View, ids: list[int]) -> list[str]:
    return [element_name(view.model, JOINT, joint) for joint in ids]


def _swapped(view: View, name: str, ids: list[int], given: float, radii: tuple[float, float]) -> Remark:
    first, second = _named(view, ids)
    said = (
        f"says {first} = {told(given)} · {second}, so that {quoted(second)} turns {told(1.0 / given)} times "
        f"{quoted(first)}; their wheels, drawn with radii of {told(radii[0])} and {told(radii[1])} m, mesh, and with "
        f"them it turns {told(given)} times that: joint1 follows joint2, joint1 and joint2 swapped? "
        f'joint1="{second}" joint2="{first}", or polycoef="0 {1.0 / given:.6g} 0 0 0"'
    )
    return Remark("L13", said, name, figures={"also": [], "ratio": given})


def _turned(view: View, name: str, ids: list[int], wanted: float, radii: tuple[float, float]) -> Remark:
    first, second = _named(view, ids)
    said = (
        f"turns {quoted(first)} and {quoted(second)} {'the same way' if wanted < 0.0 else 'against each other'} about "
        f"their axes; their wheels, drawn with radii of {told(radii[0])} and {told(radii[1])} m, mesh, and turn the "
        f'other way: polycoef="0 {wanted:.6g} 0 0 0"?'
    )
    return Remark("L13", said, name, severity="note", figures={"also": [], "ratio": wanted})
