"""What a row of the Python path says: figures of one state, of the solves of a step, and of its projection."""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from oarlock.base.arrays import largest, relative_difference
from oarlock.base.core import Info
from oarlock.base.numbers import finite
from oarlock.base.vectors import times
from oarlock.mechanics import newton
from oarlock.stepping.inequalities import Inequalities, Push, Rows
from oarlock.stepping.prepared import Prepared
from oarlock.stepping.projection import Projector
from oarlock.stepping.question import Answer
from oarlock.stepping.state import State

Row = dict[str, Any]
"""Column → entry, of one step."""


def place(prepared: Prepared, step: int, data: mujoco.MjData, rate: np.ndarray | None = None) -> Row:
    """Where a step starts: time, state, controls, how open the rows are, and how far it is from an outside truth.

    ``rate`` (ne) is how fast they open, where that is not J v.
    """
    row: Row = {
        "step": step,
        "time_s": data.time,
        "drift_pos": float(largest(data.efc_pos[: data.ne])),
        "drift_vel": float(largest(data.efc_vel[: data.ne] if rate is None else rate)),
        "qpos": data.qpos.tolist(),
        "qvel": data.qvel.tolist(),
        "ctrl": data.ctrl.tolist(),
    }
    if prepared.observed is not None:
        row["truth_error"] = prepared.truth_error(step, data)
    return row


def answered(prepared: Prepared, step: int, state: State, qacc: np.ndarray, multipliers: np.ndarray) -> Row:
    """The same, with an answer to the state: acceleration (nv) and multipliers (ne)."""
    return {
        **place(prepared, step, state.data, state.rate),
        "drift_acc": drift(state, qacc)[2],
        "residual": state.residual.tolist(),
        "multipliers": multipliers.tolist(),
    }


def drift(state: State, qacc: np.ndarray) -> tuple[float, float, float]:
    """How open the worst row is: position r, velocity ṙ, acceleration r̈ (m or rad, per s, per s²)."""
    acceleration = times(state.jacobian, qacc) + state.curvature
    return float(largest(state.residual)), float(largest(state.rate)), float(largest(acceleration))


def parity(answer: Answer, minimum: np.ndarray, qacc: np.ndarray, qfrc: np.ndarray) -> Row:
    """How far an answer is from the minimum-norm multipliers (ne) and from MuJoCo's qacc and qfrc (nv)."""
    return {
        "min_norm_error": float(relative_difference(answer.multipliers, minimum)),
        "qacc_rel_diff": float(relative_difference(answer.qacc, qacc)),
        "qfrc_constraint_rel_diff": float(relative_difference(answer.qfrc, qfrc)),
    }


def solving(infos: Sequence[Info], known: Info) -> Row:
    """What the solves of a step took.

    ``known`` gives rank and inconsistency, which are the question's: not every solver finds them.
    """
    wrong = [info.status for info in infos if info.status != "converged"]
    return {
        "status": wrong[0] if wrong else "converged",
        "solves": len(infos),
        "unconverged": len(wrong),
        "iterations": sum(info.iterations for info in infos),
        "iterations_worst": max(info.iterations for info in infos),
        "products": sum(info.products for info in infos),
        # A new fold changes the size, and a solver has to start from something: that is counted apart.
        "refreshes": sum(info.refreshed and not info.refolded for info in infos),
        "refolds": sum(info.refolded for info in infos),
        "residual_rel": float(np.max([info.residual_rel for info in infos])),  # unlike max(), it keeps a NaN
        "solve_ns": sum(info.elapsed_ns for info in infos),
        "rank": known.rank,
        "inconsistency": known.inconsistency,
        "rank_margin": finite(known.margin),
        "rank_rises": int(known.risen or any(info.risen for info in infos)),
    }


def loads(rows: Rows | None, forces: np.ndarray) -> Row:
    """How many limits, friction losses and contacts there are, and how hard they push with such forces (m)."""
    if rows is None or len(rows) != len(forces):
        return {}
    found = rows.loads(forces)
    return {
        "inequalities": len(rows),
        "limit_force": found.limit,
        "friction_force": found.friction,
        "contact_force": found.contact,
    }


def pushing(rows: Rows | None, inequalities: Inequalities) -> Row:
    """What they do at the start of a step."""
    report = inequalities.report
    if report is None:
        return {}
    return {**loads(rows, inequalities.forces), "active": report.active, "blocked": report.blocked}


def proving(pushes: Sequence[Push]) -> Row:
    """What it took to find that out, in all solves of a step."""
    if not pushes:
        return {}
    proofs = [certificate for _, certificate in pushes if certificate is not None]
    gradients = [max(proof.gradient - proof.rounding, 0.0) for proof in proofs]
    return {
        "active_changes": int(any(report.changed for report, _ in pushes)),
        "newton": sum(report.iterations for report, _ in pushes),
        "newton_worst": max(report.iterations for report, _ in pushes),
        "optimality": max(gradients, default=0.0),
    }


def gradient(state: State, qacc: np.ndarray, qfrc: np.ndarray) -> Row:
    """How far MuJoCo's answer (nv) is from the minimum that it is after: ‖M a − f − Jᵀ λ‖ over ‖f‖ + ‖Jᵀ λ‖."""
    if state.others is None:
        return {}
    return {"mujoco_optimality": newton.gradient(state.model, state.data, qacc, qfrc)}


def projecting(projector: Projector | None) -> Row:
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
