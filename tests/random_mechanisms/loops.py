"""Random loops: planar and spatial, on the ground or on a base that moves, closed in several ways."""

from collections.abc import Callable

import numpy as np

from random_mechanisms.parts import GROUND, Body, Group, direction, turned

Joint = tuple[str, np.ndarray | None]


def _mount(group: Group, origin: np.ndarray) -> Body | None:
    """What a loop stands on: the ground, or a base that lets its drift show as rank."""
    kind = group.rng.choice(["ground", "ball", "hinge", "free"], p=[0.55, 0.2, 0.1, 0.15])
    if kind == "ground":
        return GROUND
    joint: Joint = (str(kind), direction(group.rng) if kind == "hinge" else None)
    return group.body(origin, origin + 0.3 * direction(group.rng), [joint])


def _arm(group: Group, base: Body | None, points: list[np.ndarray], joints: list[Joint]) -> list[Body]:
    """A chain of bodies from point to point, with a joint at the beginning of each."""
    found: list[Body] = []
    for place, end, joint in zip(points, points[1:], joints, strict=False):
        found.append(group.body(place, end, [joint], found[-1] if found else base))
    return found


def planar(group: Group) -> None:
    """Hinges of one direction, and slides across it: two arms whose ends are joined, on the ground or on a base."""
    rng, group.kind = group.rng, "planar"
    frame = np.eye(3)[:, rng.permutation(3)] if rng.random() < 0.3 else turned(rng)
    origin = rng.uniform(-1, 1, 3)
    base = _mount(group, origin)

    def point(x: float, y: float) -> np.ndarray:
        return origin + x * frame[:, 0] + y * frame[:, 1]

    left, right = int(rng.integers(1, 4)), int(rng.integers(0, 3))
    left = max(left, 3 - right)
    tip = np.array([rng.uniform(0.3, 0.7), rng.uniform(0.3, 0.6)])

    def between(start: np.ndarray, count: int) -> list[np.ndarray]:
        """So many bars from a start to the tip, bent."""
        shares = np.linspace(0, 1, count + 1)[:, None]
        bent = (1 - shares) * start + shares * tip
        bent[1:-1] += rng.uniform(0.1, 0.3, (count - 1, 2)) * rng.choice([-1.0, 1.0], (count - 1, 2))
        return [point(*place) for place in bent]

    def joints(count: int) -> list[Joint]:
        sliding = rng.random(count) < 0.1
        across = [np.cos(angle) * frame[:, 0] + np.sin(angle) * frame[:, 1] for angle in rng.uniform(0, 6, count)]
        return [
            ("slide", axis) if slides else ("hinge", frame[:, 2]) for slides, axis in zip(sliding, across, strict=True)
        ]

    arm = _arm(group, base, between(np.zeros(2), left), joints(left))
    other = _arm(group, base, between(np.array([rng.uniform(0.5, 0.9), 0.0]), right), joints(right)) if right else []
    ends, joined, count = (arm[-1], other[-1] if other else base), point(*tip), left + right
    way = rng.choice(["connect", "double", "two", "weld"], p=[0.5, 0.15, 0.15, 0.2])
    group.kind += f" {way}"
    if way == "weld":
        group.weld(*ends, joined)
    else:
        group.connect(*ends, joined)
    if way == "double":
        group.connect(*ends, joined)
    if way == "two":
        group.connect(*ends, point(*(tip + rng.uniform(0.05, 0.2, 2))))
    if all(kind == "hinge" for body in (*arm, *other) for _, kind, _ in body.joints):
        group.known_rank = min(count, 3 if way in ("weld", "two") else 2)


def parallel_cranks(group: Group) -> None:
    """A platform on equal cranks: with three of them it moves only because they are equal."""
    rng, group.kind = group.rng, "cranks"
    frame, origin = turned(rng), rng.uniform(-1, 1, 3)
    base, count = _mount(group, origin), int(rng.integers(2, 4))
    angle = rng.uniform(0.6, 2.5)
    bar = rng.uniform(0.2, 0.5) * (np.cos(angle) * frame[:, 0] + np.sin(angle) * frame[:, 1])
    hinge: Joint = ("hinge", frame[:, 2])
    feet = [origin + (0.4 * number) * frame[:, 0] + rng.uniform(-0.15, 0.15) * frame[:, 1] for number in range(count)]
    cranks = [group.body(foot, foot + bar, [hinge], base) for foot in feet]
    platform = group.body(feet[0] + bar, feet[-1] + bar, [hinge], cranks[0])
    for foot, crank in zip(feet[1:], cranks[1:], strict=True):
        group.connect(platform, crank, foot + bar)
    group.known_rank = count


