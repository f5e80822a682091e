"""L11 and L12: equalities that say what another one says, and those that join what cannot move apart."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from oarlock.base.errors import few
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
    repeated = set[str]()
    for one, welds in _joined(view, rest):
        repeated.add(one.name)
        yield Remark("L11", _told(view, one, welds), one.name, figures={"also": [weld.name for weld in welds]})
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
    if sorted(first.bodies) != sorted(second.bodies) or first.kind.turns or second.kind.turns:
        return ""
    ours, theirs = _anchors(view, first), _anchors(view, second)
    if all(np.abs(ours[body] - theirs[body]).max() <= SAME for body in ours):
        return f"joins {_between(view, second)} at the same point as {quoted(first.name)}"
    return ""


def _joined(view: View, every: Sequence[Equality]) -> Iterator[tuple[Equality, list[Equality]]]:
    """Equalities whose bodies are held together rigidly by welds before them in the file, each with these."""
    held = dict[int, list[tuple[int, Equality]]]()
    for one in every:
        if not one.kind.joins_points:
            continue
        first, second = (_rigid(view, body) for body in one.bodies)
        if (way := _way(held, first, second)) is not None:
            yield one, way
        elif one.kind.turns:
            held.setdefault(first, []).append((second, one))
            held.setdefault(second, []).append((first, one))


def _rigid(view: View, body: int) -> int:
    """The first body of those that no joint lies between; a mocap body, which is moved, stands for itself."""
    model = view.model
    root = int(model.body_rootid[body])
    return root if model.body_mocapid[root] >= 0 else int(model.body_weldid[body])


def _way(held: Mapping[int, list[tuple[int, Equality]]], first: int, second: int) -> list[Equality] | None:
    """The fewest welds that lead from a body to another one; None where none do."""
    left, seen = [(first, list[Equality]())], {first}
    for body, way in left:
        if body == second:
            return way
        for other, weld in held.get(body, []):
            if other not in seen:
                seen.add(other)
                left.append((other, [*way, weld]))
    return None


def _told(view: View, one: Equality, welds: Sequence[Equality]) -> str:
    names = few([quoted(weld.name) for weld in welds], last="and")
    if len(welds) == 1 and sorted(welds[0].bodies) == sorted(one.bodies):
        return f"says again what the weld {names} says of {_between(view, one)}"
    verb = "holds" if len(welds) == 1 else "hold"
    return f"joins {_between(view, one)}, which {names} {verb} together rigidly"


def _between(view: View, one: Equality) -> str:
    return " and ".join(f"'{element_name(view.model, BODY, body)}'" for body in one.bodies)


def _anchors(view: View, one: Equality) -> dict[int, np.ndarray]:
    """Body → where it is held, in its frame (3), m."""
    if one.sites:
        return {body: view.model.site_pos[site] for body, site in zip(one.bodies, one.sites, strict=True)}
    return {body: one.anchor(view.model, end) for end, body in enumerate(one.bodies)}
