"""Figures of one step."""

import mujoco
import numpy as np

from oarlock.projection import Projector
from oarlock.solvers import Answer
from oarlock.state import State
from oarlock.vectors import norm, times


def relative_difference(value: np.ndarray, reference: np.ndarray) -> float:
    """‖value − reference‖ / ‖reference‖; the absolute difference where the reference is zero."""
    scale, difference = norm(reference), norm(value - reference)
    return difference / scale if scale > 0 else difference


def largest(values: np.ndarray) -> float:
    """Largest magnitude; 0 of nothing."""
    return float(np.abs(values).max()) if len(values) else 0.0


def drift(state: State, qacc: np.ndarray) -> dict[str, float]:
    """How open the worst row is: position r, velocity J v, acceleration J a + J̇v (m or rad, per s, per s²)."""
    return {
        "drift_pos": largest(state.residual),
        "drift_vel": largest(state.rate),
        "drift_acc": largest(times(state.jacobian, qacc) + state.curvature),
    }


def solving(answers: list[Answer], reference: Answer | None) -> dict[str, object]:
    """What the solves of one step took, and how far the first one is from the minimum-norm solution.

    ``reference`` is the pseudo-inverse's answer to the first one's question; it also gives the rank and the
    inconsistency, which are the question's and not every solver knows them.
    """
    infos = [answer.info for answer in answers]
    first = answers[0]
    known = reference.info if reference else first.info
    unconverged = [info.status for info in infos if info.status != "converged"]
    return {
        "status": unconverged[0] if unconverged else "converged",
        "solves": len(infos),
        "unconverged": len(unconverged),
        "iterations": sum(info.iterations for info in infos),
        "iterations_worst": max(info.iterations for info in infos),
        "products": sum(info.products for info in infos),
        # A new fold changes the size, and a solver has to start from something: that is counted apart.
        "refreshes": sum(info.refreshed and not info.refolded for info in infos),
        "refolds": sum(info.refolded for info in infos),
        "residual_rel": max(info.residual_rel for info in infos),
        "solve_ns": sum(info.elapsed_ns for info in infos),
        "rank": known.rank,
        "inconsistency": known.inconsistency,
        "min_norm_error": relative_difference(first.multipliers, reference.multipliers) if reference else None,
    }


def projecting(projector: Projector | None) -> dict[str, object]:
    """What the projection at the end of the step took; nothing if there is none."""
    if projector is None or projector.last is None:
        return {}
    last = projector.last
    return {
        "projection": last.status,
        "projection_rounds": last.rounds,
        "projection_solves": last.solves,
        "projection_iterations": last.iterations,
        "projection_moved": last.moved,
    }


def against_mujoco(answer: Answer, qacc: np.ndarray, qfrc: np.ndarray) -> dict[str, float]:
    """Relative differences of acceleration and constraint force from MuJoCo's at the same state."""
    return {
        "qacc_rel_diff": relative_difference(answer.qacc, qacc),
        "qfrc_constraint_rel_diff": relative_difference(answer.qfrc, qfrc),
    }


class Energy:
    """Mechanical energy (J) of a model that nothing drives or damps; nothing for any other."""

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        rubs = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
        friction = (model.dof_frictionloss, model.tendon_frictionloss) if rubs else ()
        damping = (model.dof_damping, model.dof_dampingpoly, model.tendon_damping, model.tendon_dampingpoly)
        damped = any(loss.any() for loss in (*damping, *friction))
        self._conserved = model.nu == 0 and not damped and model.opt.density == 0 and model.opt.viscosity == 0

    def of(self, data: mujoco.MjData) -> dict[str, float]:
        """Total and kinetic energy at a state whose position and velocity stages are done; nothing if not conserved."""
        if not self._conserved:
            return {}
        mujoco.mj_energyPos(self._model, data)
        mujoco.mj_energyVel(self._model, data)
        potential, kinetic = data.energy
        return {"energy": float(potential + kinetic), "kinetic_energy": float(kinetic)}
