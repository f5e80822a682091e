"""Random couplings of joints: gears, trains and rings of them, lead screws, and loops driven through a gear."""

from collections.abc import Callable

import numpy as np

from random_mechanisms.loops import planar, spatial
from random_mechanisms.parts import Group, direction

LARGEST_RATIO = 5.0
"""Powers of ten of a gear."""

LEADS = (0.5e-3, 20e-3)
"""m a turn, of a lead screw."""


def _ratio(rng: np.random.Generator, powers: float = LARGEST_RATIO) -> float:
    return float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(0, powers))


def _per_metre(rng: np.random.Generator) -> float:
    """rad a metre, of a lead screw."""
    return 2.0 * np.pi / float(np.exp(rng.uniform(*np.log(LEADS))))


def _pendulum(group: Group) -> str:
    place = group.rng.uniform(-1, 1, 3)
    return group.body(place, place + 0.3 * direction(group.rng), [("hinge", direction(group.rng))]).joints[0][0]


def _rotor(group: Group) -> str:
    """A light rotor; gives its joint."""
    rng, place = group.rng, group.rng.uniform(-1, 1, 3)
    body = group.body(
        place, place + 0.05 * direction(rng), [("hinge", direction(rng))], mass=10.0 ** rng.uniform(-3, 0)
    )
    return body.joints[0][0]


def gear(group: Group) -> None:
    """A pendulum and a rotor, or the coefficient the other way round."""
    group.kind, ratio = "gear", _ratio(group.rng)
    slow, fast = _pendulum(group), _rotor(group)
    if group.rng.random() < 0.7:
        group.couple(fast, slow, ratio)
    else:
        group.couple(slow, fast, 1.0 / ratio)
    group.known_rank = 1


def train(group: Group) -> None:
    """Pendulums behind one another, each geared to the next; as a ring, the last is coupled to the first once more."""
    rng, count = group.rng, int(group.rng.integers(3, 5))
    joints = [_pendulum(group) for _ in range(count)]
    ratios = [_ratio(rng, LARGEST_RATIO / count) for _ in joints[1:]]
    for first, second, ratio in zip(joints, joints[1:], ratios, strict=False):
        group.couple(first, second, ratio)
    ring = bool(rng.random() < 0.5)
    if ring:
        group.couple(joints[0], joints[-1], float(np.prod(ratios)))
    group.kind = "ring" if ring else "train"
    group.known_rank = count - 1


def screw(group: Group) -> None:
    """A screw and its nut, which may carry a pendulum."""
    rng, group.kind, group.known_rank = group.rng, "screw", 1
    per_metre = _per_metre(rng)
    turning, place, axis = _rotor(group), rng.uniform(-1, 1, 3), direction(rng)
    nut = group.body(place, place + 0.05 * axis, [("slide", axis)])
    if rng.random() < 0.4:
        group.body(place, place + 0.3 * direction(rng), [("hinge", direction(rng))], nut)
    if rng.random() < 0.7:
        group.couple(turning, nut.joints[0][0], per_metre)
    else:
        group.couple(nut.joints[0][0], turning, 1.0 / per_metre)


def lock(group: Group) -> None:
    """A pendulum that is held where it is."""
    group.kind, group.known_rank = "lock", 1
    group.couple(_pendulum(group), None, 0.0)


def servo(group: Group) -> None:
    """A loop with a light rotor geared to one of its hinges, or screwed to one of its slides."""
    rng = group.rng
    (planar if rng.random() < 0.7 else spatial)(group)
    group.kind = f"servo {group.kind}"
    bodies, driven = list(group.roots), []
    while bodies:
        body = bodies.pop()
        driven += [(name, kind) for name, kind, _ in body.joints if kind in ("hinge", "slide")]
        bodies += body.children
    if not driven:
        return
    name, kind = driven[rng.integers(len(driven))]
    group.couple(_rotor(group), name, _ratio(rng) if kind == "hinge" else _per_metre(rng))
    if group.known_rank is not None:
        group.known_rank += 1


COUPLINGS: dict[Callable[[Group], None], float] = {gear: 0.25, train: 0.15, screw: 0.3, lock: 0.05, servo: 0.25}
"""Kind of coupling → how often."""
