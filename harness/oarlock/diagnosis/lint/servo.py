"""A1: actuators whose feedback is too stiff for the timestep, alone and with the loops.

An actuator that pulls with −k l − c l̇ along its length l = rᵀq is a spring and a damper to the mechanism. MuJoCo takes
the spring as it was at the start of a step, under every integrator; the damper too under Euler and RK4, and as it will
be at the end under implicit and implicitfast. Joints' own damping is taken at the end under Euler as well (eulerdamp).
"""

import copy
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from oarlock.base.errors import few
from oarlock.base.numbers import rounded_down
from oarlock.cases.integrators import INTEGRATORS
from oarlock.diagnosis.lint.view import Remark, View
from oarlock.mechanics.engine_version import full_mass
from oarlock.mechanics.names import element_name
from oarlock.mechanics.prepare import integrator_of
from oarlock.mechanics.rows import closing_jacobian
from oarlock.mechanics.servos import moments

SUSPECT = 1.0
"""h²k/I + 2hc/I of an actuator on the mechanism without its loops, where it moves most easily: from here on it is
looked at closely. Nothing is unstable below 4, or 2 where an implicit damper is all there is."""

GROWS = 1.0 + 1e-6
"""Factor of a step that is no rounding."""

HALVINGS = 12
"""Of a stretch of four decades of k, or of h: a bound is right to a quarter of a hundredth then."""

NEAR = 2e-3
"""Relative. A bound that a formula gives is taken where a step is stable that much below it and shakes that much above:
the formula is that of a deviation whose sign turns with every step, and others may grow before it."""

ALIKE = 0.05
"""Relative. Of two bounds closer than that, with the loops and without them, one is told."""

MARGIN = 1.06
"""Times the armature at the edge, which is told with two digits: rounding takes up to a twentieth."""

AT_START, IN_RUN = "at the start and of small motions", "in this run"
"""Where a bound with the loops holds."""

UNSTABLE = "unstable by itself"
"""What is said of one that a step at the start does not bear; a run tells whether it is borne elsewhere."""

_FLAG = mujoco.mjtDisableBit
_IMPLICIT = (int(mujoco.mjtIntegrator.mjINT_IMPLICIT), int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST))


@dataclass(frozen=True)
class Feedback:
    """An actuator as a spring and a damper along a direction.

    Attributes:
        index: of the actuator.
        direction: r (nv).
        spring: k, N/m or N m/rad of its length; damper: c.
    """

    index: int
    direction: np.ndarray
    spring: float
    damper: float


