"""L10: a weld, or a second connect, where a pin leaves the loop the freedom that it is to have.

That is one degree of freedom of a loop that is locked, and as many as actuators drive it of one that has fewer.
"""

from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import Remark, View
from oarlock.mechanics.names import Equality, element_name
from oarlock.mechanics.servos import moments

JOINTS = 3
"""A planar chain of fewer joints does not move with a pin either."""


def look(view: View) -> Iterator[Remark]:
    """A remark an equality that locks a planar loop and would not if it were a pin."""
    if not any(one.kind.joins_points for one in view.equalities):
        return
    yield from _short(view)
    for number, group in enumerate(view.loops.groups):
        if group.dof > 0 or group.shape != "planar" or group.dofs < JOINTS or not view.loops.closed:
            continue
        own = [view.loops.loops[member].equality for member in view.loops.members(number)]
        for one in own:
            if not one.kind.joins_points or any(view.model.body_mocapid[body] >= 0 for body in one.bodies):
                continue
            if one.kind.turns:
                dof = view.freedom(group, one, _pinned)
                if dof == 1:
                    bodies = " and ".join(f"'{view.body(body)}'" for body in one.bodies)
                    said = f"holds {bodies} as one body, and nothing of the loop can move; as a connect it leaves 1 "
                    yield _remark(one, f"{said}degree of freedom: {_as_connect(view, one)}")
                    break
            elif twin := _twin(view, own, one):
                dof = view.freedom(group, one, _dropped)
                if dof == 1:
                    said = f"with {quoted(twin.name)} it holds its bodies as a weld does, and nothing of the loop "
                    yield _remark(one, f"{said}can move; either of them alone leaves 1 degree of freedom", twin.name)
                    break


def _short(view: View) -> Iterator[Remark]:
    """A remark a weld that leaves fewer degrees of freedom than actuators drive, and as a connect leaves as many."""
    if not view.model.nu or not view.loops.closed:
        return
    every = moments(view.model, view.data)
    for number, group in enumerate(view.loops.groups):
        dofs = view.loops.dofs(number)
        drives = every[np.abs(every[:, dofs]).max(axis=1, initial=0.0) > 0.0][:, dofs]
        count = int(np.linalg.matrix_rank(drives)) if len(drives) else 0
        if not 0 < group.dof < count:
            continue
        for member in view.loops.members(number):
            one = view.loops.loops[member].equality
            mocap = any(view.model.body_mocapid[body] >= 0 for body in one.bodies)
            if not one.kind.turns or mocap or view.freedom(group, one, _pinned) != count:
                continue
            bodies = " and ".join(f"'{view.body(body)}'" for body in one.bodies)
            freedom = f"{group.dof} degree{'s' if group.dof > 1 else ''} of freedom"
            said = (
                f"holds {bodies} as one body, and leaves {freedom} to {count} actuators, which fight one another; as a "
                f"connect it leaves {count}: {_as_connect(view, one)}"
            )
            yield Remark("L10", said, one.name, figures={"dof": group.dof, "dof_with_pin": count, "also": []})
            break


def _as_connect(view: View, one: Equality) -> str:
    """How a weld is written as a connect."""
    model = view.model
    if one.sites is not None:
        names = [element_name(model, mujoco.mjtObj.mjOBJ_SITE, site) for site in one.sites]
        return f'<connect site1="{names[0]}" site2="{names[1]}"/>'
    anchor = " ".join(f"{0.0 if abs(value) < 5e-7 else value:.6g}" for value in one.anchor(model, 0).tolist())
    bodies = [view.body(body) for body in one.bodies]
    second = "" if one.bodies[1] == 0 else f' body2="{bodies[1]}"'
    return f'<connect body1="{bodies[0]}"{second} anchor="{anchor}"/>'


def _remark(one: Equality, said: str, *also: str) -> Remark:
    return Remark("L10", said, one.name, figures={"dof": 0, "dof_with_pin": 1, "also": list(also)})


def _twin(view: View, own: list[Equality], one: Equality) -> Equality | None:
    """Another connect of the same two bodies, if there is one."""
    others = [other for other in own if other is not one and other.kind.joins_points]
    others = [other for other in others if sorted(other.bodies) == sorted(one.bodies)]
    return next((other for other in others if not other.kind.turns), None)


def _pinned(model: mujoco.MjModel, data: mujoco.MjData, one: Equality) -> None:
    """Takes a weld for a connect at the same place."""
    place = [] if one.sites is not None else [*one.anchor(model, 0), *one.anchor(model, 1)]
    model.eq_type[one.index] = mujoco.mjtEq.mjEQ_CONNECT
    if place:
        model.eq_data[one.index, :6] = place


def _dropped(model: mujoco.MjModel, data: mujoco.MjData, one: Equality) -> None:
    data.eq_active[one.index] = 0
