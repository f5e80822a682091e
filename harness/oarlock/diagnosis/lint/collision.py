"""C4: bodies that an equality joins and that collide.

MuJoCo leaves out contacts of a body with its parent. Two bodies that an equality joins are none to it, however they
overlap at the pin between them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from oarlock.diagnosis.lint.view import Remark, View, told
from oarlock.diagnosis.runs.drifts import VISIBLE, Drift
from oarlock.diagnosis.runs.pushes import Push
from oarlock.mechanics.names import Equality
from oarlock.poses.assembly import anchors

DEEP = 0.02
"""Of half the thickness of the thinner geom: what rests on another one is not so deep in it."""

MOST = 0.5
"""Of the drift. Bodies that touch only later may be meant to; without their contact less than that must be left."""

COUNTS = 0.9
"""Of the drift: where more is left without the contact, it is not what opens the loop."""


@dataclass(frozen=True)
class Collision:
    """A pair of bodies that an equality joins, and that touch.

    Attributes:
        body1, body2: names of those whose geoms touch: what an ``<exclude>`` needs.
        bodies: their numbers.
        equality: its name.
        depth: by which they overlap at the start, m; 0 where they touch only later.
        away: of the contact from the anchor, m.
        drift: how far the equality opens in the run, m or rad; None if it was not measured.
        drift_without: the same without the contacts of all these pairs.
        unit: of the two.
    """

    body1: str
    body2: str
    bodies: tuple[int, int]
    equality: str
    depth: float
    away: float
    drift: float | None = None
    drift_without: float | None = None
    unit: str = "m"


def look(view: View) -> Iterator[Remark]:
    """A remark a pair and equality."""
    yield from tell(find(view))


def find(view: View) -> tuple[Collision, ...]:
    """The pairs that overlap at the start, by MuJoCo's own rules of what may collide."""
    joined = joined_bodies(view)
    found: dict[tuple[int, int, str], Collision] = {}
    for index in range(view.data.ncon if joined else 0):
        contact = view.data.contact[index]
        geoms = [int(geom) for geom in contact.geom]
        if min(geoms) < 0:
            continue
        depth = -float(contact.dist)
        if depth <= DEEP * min(_half_thickness(view, geom) for geom in geoms):
            continue
        first, second = sorted(int(view.model.geom_bodyid[geom]) for geom in geoms)
        for equality in joined.get(_welds(view, (first, second)), []):
            key = (first, second, equality.name)
            if key not in found or found[key].depth < depth:
                away = float(np.linalg.norm(contact.pos - anchors(view.model, view.data, equality)[0]))
                names = view.body(first), view.body(second)
                found[key] = Collision(*names, (first, second), equality.name, depth, away)
    return tuple(sorted(found.values(), key=lambda one: -one.depth))


def later(view: View, pushes: Sequence[Push], known: Sequence[Collision]) -> tuple[Collision, ...]:
    """The pairs that an equality joins and that pushed against each other in a run, besides those that are known."""
    joined, seen = joined_bodies(view), {(one.bodies, one.equality) for one in known}
    found = []
    for push in pushes:
        if len(push.geoms) != 2 or min(push.geoms) < 0:
            continue
        first, second = sorted(int(view.model.geom_bodyid[geom]) for geom in push.geoms)
        for equality in joined.get(_welds(view, (first, second)), []):
            if ((first, second), equality.name) not in seen:
                seen.add(((first, second), equality.name))
                names = view.body(first), view.body(second)
                found.append(Collision(*names, (first, second), equality.name, 0.0, 0.0))
    return tuple(found)


def measured(
    collisions: Sequence[Collision], drifts: Sequence[Drift], without: dict[str, Drift]
) -> tuple[Collision, ...]:
    """With what the equalities drift with and without them; those that touch only later must make most of it."""
    now = {one.equality: one for one in drifts if one.level == "position"}
    found = []
    for one in collisions:
        if one.equality in now and one.equality in without:
            turns = (now[one.equality].radians or 0.0) > (now[one.equality].metres or 0.0)
            one = replace(
                one,
                drift=now[one.equality].largest,
                drift_without=without[one.equality].largest,
                unit="rad" if turns else "m",
            )
        if one.depth > 0.0 or (
            one.drift is not None and one.drift > VISIBLE and (one.drift_without or 0.0) < MOST * one.drift
        ):
            found.append(one)
    return tuple(sorted(found, key=lambda one: -(one.drift or 0.0)))


def joined_bodies(view: View) -> dict[tuple[int, int], list[Equality]]:
    """Pairs of bodies (of what is welded together, its first one) → the equalities that join them."""
    found: dict[tuple[int, int], list[Equality]] = {}
    for one in view.equalities:
        if one.kind.joins_points:
            found.setdefault(_welds(view, one.bodies), []).append(one)
    return found


def _welds(view: View, bodies: tuple[int, int]) -> tuple[int, int]:
    first, second = sorted(int(view.model.body_weldid[body]) for body in bodies)
    return first, second


def _half_thickness(view: View, geom: int) -> float:
    thin = float(view.model.geom_aabb[geom, 3:6].min())
    return thin if thin > 0.0 else float("inf")  # a plane has none


def tell(collisions: Sequence[Collision]) -> Iterator[Remark]:
    """A remark each, with what was measured if it was."""
    several = len({one.bodies for one in collisions}) > 1
    for one in collisions:
        deep = f" by {told(one.depth)} m at the start" if one.depth else " in the run"
        said = f"'{one.body1}' and '{one.body2}', which it joins, collide{deep}"
        severity = None
        if one.drift is not None and one.drift_without is not None:
            which = "contacts of such pairs" if several else "contact between them"
            said += f": it opens by {told(one.drift)} {one.unit}, "
            said += f"by {told(one.drift_without)} {one.unit} without the {which}"
            slight = one.drift <= VISIBLE or one.drift_without > COUNTS * one.drift
            severity = "note" if slight else None
        figures = {
            "body1": one.body1,
            "body2": one.body2,
            "depth": one.depth,
            "drift": one.drift,
            "drift_without": one.drift_without,
            "unit": one.unit,
        }
        yield Remark("C4", f"{said}; exclude the pair", one.equality, severity, figures)
