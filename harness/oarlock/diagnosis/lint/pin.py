"""L10: a weld, or a second connect, where a pin leaves the loop its one degree of freedom."""

from collections.abc import Iterator

import mujoco

from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import Remark, View
from oarlock.mechanics.names import Equality

JOINTS = 3
"""A planar chain of fewer joints does not move with a pin either."""


def look(view: View) -> Iterator[Remark]:
    """A remark an equality that locks a planar loop and would not if it were a pin."""
    if not any(one.kind.joins_points for one in view.equalities):
        return
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
                    yield _remark(one, f"{said}degree of freedom")
                    break
            elif twin := _twin(view, own, one):
                dof = view.freedom(group, one, _dropped)
                if dof == 1:
                    said = f"with {quoted(twin.name)} it holds its bodies as a weld does, and nothing of the loop "
                    yield _remark(one, f"{said}can move; either of them alone leaves 1 degree of freedom", twin.name)
                    break


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