class Linear:
    """A step of a mechanism at one pose, for small deviations: loops as MuJoCo's soft rows, without gravity."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        *,
        loops: bool = True,
        armature: np.ndarray | None = None,
        late: bool | None = None,
    ):
        """At a pose whose position stage is done, with its loops or without.

        Args:
            model: left alone.
            data: at that pose.
            loops: whether its equalities are there.
            armature: inertia (nv) that is added to what each velocity moves.
            late: whether dampers are taken at the end of a step; None: as the integrator has it.
        """
        self.h = float(model.opt.timestep)
        self.order = integrator_of(model).name
        nv, ne = model.nv, data.ne if loops else 0
        mass = full_mass(model, data)
        if armature is not None:
            mass += np.diag(armature)
        self.mass, self.free = mass, np.linalg.inv(mass)
        rows = closing_jacobian(model, data) if ne else np.zeros((0, nv))
        soft = np.diag(data.efc_R[:ne]) if ne else np.zeros((0, 0))
        spring, damper, impedance = data.efc_KBIP[:ne, 0], data.efc_KBIP[:ne, 1], data.efc_KBIP[:ne, 2]
        pulls = self.free @ rows.T @ np.linalg.pinv(rows @ self.free @ rows.T + soft, hermitian=True)
        self.mobile = self.free - pulls @ rows @ self.free
        self.held = (
            self.free
            - self.free
            @ rows.T
            @ np.linalg.pinv(rows @ self.free @ rows.T, rcond=1e-10, hermitian=True)
            @ rows
            @ self.free
        )
        self.rows_spring = pulls @ ((spring * impedance)[:, None] * rows)
        self.rows_damper = pulls @ (damper[:, None] * rows)
        own = model.dof_damping
        self.passive = np.diag(own if own.ndim == 1 else own[:, 0])
        self.taken_late = model.opt.integrator in _IMPLICIT if late is None else late
        self.eulerdamp = not model.opt.disableflags & _FLAG.mjDSBL_EULERDAMP

    def shakes(self, springs: np.ndarray, dampers: np.ndarray) -> bool:
        """Whether a step makes a deviation larger and turns it round, with (nv, nv) of all feedback."""
        damping = dampers + self.passive
        stiff = self.mobile @ springs + self.rows_spring
        damped = self.mobile @ damping + self.rows_damper
        one, zero, h = np.eye(len(stiff)), np.zeros_like(stiff), self.h
        rate = np.block([[zero, one], [-stiff, -damped]])
        if INTEGRATORS[self.order].holds_force:
            late = damping if self.taken_late else self.passive if self.eulerdamp else zero
            slowed = np.linalg.solve(self.mass + h * late, self.mass)
            change = h * slowed @ rate[len(stiff) :]
            after = np.hstack([zero, one]) + change
            step = np.vstack([np.hstack([one, zero]) + h * after, after])
            factors = np.linalg.eigvals(step)
        else:
            z = h * np.linalg.eigvals(rate)
            factors = np.sum([z**power / div for power, div in enumerate(INTEGRATORS[self.order].divisors)], axis=0)
        return bool(((np.abs(factors) > GROWS) & (factors.real < 0.0)).any())

    def edge(self, direction: np.ndarray) -> float:
        """The h k/2 + c of feedback along a direction (nv) at which a step turns a deviation round.

        Of a damper that is taken late it is the h k/2 − c. From v' = −v and q = h v/2, which is linear in k and c.
        """
        h = self.h
        late = self.passive if self.taken_late or self.eulerdamp else np.zeros_like(self.passive)
        slowed = np.linalg.solve(self.mass + h * late, self.mass)
        damped = self.mobile @ self.passive + self.rows_damper
        left = 2.0 * np.eye(len(damped)) - h * slowed @ (0.5 * h * self.rows_spring + damped)
        return 1.0 / float(direction @ np.linalg.solve(left, h * slowed @ self.mobile @ direction))


def look(view: View) -> Iterator[Remark]:
    """A remark an actuator, or one of all that shake the mechanism only together."""
    try:
        yield from list(_shaking(view))
    except np.linalg.LinAlgError:  # numbers beyond all bounds: the run tells where they lead
        return


def _shaking(view: View) -> Iterator[Remark]:
    model, data = view.model, view.data
    every = feedbacks(model, data)
    if not every:
        return
    closed, free = Linear(model, data), Linear(model, data, loops=False)
    numbers = {one.index: _number(one, free.free, free.h) for one in every}
    if sum(numbers.values()) < SUSPECT:
        return
    none = np.zeros((model.nv, model.nv))
    if closed.shakes(none, none) or free.shakes(none, none):
        return  # what shakes without any actuator is a row (T2), or a spring
    alone = [one for one in every if numbers[one.index] >= SUSPECT and free.shakes(*_together([one]))]
    for one in alone:
        yield _remark(view, (free, closed), [one])
    if not alone and closed.shakes(*_together(every)):
        strongest = sorted(every, key=lambda one: -numbers[one.index])
        yield _remark(view, (free, closed), strongest)


def feedbacks(model: mujoco.MjModel, data: mujoco.MjData) -> list[Feedback]:
    """The actuators that act back with an affine bias; the position stage of ``data`` is done."""
    found = []
    for index, moment in enumerate(moments(model, data)):
        if not moment.any() or model.actuator_biastype[index] != mujoco.mjtBias.mjBIAS_AFFINE:
            continue
        spring, damper = -model.actuator_biasprm[index, 1:3]
        if spring > 0.0 or damper > 0.0:
            found.append(Feedback(index, moment, max(0.0, float(spring)), max(0.0, float(damper))))
    return found


def _number(one: Feedback, mobile: np.ndarray, h: float) -> float:
    """h²k/I + 2hc/I with 1/I = r H rᵀ of an inverse inertia H (nv, nv)."""
    return float(one.direction @ mobile @ one.direction) * (h * h * one.spring + 2.0 * h * one.damper)


def _together(ones: list[Feedback], spring: float = 1.0, damper: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Springs and dampers (nv, nv) of actuators, times factors."""
    springs = sum(spring * one.spring * np.outer(one.direction, one.direction) for one in ones)
    dampers = sum(damper * one.damper * np.outer(one.direction, one.direction) for one in ones)
    return np.asarray(springs), np.asarray(dampers)


