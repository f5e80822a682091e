"""Points that no pose brings together: which way they lie apart there, and where a site would have to be."""

import copy
from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.base.numbers import figure
from oarlock.base.text import quoted
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.loops.gaps import Culprits
from oarlock.diagnosis.loops.loops import loops_at
from oarlock.diagnosis.loops.mobility import find_mobility
from oarlock.diagnosis.symptoms import start_of
from oarlock.mechanics.load import collected_warnings
from oarlock.mechanics.names import Equality, element_name, equalities
from oarlock.poses.assembly import Assembly, anchors

ALONG = 0.99
"""Of a gap: with so much of it along an axis it is along that axis."""

_AXES = "xyz"
_SITE = mujoco.mjtObj.mjOBJ_SITE


def short_along(exam: Examination, culprit: Culprits) -> Iterator[str]:
    """Of a connect or weld that cannot be closed alone: the direction of its gap, and the site that closes it."""
    pose, model = exam.pose, exam.model
    own = [one for one in equalities(model) if one.name == culprit.equalities[0]]
    if pose is None or not culprit.alone or not own or not own[0].kind.joins_points or not culprit.openings[0].metres:
        return
    one, assembly = own[0], Assembly(model, start_of(exam))
    assembly.place(pose.qpos)
    first, second = anchors(model, assembly.data, one)
    gap = second - first
    if not float(np.linalg.norm(gap)) > 0.0:
        return
    loop = next((each for each in pose.loops.loops if each.name == one.name), None)
    normal = None if loop is None else pose.loops.groups[loop.group].normal
    across = normal is not None and abs(float(gap @ normal)) >= ALONG * float(np.linalg.norm(gap))
    said = f"its points lie {_direction(gap)} apart where they come nearest"
    yield f"{said}, across the plane in which its joints move them: no pose closes that" if across else said
    if not one.kind.turns and (moved := _moved(exam, one, assembly, gap)):
        yield moved


def _direction(gap: np.ndarray) -> str:
    size = float(np.linalg.norm(gap))
    most = int(np.abs(gap).argmax())
    if abs(gap[most]) >= ALONG * size:
        return f"{figure(abs(float(gap[most])), 'm')} along {_AXES[most]} of the world"
    named = [f"{axis} {figure(float(value), 'm')}" for axis, value in zip(_AXES, gap, strict=True) if value]
    return f"({', '.join(named)})"


def _moved(exam: Examination, one: Equality, assembly: Assembly, gap: np.ndarray) -> str:
    """The place of one of its sites with which the loop closes and can move; empty where neither has one."""
    if one.sites is None:
        return ""
    pose, model = assembly.data.qpos.copy(), exam.model
    for end in (1, 0):
        site, body = one.sites[end], one.bodies[end]
        if body == 0:
            continue
        frame = assembly.data.xmat[body].reshape(3, 3)
        changed = copy.copy(model)
        changed.site_pos[site] = np.round(model.site_pos[site] + (1 - 2 * end) * frame.T @ gap, 6) + 0.0
        with collected_warnings():
            trial = Assembly(changed, start_of(exam))
            trial.place(pose)
            if not trial.close():
                continue
            found = find_mobility(trial, loops_at(trial, dependent=False))
        if all(each.moves for each in found if one.name in each.equalities):
            place = " ".join(f"{value:.6g}" for value in changed.site_pos[site])
            return f'with pos="{place}" of site {quoted(element_name(model, _SITE, site))} it closes'
    return ""
