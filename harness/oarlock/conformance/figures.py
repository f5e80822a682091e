"""What is measured of an engine's answers to one model: differences, drift, cause. A row of the matrix."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from oarlock.base.numbers import finite
from oarlock.conformance.causes import SILENT, Cause, is_single, tell, tell_reader
from oarlock.conformance.contradictions import against
from oarlock.conformance.laws import EXACT, MUJOCO, Laws, apart, forces_apart, norms, opening
from oarlock.conformance.states import Plan
from oarlock.engines.answers import Answer

FIGURES = {
    "qacc_mujoco": "worst ‖Δq̈‖ to MuJoCo",
    "qacc_exact": "worst ‖Δq̈‖ to exact",
    "qacc_rest": "worst ‖Δq̈‖ to MuJoCo at rest",
    "difference": "worst ‖Δq̈‖ to the nearer",
    "force_mujoco": "worst ‖ΔJᵀλ‖ to MuJoCo",
    "force_exact": "worst ‖ΔJᵀλ‖ to exact",
    "step_mujoco": "worst Δq̇ of a step",
    "drift_max": "largest gap of the run",
    "drift_end": "gap at its end",
    "apart_mujoco": "end apart from MuJoCo",
    "apart_exact": "end apart from exact",
}
"""Figure of a row → its heading; relative but for the gaps and ends, m or rad."""


SLOWEST = 1e-6
"""rad/s²: a step that changes velocities by less is measured by this, for what it has of its own is rounding."""


def measure(laws: Laws, plan: Plan, answers: dict[str, Answer]) -> dict[str, Any]:
    """The row of a model and an engine.

    Args:
        laws: of the model and its states.
        plan: of the model.
        answers: question → answer.
    """
    row: dict[str, Any] = {"model": plan.name, **dict.fromkeys(FIGURES)}
    first = next(iter(answers.values()))
    stated = next((answers[one] for one in ("step", "forward") if one in answers and answers[one].expressible), None)
    facts = (stated or first).facts
    row |= {"versions": first.versions, "precision": first.precision, "facts": _brief(facts)}
    row |= {"not_expressible": first.not_expressible, "expected": _expected(laws)}
    if stated is not None:
        row |= _of_states(laws, plan, stated, "step" in answers and answers["step"].expressible)
    run = answers.get("run")
    if run is not None and run.expressible:
        row |= _of_run(laws.model, plan, run)
    if stated is not None:
        cause = against(tell(laws, stated), laws, plan, stated, row)
    elif "rows" in facts or "total_mass" in facts:
        cause = tell_reader(laws, first, row["expected"]["rows"])
    else:
        cause = Cause(SILENT, _silent(first))
    if run is not None and stated is not None:
        cause = _with_run(cause, run)
    return {name: finite(value) for name, value in (row | cause.document()).items()}


def _with_run(cause: Cause, run: Answer) -> Cause:
    """The cause with what became of the run, where it has no figures."""
    if run.ended:
        return replace(cause, text=f"{cause.text}; {run.ended}")
    if not run.expressible:
        return replace(cause, text=f"{cause.text}; its run is {_silent(run)}")
    return cause


def _silent(answer: Answer) -> str:
    told = [f"{one['element']} ({one['why']})" for one in answer.not_expressible]
    return f"not expressible: {'; '.join(told[:2])}" + (f" and {len(told) - 2} more" if len(told) > 2 else "")


_LONG = ("body_masses", "body_places", "equalities", "warnings")
"""Facts that a row does not hold: a figure a body, or words with paths of one occasion."""


def _brief(facts: dict[str, Any]) -> dict[str, Any]:
    told = {name: value for name, value in facts.items() if name not in _LONG}
    apart_by = told.get("compiled_apart")
    return {**told, "compiled_apart": sorted(apart_by)} if isinstance(apart_by, dict) else told


def _expected(laws: Laws) -> dict[str, Any]:
    data = mujoco.MjData(laws.model)
    laws.place(data, 0)
    mujoco.mj_forward(laws.model, data)
    return {"rows": int(data.ne), "total_mass": float(laws.model.body_mass.sum())}


def _of_states(laws: Laws, plan: Plan, answer: Answer, stepped: bool) -> dict[str, Any]:
    shut = slice(0, plan.closed)
    own, exact = laws.installed()[shut], laws.solve(EXACT)[shut]
    moving = np.array(plan.moving)[shut]
    to_mujoco, to_exact = apart(answer.qacc[shut], own), apart(answer.qacc[shut], exact)
    worst = {"qacc_mujoco": float(to_mujoco.max()), "qacc_exact": float(to_exact.max())}
    found: dict[str, Any] = {
        **worst,
        "difference": min(worst.values()),
        "qacc_rest": float(to_mujoco[~moving].max()) if (~moving).any() else None,
        "force_mujoco": float(forces_apart(answer.qfrc_constraint[shut], own).max()),
        "force_exact": float(forces_apart(answer.qfrc_constraint[shut], exact).max()),
        "single": is_single(answer),
        "mujoco_to_law": float(apart(own.qacc, laws.solve(MUJOCO)[shut]).max()),
    }
    if stepped:
        _, qvel = laws.stepped()
        change = norms(qvel - laws.states.qvel, laws.blocks)[shut]
        apart_by = norms(answer.qvel - qvel, laws.blocks)[shut]
        found["step_mujoco"] = float((apart_by / np.maximum(change, SLOWEST * plan.timestep)).max())
    return found


def _of_run(model: mujoco.MjModel, plan: Plan, answer: Answer) -> dict[str, Any]:
    gaps = opening(model, answer.qpos)
    widest = max(float(gaps.max()), float(answer.loop_error.max()) if answer.loop_error is not None else 0.0)
    found: dict[str, Any] = {"drift_max": widest, "drift_end": float(gaps[-1])}
    found["apart_mujoco"] = _apart(model, answer.qpos[-1], np.array(plan.mujoco_end))
    if plan.exact_end is not None:
        found["apart_exact"] = _apart(model, answer.qpos[-1], np.array(plan.exact_end))
    return found


def _apart(model: mujoco.MjModel, qpos: np.ndarray, other: np.ndarray) -> float:
    """Largest difference of two positions (nq) in any coordinate, rad or m."""
    apart_by = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, apart_by, 1.0, np.array(other), np.array(qpos))
    return float(np.abs(apart_by).max(initial=0.0))
