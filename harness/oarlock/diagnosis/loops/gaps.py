"""How far equalities stand open, and which of them cannot be brought together."""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.text import quoted
from oarlock.diagnosis.loops.loops import Loops, loops_at
from oarlock.mechanics.names import Equality
from oarlock.poses.assembly import Assembly
from oarlock.stepping.closing import CONSISTENT

TRIES = ((0.05, 4), (0.2, 6), (0.5, 10))
"""Where a pose is a dead end, others around it are tried: deviation in rad (m on slides, for a model of 1 m), number.
Newton's way may end where the rows' gap is least but not zero, on the wrong side of a dead point."""

TRIES_OF_PART = ((0.2, 4), (0.5, 4))
"""The same for a part of the equalities, when the culprit is looked for."""

INVOLVED = 1e-3
"""Of the largest gap: an equality that stays open by less is not among those that contradict one another."""

VANISHES = 1e-6
"""Of the larger of metres and radians: the smaller one is rounding then, and is not told."""

LOWER = 0.99
"""Of the gap around a start: another pose must be better by so much to be taken for it."""

SETTLES = 3
"""Rounds of the minimisation where rows cannot be closed."""

_SLIDE, _FREE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_FREE)


@dataclass(frozen=True)
class Opening:
    """How far an equality stands open.

    Attributes:
        equality: its name.
        metres: distance of its two points, or deviation of a coupling of slides or tendons; None where it has none.
        radians: angle between its two orientations, or deviation of a coupling of hinges; None where it has none.
    """

    equality: str
    metres: float | None
    radians: float | None

    @property
    def largest(self) -> float:
        """The larger of the two, m or rad."""
        return max(self.metres or 0.0, self.radians or 0.0)

    def __str__(self) -> str:
        return self.told()

    def told(self, per: str = "") -> str:
        """In words, with ``per`` after the units; what is rounding beside the rest is left out."""
        parts = [(self.metres, "m"), (self.radians, "rad")]
        least = VANISHES * self.largest
        return " and ".join(
            f"{value:#.4g} {unit}{per}" for value, unit in parts if value is not None and value >= least
        )