def bennett(group: Group) -> None:
    """Bennett's linkage: four skew hinges that move because a / sin α = b / sin β, and would not otherwise.

    tan θ₁/2 tan θ₂/2 = sin (β + α)/2 / sin (β − α)/2, and θ₃ = −θ₁, θ₄ = −θ₂ (Bennett 1903).
    """
    rng, group.kind, group.known_rank = group.rng, "bennett", 2
    alpha, beta = rng.uniform(0.4, 0.9), rng.uniform(1.2, 2.0)
    lengths = 0.4 * np.sin([alpha, beta])
    first = rng.uniform(0.8, 2.2)
    second = 2.0 * np.arctan(np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2) / np.tan(first / 2))
    frame, place = turned(rng), rng.uniform(-1, 1, 3)
    base = _mount(group, place)
    places, axes = [place], [frame[:, 2]]
    for turn, length, twist in zip((first, second, -first), lengths[[0, 1, 0]], (alpha, beta, alpha), strict=True):
        x, y, z = frame.T
        x, y = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
        place = place + length * x
        frame = np.stack([x, np.cos(twist) * y + np.sin(twist) * z, np.cos(twist) * z - np.sin(twist) * y], axis=1)
        places.append(place)
        axes.append(frame[:, 2])
    arm = _arm(group, base, places, [("hinge", axis) for axis in axes[:3]])
    for along in (0.0, 0.2):
        group.connect(arm[-1], base, places[3] + along * axes[3])


def spatial(group: Group) -> None:
    """Hinges in all directions, balls and slides: two arms whose ends are joined, or welded."""
    rng, group.kind = group.rng, "spatial"
    origin = rng.uniform(-1, 1, 3)
    base = _mount(group, origin)

    def joint() -> Joint:
        kind = str(rng.choice(["hinge", "ball", "slide"], p=[0.7, 0.2, 0.1]))
        return kind, None if kind == "ball" else direction(rng)

    def steps(start: np.ndarray, count: int) -> list[np.ndarray]:
        return [start, *(start + np.cumsum(rng.uniform(-0.4, 0.4, (count, 3)), axis=0))]

    left, right = int(rng.integers(2, 5)), int(rng.integers(0, 3))
    arm = _arm(group, base, steps(origin, left), [joint() for _ in range(left)])
    other = _arm(group, base, steps(origin + 0.5 * direction(rng), right), [joint() for _ in range(right)])
    ends, tip = (arm[-1], other[-1] if other else base), arm[-1].place + 0.3 * direction(rng)
    way = rng.choice(["connect", "double", "two", "three", "weld", "both"], p=[0.35, 0.1, 0.2, 0.05, 0.2, 0.1])
    group.kind += f" {way}"
    if way in ("weld", "both"):
        group.weld(*ends, tip)
    if way != "weld":
        group.connect(*ends, tip)
    if way == "double":
        group.connect(*ends, tip)
    for _ in range({"two": 1, "three": 2}.get(way, 0)):
        group.connect(*ends, tip + 0.2 * direction(rng))


def pallet(group: Group) -> None:
    """A free body, welded to the world or to a pendulum, and joined to it besides."""
    rng, group.kind = group.rng, "pallet"
    place = rng.uniform(-1, 1, 3)
    free = group.body(place, place + 0.3 * direction(rng), [("free", None)])
    other = GROUND
    if rng.random() < 0.6:
        hook = place + 0.5 * direction(rng)
        other = group.body(hook, place, [("hinge", direction(rng))])
    group.weld(free, other, place)
    if rng.random() < 0.5:
        group.connect(free, other, place + 0.2 * direction(rng))
    group.known_rank = 6


LOOPS: dict[Callable[[Group], None], float] = {
    planar: 0.45,
    parallel_cranks: 0.1,
    bennett: 0.05,
    spatial: 0.35,
    pallet: 0.05,
}
"""Kind of loop → how often."""
