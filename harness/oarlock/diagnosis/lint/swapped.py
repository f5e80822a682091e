"""L13: a coupling of joints whose ratio belongs to the other order of them.

MuJoCo has q₁ = p(q₂): the first joint follows the second. Written the other way round a ratio stands for its inverse,
and the joints cannot use their ranges.
"""

from collections.abc import Iterator

from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import JOINT, Remark, View, told
from oarlock.mechanics.coupled import coupled, coupled_ids
from oarlock.mechanics.names import element_name

USED = 0.1
"""Of a range: a coupling that admits no more of it does not fit."""

FITS = 2.0
"""Factor: with the inverse ratio the ranges fit each other within that."""


def look(view: View) -> Iterator[Remark]:
    """A remark a coupling."""
    model = view.model
    for one in view.equalities:
        ids = coupled_ids(model, one.index) if one.kind.holds == "joints" else []
        polynomial = model.eq_data[one.index, :5]
        if len(ids) != 2 or not polynomial[1] or polynomial[2:].any() or not model.jnt_limited[ids].all():
            continue
        wide = [float(model.jnt_range[joint, 1] - model.jnt_range[joint, 0]) for joint in ids]
        if min(wide) <= 0.0:
            continue
        ratio = abs(float(polynomial[1]))
        fit, other = ratio * wide[1] / wide[0], wide[1] / (ratio * wide[0])
        if min(fit, 1.0 / fit) >= USED or not 1.0 / FITS <= other <= FITS:
            continue
        joints = [element_name(model, JOINT, joint) for joint in ids]
        units = [coupled(one.kind).unit(model, joint) for joint in ids]
        idle, used = (0, ratio * wide[1]) if fit < 1.0 else (1, wide[0] / ratio)
        said = (
            f"moves {quoted(joints[0])} by {told(ratio)} {units[0]} per {units[1]} of {quoted(joints[1])}, which "
            f"leaves {quoted(joints[idle])} {told(used)} of its {told(wide[idle])} {units[idle]}; the ranges are as "
            f"{told(wide[1] / wide[0])} to 1, joint1 and joint2 swapped? "
            f'joint1="{joints[1]}" joint2="{joints[0]}"'
        )
        yield Remark("L13", said, one.name, figures={"also": [], "used": min(fit, 1.0 / fit), "swapped": other})
