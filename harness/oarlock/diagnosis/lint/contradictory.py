"""L9: couplings in a ring that agree in one pose only, or in none."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import JOINT, TENDON, Remark, View
from oarlock.diagnosis.loops.odd import Ask, oddest
from oarlock.mechanics.coupled import coupled, coupled_ids
from oarlock.mechanics.names import Equality, element_name

DIGITS = 1e-6
"""Relative: ratios that are written with six digits or more multiply to 1 within that."""

ROUGH = 1e-2
"""Relative. A ring that misses 1 by less was meant to have it, and too few digits were written."""

STEPS = (-0.2, -0.1, 0.1, 0.2)
"""rad, or dm: so far a ring of polynomials is turned from its start, and has to come back to where it began."""

NEWTON = 20
"""Steps, to read a polynomial backwards."""

Node = tuple[int, int]
"""What is coupled: kind of element, number. (-1, -1) is what does not move."""

GROUND: Node = (-1, -1)


@dataclass(frozen=True)
class Coupling:
    """x_first = p(x_second), or x_first = p(0) of one that is held, with x measured from the model's own pose.

    Attributes:
        equality: it stands for.
        polynomial: coefficients (5), the constant first.
    """

    equality: Equality
    first: Node
    second: Node
    polynomial: np.ndarray

    @property
    def straight(self) -> bool:
        """Whether it is a ratio and an offset."""
        return not self.polynomial[2:].any()

    def onwards(self, value: float, start: Node, guess: float) -> float:
        """The x of the other end, from that of one end; NaN where a polynomial cannot be read backwards."""
        if self.second == GROUND:
            return float(self.polynomial[0]) if start == GROUND else 0.0
        if start == self.second:
            return float(np.polynomial.polynomial.polyval(value, self.polynomial))
        if self.straight:
            return (value - float(self.polynomial[0])) / float(self.polynomial[1])
        slope = np.polynomial.polynomial.polyder(self.polynomial)
        for _ in range(NEWTON):
            rate = float(np.polynomial.polynomial.polyval(guess, slope))
            gap = float(np.polynomial.polynomial.polyval(guess, self.polynomial)) - value
            if abs(gap) <= 1e-14 * max(1.0, abs(value)):
                return guess
            if rate == 0.0:
                break
            guess -= gap / rate
        return float("nan")

    def ratio(self, start: Node) -> float:
        """Of one that is straight, from an end to the other."""
        forward = float(self.polynomial[1])
        return forward if start == self.second else 1.0 / forward


@dataclass(frozen=True)
class Ring:
    """Couplings that lead from an element back to it: ``nodes[i]`` to ``nodes[i + 1]`` by ``couplings[i]``."""

    nodes: tuple[Node, ...]
    couplings: tuple[Coupling, ...]

    @property
    def closing(self) -> Coupling:
        """The last of them in the file."""
        return max(self.couplings, key=lambda one: one.equality.index)


def look(view: View) -> Iterator[Remark]:
    """A remark a ring."""
    for ring in rings(couplings(view)):
        if ring.nodes[0] == GROUND:
            yield from _held(view, ring)
        elif all(one.straight for one in ring.couplings):
            yield from _straight(view, ring)
        else:
            yield from _bent(view, ring)


def couplings(view: View) -> list[Coupling]:
    """Of joint and tendon equalities, in the order of the file."""
    found = []
    for equality in view.equalities:
        sort = _sort(equality)
        if sort < 0:
            continue
        ids = coupled_ids(view.model, equality.index)
        polynomial = view.model.eq_data[equality.index, :5].copy()
        free = len(ids) == 2 and polynomial[1:].any()
        second = (sort, ids[1]) if free else GROUND
        found.append(Coupling(equality, (sort, ids[0]), second, polynomial))
    return found


def rings(every: list[Coupling]) -> list[Ring]:
    """A ring for every coupling whose ends the ones before it already join; each begins at its first coupling."""
    tree: dict[Node, list[Coupling]] = {}
    found = []
    for one in every:
        path = _path(tree, one.first, one.second)
        if path is None:
            tree.setdefault(one.first, []).append(one)
            tree.setdefault(one.second, []).append(one)
            continue
        nodes, passed = path
        found.append(_turned(nodes, [*passed, one]))
    return found


def _path(tree: dict[Node, list[Coupling]], start: Node, goal: Node) -> tuple[list[Node], list[Coupling]] | None:
    """The way between two nodes of a forest."""
    came: dict[Node, Coupling | None] = {start: None}
    waiting = [start]
    while waiting:
        node = waiting.pop(0)
        for one in tree.get(node, []):
            other = one.first if node == one.second else one.second
            if other not in came:
                came[other] = one
                waiting.append(other)
    if goal not in came:
        return None
    nodes, passed = [goal], []
    while (one := came[nodes[-1]]) is not None:
        passed.append(one)
        nodes.append(one.first if nodes[-1] == one.second else one.second)
    return nodes[::-1], passed[::-1]


def _turned(nodes: list[Node], passed: list[Coupling]) -> Ring:
    """Nodes (n) and couplings (n) in a circle, begun at the ground, or at what the first coupling follows."""
    count = len(nodes)
    first = min(range(count), key=lambda at: passed[at].equality.index)
    start = nodes.index(GROUND) if GROUND in nodes else first
    step = 1
    if start == first and nodes[first] not in (GROUND, passed[first].second):  # the other way round
        start, step = (first + 1) % count, -1
    order = [(start + step * at) % count for at in range(count)]
    ways = order if step > 0 else [(at - 1) % count for at in order]
    return Ring(tuple(nodes[at] for at in order), tuple(passed[at] for at in ways))


def _name(view: View, node: Node) -> str:
    return element_name(view.model, JOINT if node[0] == int(JOINT) else TENDON, node[1])


def _place(view: View, node: Node, x: float) -> str:
    """Where an element stands, by its own coordinate."""
    model = view.model
    if node[0] == int(JOINT):
        zero, unit = float(model.qpos0[model.jnt_qposadr[node[1]]]), "m" if model.jnt_type[node[1]] == 2 else "rad"
    else:
        zero, unit = float(model.tendon_length0[node[1]]), "m"
    return f"{quoted(_name(view, node))} = {zero + x + 0.0:.4g} {unit}"


def _circle(view: View, ring: Ring) -> str:
    return " → ".join(_name(view, node) for node in (*ring.nodes, ring.nodes[0]))


def _remark(ring: Ring, said: str, off: float, odd: Coupling | None = None, **figures: float) -> Remark:
    odd = odd or ring.closing
    others = [one.equality.name for one in ring.couplings if one is not odd]
    severity = None if off > ROUGH else "warning"
    return Remark("L9", said, odd.equality.name, severity, {"also": others, **figures})


def _straight(view: View, ring: Ring) -> Iterator[Remark]:
    """Ratios: x comes back as P x + c."""
    product, offset = 1.0, 0.0
    for one, node in zip(ring.couplings, ring.nodes, strict=True):
        product *= one.ratio(node)
        offset = one.onwards(offset, node, 0.0)
    off = abs(product - 1.0)
    if not math.isfinite(product + offset):
        return
    if off <= DIGITS:
        if abs(offset) > DIGITS:
            said = f"the ring {_circle(view, ring)} comes back off by {offset:.4g}: no pose satisfies its offsets"
            yield _remark(ring, said, abs(offset), product=product, offset=offset)
        return
    left = _place(view, ring.nodes[0], offset / (1.0 - product))
    said = f"the ring {_circle(view, ring)} has the product {product:.6g}: only {left} is left"
    asks = [_ask(view, one, product, node) for one, node in zip(ring.couplings, ring.nodes, strict=True)]
    order = sorted(range(len(asks)), key=lambda at: -ring.couplings[at].equality.index)
    own = {one.equality.index for one in ring.couplings}
    beside = [
        _ask(view, one, 1.0, one.second)
        for one in couplings(view)
        if one.straight and one.second != GROUND and one.equality.index not in own
    ]
    at = order[oddest([asks[place] for place in order], beside)[0]]
    odd, ask = ring.couplings[at], asks[at]
    said += f"; with the ratio {ask.wanted:.6g} of {quoted(odd.equality.name)} in place of {ask.given:.6g} it turns"
    if ask.swapped and odd.first[0] == int(JOINT) and not odd.polynomial[0]:
        said += f', which joint1="{_name(view, odd.second)}" joint2="{_name(view, odd.first)}" gives it'
    yield _remark(ring, said, off, odd, product=product, wanted=ask.wanted)


def _ask(view: View, one: Coupling, product: float, start: Node) -> Ask:
    """The ratio of a coupling, and the one with which a ring of some product, entered at an end of it, turns."""
    sorts = [int(view.model.jnt_type[node[1]]) if node[0] == int(JOINT) else -1 for node in (one.first, one.second)]
    given = float(one.polynomial[1])
    return Ask((sorts[0], sorts[1]), given, given * (1.0 / product if start == one.second else product))


def _bent(view: View, ring: Ring) -> Iterator[Remark]:
    """Polynomials: a ring that is meant comes back wherever it stands."""
    start = _x(view, ring.nodes[0])
    missed = []
    for step in STEPS:
        unit = coupled(ring.couplings[0].equality.kind).unit(view.model, ring.nodes[0][1])
        turned = step * (1.0 if unit == "rad" else 0.1)
        x = start + turned
        for at, one in enumerate(ring.couplings):
            after = ring.nodes[(at + 1) % len(ring.nodes)]
            x = one.onwards(x, ring.nodes[at], _x(view, after))
        missed.append(abs(x - start - turned) / abs(turned))
    off = sorted(missed)[1] if np.isfinite(missed).all() else 0.0  # at one of them the curves may cross
    if off <= DIGITS:
        return
    same = len(ring.couplings) == 2
    both = " and ".join(quoted(one.equality.name) for one in ring.couplings)
    said = (
        f"{both} tie the same two by different polynomials"
        if same
        else f"the ring {_circle(view, ring)} does not come back to where it begins"
    )
    yield _remark(ring, f"{said}: off by {off:.2g} of any motion, so that single poses are left", off, error=off)


def _x(view: View, node: Node) -> float:
    """Where an element stands at the start, from the model's own pose."""
    kind = next(one.kind for one in view.equalities if _sort(one) == node[0])
    return coupled(kind).position(view.model, view.data, node[1])


def _sort(equality: Equality) -> int:
    joins = equality.kind.joins_points or not equality.kind.known
    return -1 if joins else int(coupled(equality.kind).object_type)


def _held(view: View, ring: Ring) -> Iterator[Remark]:
    """From one that holds an element to another that does."""
    x = 0.0
    for at, one in enumerate(ring.couplings[:-1]):
        after = ring.nodes[at + 1]
        x = one.onwards(x, ring.nodes[at], _x(view, after))
    last = ring.couplings[-1]
    off = abs(x - float(last.polynomial[0]))
    if not off > DIGITS:
        return
    node = ring.nodes[-1]
    by = f"by {quoted(last.equality.name)} at {_place(view, node, float(last.polynomial[0]))}"
    ways = ", ".join(quoted(one.equality.name) for one in ring.couplings[:-1])
    said = f"held {by}, and by {ways} at {_place(view, node, x)}: no pose satisfies both"
    yield _remark(ring, said, off, error=off)
