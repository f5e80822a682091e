"""S7: a weld whose relative orientation was written in the order x y z w.

MuJoCo's quaternions are w x y z; those of most other programs end with w. A relpose that is read in the other order
turns the weld by an angle that nothing drawn has, and the identity by half a turn.
"""

from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import Remark, View, told
from oarlock.mechanics.names import Equality

OFF = 0.1
"""rad. A weld that is drawn further off than that was not meant so, or starts open by a little."""

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


def _written(quaternion: np.ndarray) -> str:
    return " ".join(f"{value + 0.0:.6g}" for value in quaternion)
