"""S7: a weld whose relpose asks for another pose than the one that is drawn.

MuJoCo's quaternions are w x y z; those of most other programs end with w. A relpose that is read in the other order
turns the weld by an angle that nothing drawn has, and the identity by half a turn. A position
that is far from the drawn one is as often a leftover: without a relpose MuJoCo takes the drawn pose.
"""

from collections.abc import Iterator
from dataclasses import replace

import mujoco
import numpy as np

from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import Remark, View, point, told
from oarlock.mechanics.names import Equality
from oarlock.poses.assembly import anchors

OFF = 0.1
"""rad. A weld that is drawn further off than that was not meant so, or starts open by a little."""

FAR = 0.1
"""Of the size of the mechanism: a position is further off than a drawing that is not exact."""

ALONG = 0.99
"""Of a distance: one that lies along an axis to that part is told as that axis."""

FITS = 0.02
"""rad. What three digits of a quaternion leave, and the drawing beside it."""


def look(view: View) -> Iterator[Remark]:
    """A remark a weld that the other order closes, in the model's own pose or at the start, and its own in neither."""
    welds = [one for one in view.equalities if one.kind.turns and one.sites is None]
    if not welds:
        return
    model, own = view.model, mujoco.MjData(view.model)
    mujoco.mj_kinematics(model, own)
    for one in welds:
        given = model.eq_data[one.index, 6:10].copy()
        other = np.roll(given, 1)  # x y z w, taken for w x y z, has w last
        poses = {"is drawn": own, "stands at the start": view.data}
        off = {where: turned(data, one, given) for where, data in poses.items()}
        fits = [where for where, data in poses.items() if turned(data, one, other) < FITS]
        if fits and min(off.values()) > OFF:
            yield _remark(view, one, given, other, off[fits[0]], fits[0])
        elif min(off.values()) < FITS and min(_apart(data, one, view) for data in poses.values()) > FAR * view.size:
            target = any(view.model.body_mocapid[body] >= 0 for body in one.bodies)
            if view.loops.closed or target:
                # The drawing is where it begins to be pulled together, or a target that was moved since. What a target
                # carries, or is free, has no other place that it is held at than the one that is drawn.
                free = target or any(_free(view.model, body) for body in one.bodies)
                moved = target and view.model.nkey
                far = _apart(own, one, view) > view.size
                if free and far and not moved and view.posed and _as_drawn(view, one, own):
                    yield replace(_shifted(view, one, own), severity="warning")
                continue
            yield _shifted(view, one, own)


def turned(data: mujoco.MjData, one: Equality, relative: np.ndarray) -> float:
    """Angle between the two bodies of a weld, rad, beside a relative orientation (4)."""
    held = np.zeros(4)
    mujoco.mju_mulQuat(held, data.xquat[one.bodies[0]], relative)
    return 2.0 * float(np.arccos(min(1.0, abs(float(held @ data.xquat[one.bodies[1]])))))


def _remark(view: View, one: Equality, given: np.ndarray, other: np.ndarray, off: float, where: str) -> Remark:
    first, second = (quoted(view.body(body)) for body in one.bodies)
    said = (
        f"relpose turns {second} by {told(off)} rad ({np.degrees(off):.3g}°) from how it {where} beside {first}: "
        f'MuJoCo\'s quaternions are w x y z; with "{_written(other)}" in place of "{_written(given)}" it fits'
    )
    return Remark("S7", said, one.name, figures={"opening": off, "wanted": other.tolist()})


def _apart(data: mujoco.MjData, one: Equality, view: View) -> float:
    first, second = anchors(view.model, data, one)
    return float(np.linalg.norm(second - first))


def _free(model: mujoco.MjModel, body: int) -> bool:
    root = int(model.body_rootid[body])
    return bool(model.body_jntnum[root]) and model.jnt_type[model.body_jntadr[root]] == mujoco.mjtJoint.mjJNT_FREE


def _as_drawn(view: View, one: Equality, own: mujoco.MjData) -> bool:
    """Whether the two bodies stand at the start as they are drawn."""
    return abs(_apart(own, one, view) - _apart(view.data, one, view)) <= FITS * _apart(own, one, view)


def _shifted(view: View, one: Equality, own: mujoco.MjData) -> Remark:
    """Of a position that is asked for and not drawn."""
    model = view.model
    first, second = anchors(model, own, one)
    frame, origin = own.xmat[one.bodies[0]].reshape(3, 3), own.xpos[one.bodies[0]]
    asked, drawn = frame.T @ (first - origin), frame.T @ (second - origin)
    gap = asked - drawn
    size = float(np.linalg.norm(gap))
    main = int(np.abs(gap).argmax())
    way = f" along {'xyz'[main]}" if abs(gap[main]) >= ALONG * size else ""
    names = [quoted(view.body(body)) for body in one.bodies]
    left = _apart_without(view, one, drawn)
    closed = "closed" if left <= FAR * view.size else f"open by {told(left)} m"
    said = (
        f"relpose asks for {told(size)} m{way} between {names[0]} and {names[1]} that are not drawn: for "
        f"{point(asked)} of {names[0]}, where {point(drawn)} is drawn; without relpose it is closed as drawn, and "
        f"{closed} at the start"
    )
    return Remark("S7", said, one.name, figures={"opening": size, "wanted": drawn.tolist()})


def _apart_without(view: View, one: Equality, drawn: np.ndarray) -> float:
    """How far it is open at the start with the relative position (3) that is drawn, m."""
    body, data = one.bodies[0], view.data
    place = data.xpos[body] + data.xmat[body].reshape(3, 3) @ drawn
    return float(np.linalg.norm(anchors(view.model, data, one)[1] - place))


def _written(quaternion: np.ndarray) -> str:
    return " ".join(f"{value + 0.0:.6g}" for value in quaternion)