@dataclass(frozen=True)
class Culprits:
    """Equalities that no pose around the start brings together.

    Attributes:
        alone: each of them cannot be closed even by itself; else they cannot hold together, while all but any one can.
        openings: what stays open of each, at the best pose.
    """

    alone: bool
    openings: tuple[Opening, ...]

    @property
    def equalities(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(opening.equality for opening in self.openings)

    def of_first(self) -> str:
        """What is said of the first of them, where its name stands beside it."""
        if self.alone:
            first, *others = self.openings
            return "; ".join([f"is short by {first}", *map(_short, others)])
        others = " and ".join(quoted(name) for name in self.equalities[1:])
        return f"cannot hold together with {others}: {self._together()}"

    def __str__(self) -> str:
        if self.alone:
            return "; ".join(map(_short, self.openings))
        names = " and ".join(quoted(name) for name in self.equalities)
        return f"{names} cannot hold together: {self._together()}"

    def _together(self) -> str:
        short = sum(opening.largest for opening in self.openings)
        unit = "m" if any(opening.metres for opening in self.openings) else "rad"
        return f"short by {short:#.4g} {unit}"


def _short(opening: Opening) -> str:
    return f"{quoted(opening.equality)} is short by {opening}"


def openings_of(assembly: Assembly, residual: np.ndarray, rates: bool = False) -> tuple[Opening, ...]:
    """Gaps of the equalities from deviations of all rows (n), or from their rates."""
    return tuple(
        opening(assembly.model, equality, residual[assembly.rows_of(number)], rates)
        for number, equality in enumerate(assembly.equalities)
    )


def widest(model: mujoco.MjModel, equality: Equality, rows: np.ndarray) -> int:
    """The step at which an equality stands open furthest, by its points or by its angle, from its rows (T, n)."""
    sizes = [np.nan_to_num(one) for one in gaps(model, equality, rows).values()]
    return int(max(sizes, key=lambda one: one.max(initial=0.0)).argmax())


def opening(model: mujoco.MjModel, equality: Equality, rows: np.ndarray, rates: bool = False) -> Opening:
    """The gap of one equality from deviations of its rows (n), or from their rates."""
    found = {unit: float(sizes[0]) for unit, sizes in gaps(model, equality, rows[None], rates).items()}
    return Opening(equality.name, found.get("m"), found.get("rad"))


def gaps(model: mujoco.MjModel, equality: Equality, rows: np.ndarray, rates: bool = False) -> dict[str, np.ndarray]:
    """The gaps of one equality by unit (``m``, ``rad``), each (T), from its rows' deviations (T, n) or their rates.

    The rotation rows of a weld are τ sin(θ/2) of the angle θ, with the torque scale τ; their rates are ½τ θ̇ where the
    weld is closed.
    """
    if not equality.kind.joins_points:
        return {equality.unit: np.abs(rows).max(axis=1, initial=0.0)}
    found = {"m": np.linalg.norm(rows[:, :3], axis=1)}
    scale = equality.torque_scale(model)
    if scale > 0.0:
        sine = np.linalg.norm(rows[:, 3:], axis=1) / scale
        found["rad"] = 2.0 * (sine if rates else np.arcsin(np.minimum(1.0, sine)))
    return found


# Around dead ends.


def open_dofs(assembly: Assembly) -> list[int]:
    """Degrees of freedom of the groups that are open at the present pose."""
    loops = loops_at(assembly, closed=False, dependent=False)
    left = openings_of(assembly, assembly.residual())
    groups = {loop.group for loop, opening in zip(loops.loops, left, strict=True) if opening.largest > CONSISTENT}
    return sorted({dof for group in groups for dof in loops.dofs(group)})


def try_around(assembly: Assembly, given: np.ndarray, tries: tuple[tuple[float, int], ...], dofs: list[int]) -> bool:
    """Closes from poses around one that is a dead end; of the nearest that close, the pose that moves least.

    Where none does, the assembly is left where the rows' squares are least.
    """
    model = assembly.model
    lengths = np.isin(model.jnt_type[model.dof_jntid], (_SLIDE, _FREE))
    unit = np.where(lengths, min(1.0, float(model.stat.extent)), 1.0)
    unit[np.setdiff1d(np.arange(model.nv), dofs)] = 0.0
    rng = np.random.default_rng(0)
    settle(assembly)
    lowest, least_rest = assembly.data.qpos.copy(), float(np.linalg.norm(assembly.residual()))
    for deviation, count in tries:
        best, least = None, np.inf
        for _ in range(count):
            pose = given.copy()
            mujoco.mj_integratePos(model, pose, deviation * unit * rng.normal(size=model.nv), 1.0)
            assembly.place(pose)
            if assembly.close():
                far = float(np.abs(assembly.difference(given, assembly.data.qpos)).max())
                if far < least:
                    best, least = assembly.data.qpos.copy(), far
            elif (rest := float(np.linalg.norm(assembly.residual()))) < LOWER * least_rest:
                lowest, least_rest = assembly.data.qpos.copy(), rest
        if best is not None:
            assembly.place(best)
            return True
    assembly.place(lowest)
    return False


def settle(assembly: Assembly) -> None:
    """Goes on to where the sum of the rows' squares is least: Newton's steps end short of it, for they go for zero."""
    import scipy.optimize  # a seventh of a second, for what hardly any model needs

    model = assembly.model
    for _ in range(SETTLES):
        pose = assembly.data.qpos.copy()

        def objective(change: np.ndarray, pose: np.ndarray = pose) -> tuple[float, np.ndarray]:
            there = pose.copy()
            mujoco.mj_integratePos(model, there, change, 1.0)
            assembly.place(there)
            rest = assembly.residual()
            return 0.5 * float(rest @ rest), assembly.jacobian().T @ rest

        # The gradient is exact where the change is zero, and everywhere without ball and free joints.
        found = scipy.optimize.minimize(objective, np.zeros(model.nv), jac=True, method="BFGS", options={"gtol": 1e-12})
        objective(found.x)


def find_culprits(
    assembly: Assembly, given: np.ndarray, loops: Loops, left: tuple[Opening, ...]
) -> tuple[Culprits, ...]:
    """Of every group that stays open: those that fail alone, else a smallest set that fails together.

    A set is made smallest by leaving out one after the other, and for good where the rest still cannot be closed.
    """
    trial = Assembly(assembly.model, assembly.data)

    def closes(chosen: list[int], dofs: list[int]) -> bool:
        trial.data.eq_active[:] = 0
        for number in chosen:
            trial.data.eq_active[assembly.equalities[number].index] = 1
        trial.place(given)
        return trial.close() or try_around(trial, given, TRIES_OF_PART, dofs)

    def openings(chosen: list[int], dofs: list[int]) -> tuple[Opening, ...]:
        if closes(chosen, dofs):
            return ()
        settle(trial)
        return tuple(openings_of(assembly, trial.residual())[number] for number in chosen)

    found = []
    for group in range(len(loops.groups)):
        members = loops.members(group)
        if max(left[number].largest for number in members) <= CONSISTENT:
            continue
        dofs = loops.dofs(group)
        alone = [number for number in members if not closes([number], dofs)]
        if alone:
            found.append(Culprits(True, tuple(opening for number in alone for opening in openings([number], dofs))))
            continue
        # Where the squares are least the deviations balance, Jᵀr = 0: those that have none take no part in that.
        most = max(left[number].largest for number in members)
        open_ = [number for number in members if left[number].largest > INVOLVED * most]
        needed = members if closes(open_, dofs) else open_
        for number in needed:
            rest = [other for other in needed if other != number]
            if len(rest) > 1 and not closes(rest, dofs):
                needed = rest
        if stays := openings(needed, dofs):
            found.append(Culprits(False, stays))
    return tuple(found)
