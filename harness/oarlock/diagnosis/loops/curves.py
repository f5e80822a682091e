"""The poses of one group of loops: how far one joint can go, and the curve of poses of a group with one freedom."""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.loops import Loops
from oarlock.poses.assembly import Assembly

CLOSED = 1e-9
"""m or rad. What is left of the rows of a group that counts as closed on the way."""

ROUNDS = 30
"""Newton steps to close a group at most."""

FAR = 0.3
"""rad, or of the size: Newton does not go further at a time, nor end further from where it was sent."""

ARC = 0.05
"""rad, or of the size: steps along a curve of poses."""

ARCS = 800
"""Steps at most each way: 40 rad, six turns of all joints together."""

VANISHES = 1e-7
"""Of the largest singular value of a group's rows at a closed pose: less is rounding."""

_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


@dataclass(frozen=True)
class Reach:
    """How far a joint can go one way while its loops stay closed.

    Attributes:
        limit: its largest (or least) coordinate, rad or m; infinite where no end was found.
        pose: the pose (nq) there.
    """

    limit: float
    pose: np.ndarray


class Linkage:
    """One group of loops, all joints of which are hinges and slides.

    Attributes:
        joints: of the group; dofs, places: of their velocities and coordinates.
        size: a length that slides are measured by, m.
    """

    def __init__(self, assembly: Assembly, loops: Loops, group: int, size: float):
        self._assembly, model = assembly, assembly.model
        self.dofs = np.array(loops.dofs(group), dtype=int)
        self.joints = [int(joint) for joint in model.dof_jntid[self.dofs]]
        self.places = np.array([int(model.jnt_qposadr[joint]) for joint in self.joints], dtype=int)
        names = set(loops.groups[group].equalities)
        numbers = [number for number, one in enumerate(assembly.equalities) if one.name in names]
        self._rows = assembly.rows_of_all(numbers)
        slides = model.jnt_type[self.joints] == mujoco.mjtJoint.mjJNT_SLIDE
        self._turns = ~slides
        self._units = np.where(slides, size, 1.0)
        self.size = size
        zero = {(one.name, label) for one in loops.loops if one.group == group for label in one.zero_rows}
        named = [assembly.rows[row] for row in self._rows]
        self._holding = np.array(
            [row for row, one in zip(self._rows, named, strict=True) if (one.equality, one.label) not in zero],
            dtype=int,
        )

    @staticmethod
    def serves(model: mujoco.MjModel, loops: Loops, group: int) -> bool:
        """Whether a group has hinges and slides only."""
        kinds = model.jnt_type[model.dof_jntid[loops.dofs(group)]]
        return bool(len(kinds)) and bool(np.isin(kinds, _SCALAR).all())

    def unit_of(self, joint: int) -> str:
        """Unit of a joint's coordinate."""
        return "rad" if self._turns[self.joints.index(joint)] else "m"

    def place(self, qpos: np.ndarray) -> None:
        """Goes to a pose (nq)."""
        self._assembly.place(qpos)

    @property
    def pose(self) -> np.ndarray:
        """The present pose (nq)."""
        return self._assembly.data.qpos.copy()

    def coordinates(self, qpos: np.ndarray) -> np.ndarray:
        """Those of the group (k), slides in sizes."""
        return qpos[..., self.places] / self._units

    def apart(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Largest distance of poses (…, k) of ``coordinates`` from another (k): hinges modulo whole turns."""
        return self.apart_each(first, second).max(axis=-1)

    def apart_each(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """The same of every coordinate (…, k)."""
        difference = np.abs(first - second)
        turned = np.abs(np.mod(difference + np.pi, 2.0 * np.pi) - np.pi)
        return np.where(self._turns, turned, difference)

    def _jacobian(self) -> np.ndarray:
        return self._assembly.jacobian()[np.ix_(self._rows, self.dofs)] * self._units

    def _residual(self) -> np.ndarray:
        return self._assembly.residual()[self._rows]

    def _move(self, by: np.ndarray) -> None:
        pose = self.pose
        pose[self.places] += by * self._units
        self.place(pose)

    def close(self, held: int | None = None) -> bool:
        """Closes the group from the present pose, perhaps with one of its joints held (its place among ``joints``)."""
        begun = self.coordinates(self.pose)
        free = np.ones(len(self.joints), dtype=bool)
        if held is not None:
            free[held] = False
        best = np.inf
        for _ in range(ROUNDS):
            residual = self._residual()
            size = float(np.abs(residual).max(initial=0.0))
            if size <= CLOSED:
                return float(np.abs(self.coordinates(self.pose) - begun).max()) <= FAR
            if not np.isfinite(size) or size > 4.0 * best:
                return False
            best = min(best, size)
            step = np.zeros(len(self.joints))
            step[free] = np.linalg.lstsq(self._jacobian()[:, free], -residual, rcond=VANISHES)[0]
            self._move(step * min(1.0, FAR / max(float(np.abs(step).max()), FAR)))
        return False

    def reach(self, start: np.ndarray, joint: int, way: float, furthest: float) -> Reach:
        """Sends one joint on, in steps of ``ARC``, until the others cannot follow.

        Args:
            start: closed pose (nq).
            joint: its number in the model.
            way: 1.0 or −1.0.
            furthest: how far, rad or m, before no end is looked for any more.
        """
        held, pose = self.joints.index(joint), start
        place, unit = self.places[held], self._units[held]
        gone, arc = 0.0, ARC
        while gone < furthest:
            tried = pose.copy()
            tried[place] += way * arc * unit
            self.place(tried)
            if self.close(held):
                pose, gone = self.pose, gone + arc * unit
                continue
            arc *= 0.5
            if arc < 1e-9:
                return Reach(float(pose[place]), pose)
        return Reach(way * np.inf, pose)

    def curve(self, start: np.ndarray) -> tuple[np.ndarray, bool]:
        """All poses of a group with one freedom that its motion through a pose comes to.

        Args:
            start: closed pose (nq).

        Returns:
            ``coordinates`` (n, k) some ``ARC`` apart, and whether they are all: the curve came back to where it began,
            or to an end at both sides.
        """
        self.place(start)
        begun = self.coordinates(start)
        first = self._tangent(None)
        every, ends = [begun], 0
        for way in (1.0, -1.0):
            self.place(start)
            tangent = way * first
            for number in range(ARCS):
                before = self.pose
                self._move(ARC * tangent)
                if not self.close():
                    self.place(before)
                    ends += 1
                    break
                here = self.coordinates(self.pose)
                every.append(here)
                if number > 3 and float(self.apart(here, begun)) < 0.6 * ARC:
                    return np.array(every), True
                tangent = self._tangent(tangent)
        return np.array(every), ends == 2

    @property
    def oriented(self) -> bool:
        """Whether the group has one freedom and no row too many, so that ``along`` is known."""
        return len(self._holding) + 1 == len(self.joints)

    def along(self, qpos: np.ndarray, move: np.ndarray) -> float:
        """Part of a move (k) along the motion t that the rows admit at a pose (nq): |t| = 1, (J, t) right-handed.

        Along a curve of closed poses t changes steadily. Who goes straight through a pose at which two curves cross, or
        jumps from one to another beside it, finds it reversed. 0 where the rows do not tell.
        """
        self.place(qpos)
        rows = self._assembly.jacobian()[self._holding][:, self.dofs] * self._units
        # With J x = 0 and move · x = 1, x is t over move · t, whose sign is that of the determinant of (J, move).
        whole = np.vstack([rows, move])
        last = np.zeros(len(whole))
        last[-1] = 1.0
        try:
            length = float(np.linalg.norm(np.linalg.solve(whole, last)))
        except np.linalg.LinAlgError:
            return 0.0
        return float(np.linalg.slogdet(whole)[0]) / length if np.isfinite(length) else 0.0

    def _tangent(self, before: np.ndarray | None) -> np.ndarray:
        """The way on: of motions that the rows admit the one that is nearest to the last one."""
        _, sizes, directions = np.linalg.svd(self._jacobian())
        full = np.zeros(len(self.joints))
        full[: len(sizes)] = sizes
        if before is None:
            return directions[-1]
        null = directions[full <= max(1e-2 * full[0], full[-1])]
        ahead = null.T @ (null @ before)
        return ahead / np.linalg.norm(ahead)
