"""L13: a coupling of joints whose ratio belongs to the other order of them.

MuJoCo has q₁ = p(q₂): the first joint follows the second. Written the other way round a ratio stands for its inverse,
and the joints cannot use their ranges. Where no range tells, wheels that are drawn do (``gears``), or the drives: a
joint that is driven follows nothing,
least of all two others, or one that it carries.
"""

from collections.abc import Iterator

import numpy as np

from oarlock.base.errors import few
from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import JOINT, Remark, View, told
from oarlock.mechanics.coupled import coupled, coupled_ids
from oarlock.mechanics.names import Equality, element_name
from oarlock.mechanics.servos import moments

USED = 0.1
"""Of a range: a coupling that admits no more of it does not fit."""

ALIKE = 1e-3
"""Of a ratio: one so near to 1 is the same either way."""

FITS = 2.0
"""Factor: with the inverse ratio the ranges fit each other within that."""


def look(view: View) -> Iterator[Remark]:
    """A remark a coupling, or one of all that a driven joint is said to follow."""
    told_of = set[str]()
    for remark in _by_ranges(view):
        told_of.add(remark.element)
        yield remark
    yield from _by_drives(view, told_of)


def _by_drives(view: View, told_of: set[str]) -> Iterator[Remark]:
    """Of ratios other than 1 that a driven joint has to joints which nothing drives."""
    model = view.model
    if not model.nu:
        return
    driven = np.flatnonzero(np.abs(moments(model, view.data)).max(axis=0)).tolist()
    follows: dict[int, list[tuple[Equality, int, float]]] = {}
    for one in view.equalities:
        ids = coupled_ids(model, one.index) if one.kind.holds == "joints" else []
        polynomial = model.eq_data[one.index, :5]
        if len(ids) != 2 or not polynomial[1] or polynomial[2:].any() or one.name in told_of:
            continue
        units = {coupled(one.kind).unit(model, joint) for joint in ids}
        first, second = (int(model.jnt_dofadr[joint]) in driven for joint in ids)
        if first and not second and len(units) == 1 and abs(abs(polynomial[1]) - 1.0) > ALIKE:
            follows.setdefault(ids[0], []).append((one, ids[1], float(polynomial[1])))
    for lead, ones in follows.items():
        carried = [each for each in ones if _carries(view, lead, each[1])]
        if ones[1:] or carried:
            yield _led(view, lead, ones)


def _carries(view: View, first: int, second: int) -> bool:
    """Whether the body of a joint carries that of another one."""
    model, body = view.model, int(view.model.jnt_bodyid[second])
    while body and body != model.jnt_bodyid[first]:
        body = int(model.body_parentid[body])
    return body == int(model.jnt_bodyid[first]) and body != int(model.jnt_bodyid[second])


def _led(view: View, lead: int, ones: list[tuple[Equality, int, float]]) -> Remark:
    first, joint, ratio = ones[0]
    names = [element_name(view.model, JOINT, each) for each in (lead, joint)]
    said = (
        f"says {names[0]} = {told(ratio)} · {names[1]}, so that {quoted(names[1])} moves by {told(1.0 / ratio)} of "
        f"{quoted(names[0])}: joint1 follows joint2, and {quoted(names[0])} is the one that is driven; joint1 and "
        f'joint2 swapped? joint1="{names[1]}" joint2="{names[0]}" makes it {told(ratio)}'
    )
    if ones[1:]:
        said += f"; the same of {few([quoted(one.name) for one, *_ in ones[1:]], last='and')}"
    return Remark("L13", said, first.name, figures={"also": [one.name for one, *_ in ones[1:]], "ratio": ratio})


def _by_ranges(view: View) -> Iterator[Remark]:
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