class Edges:
    """Up to where some actuators are stable, their springs and dampers each with the other held.

    Attributes:
        spring, damper: factors, below which it is stable without the loops and with them; None where the other alone
            shakes, or there is none; infinite where it is none that shakes.
    """

    def __init__(self, linears: tuple[Linear, Linear], ones: list[Feedback]):
        """Of a step without the loops and with them."""
        self._linears, self._ones = linears, ones
        first = ones[0]
        self.spring = self._bounds(True) if first.spring > 0.0 else None
        self.damper = self._bounds(False) if first.damper > 0.0 else None

    def _bounds(self, of_spring: bool) -> tuple[float, float] | None:
        found = [self._bound(linear, of_spring) for linear in self._linears]
        return (found[0], found[1]) if all(found) else None

    def _bound(self, linear: Linear, of_spring: bool) -> float:
        ones = self._ones

        def stable(factor: float) -> bool:
            return not linear.shakes(*_together(ones, factor, 1.0) if of_spring else _together(ones, 1.0, factor))

        if stable(1.0):
            return self._beyond(linear, of_spring, stable)
        return _largest(stable, self._formula(linear, of_spring))

    def _beyond(self, linear: Linear, of_spring: bool, stable: Callable[[float], bool]) -> float:
        """Where it is stable as it is."""
        guess = self._formula(linear, of_spring)
        return guess if 1.0 < guess < math.inf and stable(guess * (1.0 - NEAR)) else math.inf

    def _formula(self, linear: Linear, of_spring: bool) -> float:
        """The factor of one actuator by ``Linear.edge``; NaN where that says nothing."""
        if len(self._ones) > 1 or not INTEGRATORS[linear.order].holds_force:
            return math.nan
        one, h = self._ones[0], linear.h
        edge = linear.edge(one.direction)
        if of_spring:
            return 2.0 * (edge + (one.damper if linear.taken_late else -one.damper)) / (h * one.spring)
        return math.nan if linear.taken_late else (edge - 0.5 * h * one.spring) / one.damper


def _remark(view: View, linears: tuple[Linear, Linear], ones: list[Feedback]) -> Remark:
    """Of an actuator, or of several that shake together, by steps without the loops and with them."""
    model, first, (free, closed) = view.model, ones[0], linears
    names = [element_name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, one.index) for one in ones]
    number = _number(first, free.free, free.h)
    with_loops = max(0.0, _number(first, closed.held, free.h))  # rounding, where they hold it still
    shakes = closed.shakes(*_together(ones))
    edges = Edges(linears, ones)
    own = {"kp": first.spring, "kv": first.damper}
    bounds = {what: found for what, found in (("kp", edges.spring), ("kv", edges.damper)) if found is not None}
    bounds = {what: found for what, found in bounds.items() if min(found) < 1.0}
    clamped = all(bool(model.actuator_forcelimited[one.index]) for one in ones)
    formula = {(True, False): "h²kp/I", (False, True): "2h kv/I"}.get((first.spring > 0.0, first.damper > 0.0))
    said = "" if len(ones) == 1 else f"shakes together with {len(ones) - 1} more; "
    said += f"{formula or 'h²kp/I + 2h kv/I'} {_must(bounds, first, free)} under {closed.order} and is {number:.3g}"
    said += f"{f' for it alone, {with_loops:.3g} with the loops' if view.equalities else ''}"
    said += f", by its {next(iter(bounds))}: " if formula is None and len(bounds) == 1 else ": "
    if not shakes:
        said += "here only the loops hold it, as long as it moves slowly"
    elif clamped:
        said += "its force range keeps it finite, and it chatters"
    else:
        said += UNSTABLE
    safe = [_below(what, own[what], *found) for what, found in bounds.items()]
    step = _timestep(view, ones)
    armature = _armature(view, ones)
    late = not closed.taken_late and first.damper > 0.0 and _bears(view, ones, late=True)
    safe += [f"armature {armature:.2g} on its joint"] if armature else []
    safe += ["integrator implicitfast"] if late else []
    safe += [f"a timestep of {rounded_down(step * free.h, 2):g} s"] if step else []
    said += f"; stable with {few(safe, last=' or ')}" if safe else "; stable with none of it"
    figures: dict[str, object] = {"number": number, "number_with_loops": with_loops}
    for what, found in bounds.items():
        figures |= {what: own[what], f"{what}_stable": min(found) * own[what]}
        figures |= {f"{what}_with_loops": found[1] * own[what]} if _helps(*found) else {}
    figures |= {"timestep_stable_s": step * free.h or None, "armature": armature or None, "also": names[1:]}
    return Remark("A1", said, names[0], "note" if not shakes else "warning" if clamped else None, figures)


