"""A2: couplings whose polycoef was written for whole lengths or angles.

MuJoCo counts the x of joint and tendon equalities from the model's own pose: of a tendon its length less that of the
drawing, of a joint its coordinate less ref. A constant that is the length itself asks for that much more.
"""

from collections.abc import Iterator

import numpy as np

from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import JOINT, TENDON, Remark, View, told
from oarlock.mechanics.coupled import coupled, coupled_ids
from oarlock.mechanics.names import Equality, element_name

SAME = 0.01
"""Of the constant: what two digits of a length leave."""

APART = 0.1
"""Of the constant: as MuJoCo reads it, the coupling is open by more than that."""

LEAST = 1e-4
"""m or rad. A smaller constant is rounding of what was closed."""


def look(view: View) -> Iterator[Remark]:
    """A remark a coupling that whole lengths close, as drawn or at the start, and MuJoCo's in neither."""
    for one in view.equalities:
        if one.kind.holds not in ("joints", "tendons"):
            continue
        model, ids = view.model, coupled_ids(view.model, one.index)
        given = model.eq_data[one.index, :5].copy()
        size = abs(float(given[0]))
        zeros = np.array([_zero(view, one, element) for element in ids])
        if size < LEAST or not zeros.any():
            continue
        moved = np.array([coupled(one.kind).position(model, view.data, element) for element in ids])
        poses = {"as it is drawn": np.zeros(len(ids)), "at the start": moved}
        if min(abs(_off(given, x)) for x in poses.values()) <= APART * size:
            continue
        where = next((name for name, x in poses.items() if abs(_off(given, zeros + x)) <= SAME * size), None)
        if where:
            yield _remark(view, one, ids, given, zeros, where)


def _zero(view: View, one: Equality, element: int) -> float:
    """Where MuJoCo counts an element's x from, m or rad."""
    model = view.model
    if one.kind.holds == "joints":
        return float(model.qpos0[model.jnt_qposadr[element]])
    return float(model.tendon_length0[element])


def _off(polynomial: np.ndarray, x: np.ndarray) -> float:
    """Deviation of x = p(x₂) at the x of both (2), or of the only one (1) from the constant."""
    follows = np.polynomial.polynomial.polyval(x[1], polynomial) if len(x) > 1 else polynomial[0]
    return float(x[0] - follows)


def _remark(view: View, one: Equality, ids: list[int], given: np.ndarray, zeros: np.ndarray, where: str) -> Remark:
    joints = one.kind.holds == "joints"
    first = quoted(element_name(view.model, JOINT if joints else TENDON, ids[0]))
    wanted = np.zeros(5)
    if len(ids) > 1:  # p(z₂ + x) as powers of x
        part = given
        for power in range(5):
            wanted[power] = np.polynomial.polynomial.polyval(zeros[1], part)
            part = np.polynomial.polynomial.polyder(part) / (power + 1.0)
    else:
        wanted[0] = given[0]
    wanted[0] -= zeros[0]
    if abs(wanted[0]) <= SAME * abs(given[0]):
        wanted[0] = 0.0
    written = " ".join(f"{value + 0.0:.6g}" for value in wanted)
    what, zero = ("positions", "ref") if joints else ("lengths", "the length that is drawn")
    said = (
        f"polycoef begins with {given[0]:g}, which fits {where} if {what} are whole ones: MuJoCo counts {first} from "
        f'{zero}, {told(float(zeros[0]))} {one.unit}; polycoef="{written}" was meant?'
    )
    return Remark("A2", said, one.name, figures={"also": [], "wanted": wanted.tolist()})
