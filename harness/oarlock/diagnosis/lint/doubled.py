"""L11 and L12: equalities that say what another one says, and those that join what cannot move apart."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import BODY, Remark, View
from oarlock.mechanics.coupled import coupled_ids
from oarlock.mechanics.names import Equality, element_name

SAME = 1e-9
"""m, and in coefficients: written alike."""


def look(view: View) -> Iterator[Remark]:
    """A remark an equality that could be left out as it is written."""
    idle = [one for one in view.equalities if _idle(view, one)]
    for one in idle:
        first, second = (view.body(body) for body in one.bodies)
        if one.bodies[0] == one.bodies[1]:
            said = f"joins '{first}' to itself: it holds nothing"
        else:
            said = f"joins '{first}' to '{second}', and no joint lies between the two: it holds nothing"
        yield Remark("L12", said, one.name, figures={"bodies": [first, second]})
    rest = [one for one in view.equalities if one not in idle and one.kind.known]
    repeated: set[str] = set()
    for first, second in combinations(rest, 2):
        if second.name not in repeated and (why := _repeats(view, first, second)):
            repeated.add(second.name)
            yield Remark("L11", why, second.name, figures={"also": [first.name]})


def _idle(view: View, one: Equality) -> bool:
    if not one.kind.joins_points:
        return False
    model = view.model
    moved = any(model.body_mocapid[model.body_rootid[body]] >= 0 for body in one.bodies)
    first, second = (int(model.body_weldid[body]) for body in one.bodies)
    return first == second and (one.bodies[0] == one.bodies[1] or not moved)


def _repeats(view: View, first: Equality, second: Equality) -> str:
    """Why the second says nothing that the first does not say; empty if it does."""
    model = view.model
    if first.kind.joins_points != second.kind.joins_points:
        return ""
    if not first.kind.joins_points:
        alike = first.kind is second.kind and coupled_ids(model, first.index) == coupled_ids(model, second.index)
        same = np.allclose(model.eq_data[first.index, :5], model.eq_data[second.index, :5], rtol=0, atol=SAME)
        return f"says the same as {quoted(first.name)}" if alike and same else ""
    if sorted(first.bodies) != sorted(second.bodies):
        return ""
    between = " and ".join(f"'{element_name(model, BODY, body)}'" for body in second.bodies)
    if first.kind.turns:
        return f"says again what the weld {quoted(first.name)} says of {between}"
    if second.kind.turns:
        return ""  # it says more
    ours, theirs = _anchors(view, first), _anchors(view, second)
    if all(np.abs(ours[body] - theirs[body]).max() <= SAME for body in ours):
        return f"joins {between} at the same point as {quoted(first.name)}"
    return ""


def _anchors(view: View, one: Equality) -> dict[int, np.ndarray]:
    """Body → where it is held, in its frame (3), m."""
    if one.sites:
        return {body: view.model.site_pos[site] for body, site in zip(one.bodies, one.sites, strict=True)}
    return {body: one.anchor(view.model, end) for end, body in enumerate(one.bodies)}
