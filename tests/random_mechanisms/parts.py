"""What random mechanisms are made of: bodies in a tree, equalities between them, in groups that do not touch.

All bodies are parallel to the world in the reference pose, and all places are given there. MuJoCo freezes the second
anchor of a connect and the pose of a weld in the reference pose, so that every group is closed there, to rounding.
"""

from dataclasses import dataclass, field

import numpy as np

GROUND = None
"""The parent of a body that stands on the ground, and the second body of an equality with the world."""


def digits(values: np.ndarray | list[float]) -> str:
    """Numbers with all their digits."""
    return " ".join(f"{value:.17g}" for value in np.atleast_1d(values))


@dataclass
class Body:
    """A body of a tree.

    Attributes:
        place: its origin, where its joints are, m.
        joints: ``(name, type, axis)``, axis in the world; None for balls and free joints.
        mass: kg.
        centre: of its mass, m.
        size: its length, m, which its inertia follows from.
    """

    name: str
    place: np.ndarray
    joints: list[tuple[str, str, np.ndarray | None]]
    mass: float
    centre: np.ndarray
    inertia: np.ndarray
    children: list["Body"] = field(default_factory=list)

    def xml(self, parent: np.ndarray) -> str:
        """It and its children; ``parent`` is the place of its parent."""
        joints = "".join(
            f'<joint name="{name}" type="{kind}"/>' if axis is None else
            f'<joint name="{name}" type="{kind}" axis="{digits(axis)}"/>'
            for name, kind, axis in self.joints
        )  # fmt: skip
        children = "".join(child.xml(self.place) for child in self.children)
        return (
            f'<body name="{self.name}" pos="{digits(self.place - parent)}">{joints}'
            f'<inertial pos="{digits(self.centre - self.place)}" mass="{self.mass:.17g}" '
            f'diaginertia="{digits(self.inertia)}"/>{children}</body>\n'
        )


class Group:
    """A mechanism that nothing connects to others in the same file.

    Attributes:
        kind: what it is.
        rng: draws everything about it.
        roots: its bodies on the ground.
        equalities: MJCF of them; names begin with that of the group.
        known_rank: rank of its rows by construction; None where it has to be computed.
        spread: masses within it differ by up to so many powers of ten.
    """

    def __init__(self, name: str, rng: np.random.Generator):
        self.name, self.rng = name, rng
        self.kind = ""
        self.roots: list[Body] = []
        self.equalities: list[str] = []
        self.known_rank: int | None = None
        self.spread = float(rng.choice([0.0, 1.0, 3.0, 6.0], p=[0.45, 0.25, 0.15, 0.15]))
        self._heaviest = 10.0 ** rng.uniform(-2, 2)
        self._count = 0

    def fresh(self, what: str) -> str:
        """A name."""
        self._count += 1
        return f"{self.name}_{what}{self._count}"

    def body(
        self,
        place: np.ndarray,
        end: np.ndarray,
        joints: list[tuple[str, np.ndarray | None]],
        parent: Body | None = GROUND,
        mass: float | None = None,
    ) -> Body:
        """Adds a body from ``place`` to ``end`` (m) with joints ``(type, axis)`` at its place; its mass is drawn."""
        rng = self.rng
        if mass is None:
            mass = float(self._heaviest * 10.0 ** -rng.uniform(0, self.spread))
        length = max(float(np.linalg.norm(end - place)), 0.05)
        centre = place + rng.uniform(0.3, 0.7) * (end - place) + rng.normal(scale=0.05 * length, size=3)
        inertia = mass * length**2 * rng.uniform(0.06, 0.1, size=3)
        named = [(self.fresh("j"), kind, axis) for kind, axis in joints]
        added = Body(self.fresh("b"), place, named, mass, centre, inertia)
        (self.roots if parent is None else parent.children).append(added)
        return added

    def connect(self, body1: Body, body2: Body | None, point: np.ndarray) -> None:
        """Joins a point (m) of two bodies, or of one and the world."""
        self._equality("connect", body1, body2, point)

    def weld(self, body1: Body, body2: Body | None, point: np.ndarray) -> None:
        """Welds two bodies at a point (m), or one to the world."""
        # A weld counts its anchor in the second body, and a weld to the world wants that to be a body that moves.
        if body2 is None:
            self._add("weld", f'body1="{body1.name}"')
        else:
            self._add("weld", f'body1="{body1.name}" body2="{body2.name}" anchor="{digits(point - body2.place)}"')

    def couple(self, joint1: str, joint2: str | None, coefficient: float) -> None:
        """Holds q1 = coefficient · q2, or q1 at its reference if there is no second."""
        second = f'joint2="{joint2}" ' if joint2 else ""
        self._add("joint", f'joint1="{joint1}" {second}polycoef="0 {coefficient if joint2 else 0.0:.17g} 0 0 0"')

    def double(self) -> None:
        """Says one of its equalities again."""
        self.equalities.append(
            self.equalities[self.rng.integers(len(self.equalities))].replace('name="', 'name="again_')
        )

    def _equality(self, kind: str, body1: Body, body2: Body | None, point: np.ndarray) -> None:
        second = f'body2="{body2.name}" ' if body2 else ""
        self._add(kind, f'body1="{body1.name}" {second}anchor="{digits(point - body1.place)}"')

    def _add(self, kind: str, attributes: str) -> None:
        self.equalities.append(f'<{kind} name="{self.fresh("e")}" {attributes}/>\n')


def turned(rng: np.random.Generator) -> np.ndarray:
    """A random rotation matrix (3, 3)."""
    found, upper = np.linalg.qr(rng.normal(size=(3, 3)))
    found = found * np.sign(np.diag(upper))
    return found * np.linalg.det(found)


def direction(rng: np.random.Generator) -> np.ndarray:
    """A random unit vector (3)."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)
