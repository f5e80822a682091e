"""A1: actuators whose feedback is too stiff for the timestep, alone and with the loops.

An actuator that pulls with −k l − c l̇ along its length l = rᵀq is a spring and a damper to the mechanism. MuJoCo takes
the spring as it was at the start of a step, under every integrator; the damper too under Euler and RK4, and as it will
be at the end under implicit and implicitfast. Joints' own damping is taken at the end under Euler as well (eulerdamp).
"""

import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.cases.integrators import INTEGRATORS
from oarlock.diagnosis.lint.view import Remark, View
from oarlock.mechanics.names import element_name
from oarlock.mechanics.prepare import integrator_of
from oarlock.mechanics.rows import closing_jacobian

SUSPECT = 1.0
"""h²k/I + 2hc/I of an actuator on the mechanism without its loops, where it moves most easily: from here on it is
looked at closely. Nothing is unstable below 4, or 2 where an implicit damper is all there is."""

GROWS = 1.0 + 1e-6
"""Factor of a step that is no rounding."""

HALVINGS = 12
"""Of a stretch of four decades of k, or of h: a bound is right to a quarter of a hundredth then."""

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

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, *, loops: bool = True):
        """At a pose whose position stage is done, with its loops or without."""
        self.h = float(model.opt.timestep)
        self.order = integrator_of(model).name
        nv, ne = model.nv, data.ne if loops else 0
        mass = np.zeros((nv, nv))
        mujoco.mj_fullM(model, data, mass)
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
        self.taken_late = model.opt.integrator in _IMPLICIT
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
        yield _remark(view, closed, [one], numbers[one.index], closed.shakes(*_together([one])))
    if not alone and closed.shakes(*_together(every)):
        strongest = sorted(every, key=lambda one: -numbers[one.index])
        yield _remark(view, closed, strongest, numbers[strongest[0].index], True)


def feedbacks(model: mujoco.MjModel, data: mujoco.MjData) -> list[Feedback]:
    """The actuators that act back with an affine bias; the position stage of ``data`` is done."""
    if not model.nu or model.opt.disableflags & _FLAG.mjDSBL_ACTUATION:
        return []
    moment = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(moment, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    found = []
    for index in range(model.nu):
        group = int(model.actuator_group[index])
        off = 0 <= group < 31 and int(model.opt.disableactuator) >> group & 1
        if off or model.actuator_biastype[index] != mujoco.mjtBias.mjBIAS_AFFINE:
            continue
        spring, damper = -model.actuator_biasprm[index, 1:3]
        if (spring > 0.0 or damper > 0.0) and moment[index].any():
            found.append(Feedback(index, moment[index], max(0.0, float(spring)), max(0.0, float(damper))))
    return found


def _number(one: Feedback, mobile: np.ndarray, h: float) -> float:
    """h²k/I + 2hc/I with 1/I = r H rᵀ of an inverse inertia H (nv, nv)."""
    return float(one.direction @ mobile @ one.direction) * (h * h * one.spring + 2.0 * h * one.damper)


def _together(ones: list[Feedback], factor: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    springs = sum(factor * one.spring * np.outer(one.direction, one.direction) for one in ones)
    dampers = sum(factor * one.damper * np.outer(one.direction, one.direction) for one in ones)
    return np.asarray(springs), np.asarray(dampers)


def _remark(view: View, closed: Linear, ones: list[Feedback], number: float, shakes: bool) -> Remark:
    """Of an actuator, or of several that shake together; ``shakes``: with the loops too, which add their inertia."""
    model, first, h = view.model, ones[0], closed.h
    names = [element_name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, one.index) for one in ones]
    with_loops = max(0.0, _number(first, closed.held, h))  # rounding, where they hold it still
    gain = _largest(lambda factor: _stable(view, h, ones, factor))
    step = _largest(lambda factor: _stable(view, factor * h, ones))
    what = "kp" if first.spring > 0.0 else "kv"
    own = first.spring if what == "kp" else first.damper
    formula = {(True, False): "h²kp/I", (False, True): "2h kv/I"}.get((first.spring > 0.0, first.damper > 0.0))
    loops = f", {with_loops:.3g} with the loops" if view.equalities else ""
    safe = [f"{what} {gain * own:.2g} at {h:g} s"] if gain else []
    safe += [f"a timestep of {step * h:.2g} s"] if step else []
    whose = "" if len(ones) == 1 else f"shakes together with {len(ones) - 1} more; "
    said = f"{whose}{formula or 'h²kp/I + 2h kv/I'} is {number:.3g} for it alone{loops}, under {closed.order}"
    said += f": stable up to {' or up to '.join(safe)}" if safe else ": stable with none of it"
    clamped = all(bool(model.actuator_forcelimited[one.index]) for one in ones)
    if not shakes:
        said += "; here only the loops hold it, as long as it moves slowly"
    elif clamped:
        said += "; its force range keeps it finite, and it chatters"
    figures = {"number": number, "number_with_loops": with_loops, what: own, f"{what}_stable": gain * own or None}
    figures |= {"timestep_stable_s": step * h or None, "also": names[1:]}
    return Remark("A1", said, names[0], "note" if not shakes else "warning" if clamped else None, figures)


def _stable(view: View, timestep_s: float, ones: list[Feedback], factor: float = 1.0) -> bool:
    """Whether it is so with the loops and without them: in another pose they may add as good as nothing."""
    model, data = copy.copy(view.model), view.data
    if timestep_s != model.opt.timestep:  # what refsafe makes of solref changes too
        model.opt.timestep = timestep_s
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.eq_active[:] = view.data.qpos, view.data.qvel, view.data.eq_active
        data.mocap_pos[:], data.mocap_quat[:] = view.data.mocap_pos, view.data.mocap_quat
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
    feedback = _together(ones, factor)
    return not any(Linear(model, data, loops=loops).shakes(*feedback) for loops in (True, False))


def _largest(stable: Callable[[float], bool]) -> float:
    """The largest factor below 1 up to which it is stable, rounded down; 0 if it is not at 1e-4."""
    low, high = -4.0, 0.0
    if not stable(10.0**low):
        return 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(10.0**middle) else (low, middle)
    return 10.0**low
