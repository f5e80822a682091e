"""A4: joints whose damping an explicit step does not bear.

Runge–Kutta takes the damping of joints as it was at each of its stages, and Euler without eulerdamp as it was at the
start of a step: a velocity v becomes p(−z) v with z = h d/I and the polynomial p of the method, which grows beyond some
z. Euler with eulerdamp and the implicit integrators take it at the end of a step, and bear any.
"""

from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.base.numbers import rounded_down
from oarlock.base.text import called
from oarlock.cases.integrators import INTEGRATORS
from oarlock.diagnosis.lint.servo import Linear
from oarlock.diagnosis.lint.view import Remark, View
from oarlock.mechanics.names import element_name
from oarlock.mechanics.prepare import integrator_of

MARGIN = 1.06
"""Times the armature at the edge, which is told with two digits."""


def look(view: View) -> Iterator[Remark]:
    """A remark on the joint that leads in the fastest decay, with the loops closed."""
    model, data = view.model, view.data
    integrator = integrator_of(model)
    off = bool(model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    explicit = not integrator.holds_force or (integrator.name == "euler" and off)
    if not explicit or not np.any(model.dof_damping):
        return
    try:
        number, dof, inertia = _fastest(Linear(model, data))
        limit, h = bound(integrator.name), float(model.opt.timestep)
        if not number > limit:
            return
        damping = float(Linear(model, data).passive[dof, dof])
        cures = ["euler with eulerdamp or implicitfast", f"a timestep of {rounded_down(limit / number * h, 2):g} s"]
        added = np.zeros(model.nv)
        added[dof] = float(f"{MARGIN * (number / limit - 1.0) * inertia:.2g}")
        if _fastest(Linear(model, data, armature=added))[0] < limit:
            cures.append(f"armature {added[dof]:g} on it")
    except np.linalg.LinAlgError:  # numbers beyond all bounds: the run tells where they lead
        return
    joint = int(model.dof_jntid[dof])
    slides = int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    units = ("N s/m", "kg") if slides else ("N m s/rad", "kg m²")
    name = element_name(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
    said = (
        f"{called('joint', name)} has a damping of {damping:.4g} {units[0]} on {inertia:.3g} {units[1]}: h d/I is "
        f"{number:.3g}, and {integrator.name}{' without eulerdamp' if off else ''} bears {limit:.4g}; stable with "
        f"{', '.join(cures[:-1])} or {cures[-1]}"
    )
    figures = {"number": number, "bound": limit, "damping": damping, "inertia": inertia}
    yield Remark("A4", said, name, figures=figures)


def bound(integrator: str) -> float:
    """The z up to which |p(−z)| ≤ 1; 2 of a step that holds the force, 2.785 of Runge–Kutta's."""
    if INTEGRATORS[integrator].holds_force:
        return 2.0
    terms = [(-1.0) ** power / divisor for power, divisor in enumerate(INTEGRATORS[integrator].divisors)]
    roots = np.roots(terms[:0:-1])  # p(−z) = 1 less the root at 0
    return float(min(root.real for root in roots if abs(root.imag) < 1e-9 and root.real > 0.0))


def _fastest(linear: Linear) -> tuple[float, int, float]:
    """The largest h d/I, the dof that dissipates most in its motion, and the inertia I there."""
    root = np.sqrt(linear.passive)
    values, vectors = np.linalg.eigh(root @ linear.held @ root)
    dof = int(np.abs(vectors[:, -1]).argmax())
    number = linear.h * float(values[-1])
    return number, dof, linear.h * float(linear.passive[dof, dof]) / max(number, mujoco.mjMINVAL)
