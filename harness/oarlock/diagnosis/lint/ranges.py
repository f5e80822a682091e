"""C3: a coupling whose joints have ranges that meet in one pose at most: a mimic of −1 with the range of its leader."""

import math
from collections.abc import Iterator

import numpy as np

from oarlock.base.numbers import figure
from oarlock.base.text import quoted
from oarlock.diagnosis.lint.unit import met
from oarlock.diagnosis.lint.view import JOINT, Remark, View
from oarlock.mechanics.coupled import coupled, coupled_ids
from oarlock.mechanics.names import Equality, element_name

PLACES = 257
"""Of a range at which a polynomial is looked at."""

MEETS = 1e-3
"""Of the narrower of the two: ranges that share less have one pose in common."""


def look(view: View) -> Iterator[Remark]:
    """A remark a coupling of two joints that are both limited."""
    model = view.model
    for one in view.equalities:
        if one.kind.holds != "joints":
            continue
        ids = coupled_ids(model, one.index)
        if len(ids) < 2 or not model.jnt_limited[ids].all() or not model.eq_data[one.index, 1:5].any():
            continue
        zeros = model.qpos0[model.jnt_qposadr[ids]]
        first, last = (model.jnt_range[ids[1]] - zeros[1]).tolist()
        places = np.linspace(first, last, PLACES)
        led = zeros[0] + np.polynomial.polynomial.polyval(places, model.eq_data[one.index, :5])
        (low, high), (least, most) = model.jnt_range[ids[0]], (float(led.min()), float(led.max()))
        common = min(high, most) - max(low, least)
        narrower = min(high - low, most - least)
        offset = float(model.eq_data[one.index, 0])
        if offset and met(model, one, math.radians(offset)) and not met(model, one, offset):
            continue  # degrees, which is said of the constant
        if narrower > 0.0 and common <= MEETS * narrower:
            yield _remark(view, one, ids, (least, most), common >= -MEETS * narrower)


def _remark(view: View, one: Equality, ids: list[int], wanted: tuple[float, float], meets: bool) -> Remark:
    """By the range that the leader gives the follower, and whether that and its own touch."""
    model = view.model
    follower, leader = (element_name(model, JOINT, joint) for joint in ids)
    unit = coupled(one.kind).unit(model, ids[0])
    low, high = model.jnt_range[ids[0]]
    where = f"at {figure(_where(wanted, (low, high)), unit)} alone" if meets else "in no pose"
    mirrored = min(high, -wanted[0]) - max(low, -wanted[1]) > MEETS * (wanted[1] - wanted[0])
    or_else = ", or the other sign in its polycoef" if mirrored else ""
    said = (
        f"is met {where}: by the range of {quoted(leader)} it leads {quoted(follower)} from {_told(wanted[0])} to "
        f"{_told(wanted[1])} {unit}, and the range of {quoted(follower)} is {_told(low)} to {_told(high)}; "
        f"a range of {_told(wanted[0])} {_told(wanted[1])} was meant{or_else}?"
    )
    figures = {"also": [], "joint": follower, "wanted": list(wanted)}
    return Remark("C3", said, one.name, "error", figures)


def _where(wanted: tuple[float, float], given: tuple[float, float]) -> float:
    """The one place that two ranges have in common."""
    return 0.5 * (max(wanted[0], given[0]) + min(wanted[1], given[1]))


def _told(value: float) -> str:
    return f"{value + 0.0:.5g}"