def _must(bounds: dict[str, tuple[float, float]], first: Feedback, free: Linear) -> str:
    """What the number must be below, by the first bound of the actuator without the loops."""
    if not bounds:
        return "is too large"
    what, (factor, _) = next(iter(bounds.items()))
    given = (factor, 1.0) if what == "kp" else (1.0, factor)
    at = Feedback(first.index, first.direction, given[0] * first.spring, given[1] * first.damper)
    limit = _number(at, free.free, free.h)
    return f"must be below {limit:.2g}"


def _below(what: str, own: float, alone: float, with_loops: float) -> str:
    """A bound on a gain, and what it is as long as the loops help."""
    least = min(alone, with_loops)
    said = f"{what} below {rounded_down(least * own, 3):g}"
    return said + _beside(with_loops * own, AT_START) if _helps(alone, with_loops) else said


def _helps(alone: float, with_loops: float) -> bool:
    return alone * (1.0 + ALIKE) < with_loops < math.inf


def _beside(gain: float, where: str) -> str:
    return f" ({rounded_down(gain, 3):g} with the loops, {where})"


def measured(remark: Remark, what: str, gain: float | None) -> Remark:
    """A remark with the gain up to which the run is finite in place of what a step at the start says of it.

    Args:
        remark: of an actuator whose bound is another one with the loops: figure ``kp_with_loops`` or ``kv_with_loops``.
        what: ``kp`` or ``kv``.
        gain: that; None: it is not known, and nothing is said of it.
    """
    figures = {name: value for name, value in remark.figures.items() if name != f"{what}_with_loops"}
    said = "" if gain is None else _beside(gain, IN_RUN)
    line = remark.line.replace(_beside(remark.figures[f"{what}_with_loops"], AT_START), said, 1)
    return replace(remark, line=line, figures=figures if gain is None else figures | {f"{what}_with_loops": gain})


def _armature(view: View, ones: list[Feedback]) -> float:
    """What the joint of an actuator would need, kg m² or kg; 0 where it moves several, or that is no cure."""
    dofs = np.flatnonzero(ones[0].direction)
    if len(ones) > 1 or len(dofs) != 1:
        return 0.0
    free, dof = Linear(view.model, view.data, loops=False), int(dofs[0])
    # The direction is along the dof: h²k/I and 2hc/I fall by the same factor 1 + a H.
    needed = MARGIN * (0.25 * _number(ones[0], free.free, free.h) - 1.0) / float(free.free[dof, dof])
    needed = float(f"{needed:.2g}")
    added = np.zeros(view.model.nv)
    added[dof] = needed
    return needed if needed > 0.0 and _bears(view, ones, armature=added) else 0.0


def _bears(view: View, ones: list[Feedback], **given: Any) -> bool:
    """Whether it is stable with the loops and without them: in another pose they may add as good as nothing."""
    feedback = _together(ones)
    return not any(Linear(view.model, view.data, loops=loops, **given).shakes(*feedback) for loops in (False, True))


def _timestep(view: View, ones: list[Feedback]) -> float:
    """The largest factor of the timestep with which it is stable, with the loops and without them; 0: none."""
    model, data = copy.copy(view.model), mujoco.MjData(view.model)
    data.qpos[:], data.qvel[:], data.eq_active[:] = view.data.qpos, view.data.qvel, view.data.eq_active
    data.mocap_pos[:], data.mocap_quat[:] = view.data.mocap_pos, view.data.mocap_quat
    h, feedback = float(model.opt.timestep), _together(ones)

    def stable(factor: float) -> bool:
        model.opt.timestep = factor * h  # what refsafe makes of solref changes too
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        return not any(Linear(model, data, loops=loops).shakes(*feedback) for loops in (False, True))

    free = Linear(view.model, view.data, loops=False)
    spring = _number(Feedback(0, ones[0].direction, ones[0].spring, 0.0), free.free, h)
    damper = _number(Feedback(0, ones[0].direction, 0.0, ones[0].damper), free.free, h)
    # f²a + f b = 4 of a single actuator under Euler; others are looked for.
    return _largest(stable, 8.0 / (damper + math.sqrt(damper * damper + 16.0 * spring)))


def _largest(stable: Callable[[float], bool], guess: float = math.nan) -> float:
    """The largest factor below 1 up to which it is stable, rounded down; 0 if it is not at 1e-4.

    A guess that is right is all it takes.
    """
    if 1e-4 < guess < 1.0 and stable(guess * (1.0 - NEAR)) and not stable(guess * (1.0 + NEAR)):
        return guess * (1.0 - NEAR)
    low, high = -4.0, 0.0
    if not stable(10.0**low):
        return 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(10.0**middle) else (low, middle)
    return 10.0**low
