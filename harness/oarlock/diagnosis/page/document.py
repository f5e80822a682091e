"""An examination as data: the JSON document, and the tables of a notebook."""

from collections.abc import Sequence
from dataclasses import asdict, is_dataclass
from typing import Any

import numpy as np
import polars as pl

from oarlock.base.numbers import finite
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.loops.wrenches import Wrench
from oarlock.diagnosis.runs.row_law import CAUSES
from oarlock.diagnosis.runs.trials import Trial
from oarlock.diagnosis.verdict.answer import answer
from oarlock.diagnosis.verdict.findings import Finding
from oarlock.diagnosis.verdict.ranks import hanging
from oarlock.mechanics.flexes import flex_names
from oarlock.tables.provenance import occasion, versions


def document(exam: Examination, findings: Sequence[Finding]) -> dict[str, Any]:
    """All figures of an examination but those over time: what ``oarlock check --json`` writes.

    Lengths in m, angles in rad, forces in N, torques in N m, energies in J; what is not finite or not known is null.
    """
    return _plain(
        {
            "provenance": {**versions(), **occasion()},
            "file": exam.file,
            "answer": answer(exam, findings),
            "begins": exam.begins,
            "driven": exam.driven,
            "laws": exam.laws,
            "timestep_s": exam.timestep_s,
            "duration_s": exam.duration_s,
            "target": exam.target,
            "size": exam.size,
            "ignored": exam.ignored,
            "flexes": flex_names(exam.model),
            "missing": exam.missing,
            "loops": _loops(exam),
            "start": _start(exam),
            "settings": [
                {"equality": one.name, **asdict(one.settings), "growth": one.growth, "stable": one.stable}
                for one in exam.settings
            ],
            "drift": [asdict(one) for one in exam.drifts],
            "collisions": [asdict(one) for one in exam.collisions],
            "exact": _exact(exam),
            "why": _why(exam),
            "without": exam.without,
            "pace": exam.pace,
            "dead_point": exam.dead_point,
            "branch": exam.branch,
            "lasting": exam.lasting,
            "recipe": _recipe(exam),
            "reactions": _reactions(exam),
            "forces": [*_forces(exam.given, "mujoco"), *_forces(exam.determined, "exact")],
            "findings": [finding.document() for finding in findings],
        }
    )


def _exact(exam: Examination) -> dict[str, Any] | None:
    """How the exact solution ended, and how far it is off by its own estimate."""
    exact = exam.exact
    if exact is None:
        return None
    error = float(exact.error.max()) if len(exact.error) else None
    return {"integrator": exact.integrator, "note": exact.note, "end": exact.end, "error": error}


def _plain(value: Any) -> Any:
    """Numbers, texts, lists and dictionaries only."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    return finite(value)


def _loops(exam: Examination) -> dict[str, Any] | None:
    if exam.pose is None:
        return None
    loops = exam.pose.loops
    history = exam.history
    return {
        "rows": loops.rows,
        "rank": loops.rank,
        "redundancy": loops.redundancy,
        "dof": loops.dof,
        "equalities": [
            {
                "name": loop.name,
                "kind": loop.equality.kind.name,
                "between": loop.ends,
                "rows": len(loop.rows),
                "zero_rows": loop.zero_rows,
                "shape": loop.path.shape,
                "group": loop.group,
                "removable": loop.removable,
            }
            for loop in loops.loops
        ],
        "groups": [
            {
                "equalities": group.equalities,
                "joints": group.joints,
                "shape": group.shape,
                "rows": group.rows,
                "rank": group.rank,
                "redundancy": group.redundancy,
                "dof": group.dof,
                "dependencies": [
                    {"equalities": one.equalities, "rows": [str(row) for row, _ in one.rows]}
                    for one in group.dependencies
                ],
            }
            for group in loops.groups
        ],
        "rank_events": [
            {name: getattr(event, name) for name in ("kind", "time_s", "rank", "lost", "smallest", "equalities")}
            for event in (history.events if history else ())
        ],
    }


def _start(exam: Examination) -> dict[str, Any] | None:
    pose = exam.pose
    if pose is None:
        return None
    return {
        "status": pose.status,
        "openings": [asdict(one) for one in pose.openings],
        "speeds": [asdict(one) for one in pose.speeds],
        "left": [asdict(one) for one in pose.left],
        "moved": pose.moved,
        "moved_joint": pose.moved_joint,
        "norm": pose.norm,
        "norm_with_nothing_held": pose.norm_free,
        "radian_m": pose.arm,
        "held": pose.held,
        "released": pose.released,
        "outside_ranges": {
            "start": [asdict(one) for one in pose.rested],
            "closed": [asdict(one) for one in pose.outside],
        },
        "culprits": [str(one) for one in pose.culprits],
        "tilts": [asdict(one) for one in pose.tilts],
        "qpos": pose.qpos,
        "qvel": pose.qvel,
    }


def _why(exam: Examination) -> dict[str, Any] | None:
    if exam.attribution is None:
        return None
    shares = [asdict(share) for share in exam.attribution.shares]
    accelerations = accelerations_table(exam).to_dicts()
    return {"law_defect": exam.attribution.defect, "equalities": shares, "accelerations": accelerations}


def _trial(trial: Trial) -> dict[str, Any]:
    names = ("label", "start", "drift", "unit", "time_s", "energy_error", "steps", "cost", "predicted")
    return {name: getattr(trial, name) for name in names} | {
        "equality": trial.equality.name,
        "end": trial.end.how,
        "setting": asdict(trial.setting),
    }


def _recipe(exam: Examination) -> dict[str, Any] | None:
    recipe = exam.recipe
    if recipe is None:
        return None
    return {
        "target": recipe.target,
        "outcome": recipe.outcome,
        "reason": recipe.reason,
        "untried": recipe.untried,
        "mjcf": recipe.mjcf,
        "authored": _trial(recipe.authored),
        "chosen": _trial(recipe.chosen),
        "verified": [_trial(trial) for trial in recipe.verified],
        "trials": [_trial(trial) for trial in recipe.trials],
    }


def _reactions(exam: Examination) -> list[dict[str, Any]]:
    if exam.reactions is None:
        return []
    every = (*exam.reactions.equalities, *exam.reactions.together, *exam.reactions.joints)
    return [
        {
            "of": one.owner,
            "names": one.names,
            "between": one.bodies,
            "verdict": one.verdict,
            "by_a_small_number": not hanging(exam).isdisjoint(one.names),
            "force": None if one.force is None else str(one.force),
            "torque": None if one.torque is None else str(one.torque),
        }
        for one in every
    ]


def largest(values: np.ndarray | None) -> float | None:
    """Largest length of vectors (T, n); None where there are none."""
    return None if values is None or not len(values) else float(np.linalg.norm(values, axis=1).max())


def _forces(found: Sequence[Wrench], engine: str) -> list[dict[str, Any]]:
    return [
        {
            "equality": one.equality,
            "engine": engine,
            "between": one.ends,
            "force_max_n": largest(one.total.force),
            "torque_max_nm": largest(one.total.torque),
            "coupling_max": largest(one.total.ends),
            "free_force_max_n": largest(one.free.force),
            "free_torque_max_nm": largest(one.free.torque),
        }
        for one in found
    ]


def findings_table(findings: Sequence[Finding]) -> pl.DataFrame:
    """A row a finding."""
    names = ("severity", "code", "name", "element", "line")
    columns = {name: [getattr(one, name) for one in findings] for name in names}
    return pl.DataFrame(columns, dict.fromkeys(names, pl.String))


def drift_table(exam: Examination) -> pl.DataFrame:
    """A row an equality and level; m, rad and their rates."""
    return pl.DataFrame([asdict(one) for one in exam.drifts], infer_schema_length=None)


def causes_table(exam: Examination) -> pl.DataFrame:
    """A row an equality and cause: its part of the drift at the worst moment (m or rad), and over the run."""
    rows = [
        {
            "equality": share.name,
            "time_s": share.time_s,
            "unit": share.unit,
            "cause": cause,
            "part": share.parts[cause],
            "share": share.shares[cause],
            "over_run": share.over_run[cause],
            "rms": share.rms[cause],
        }
        for share in (exam.attribution.shares if exam.attribution else ())
        for cause in share.parts
    ]
    return pl.DataFrame(rows, infer_schema_length=None)


def accelerations_table(exam: Examination) -> pl.DataFrame:
    """A row a cause, and one of all together: how MuJoCo's acceleration differs by it from the exact one.

    Root mean square and largest length over the instants that were looked at, all coordinates together, rad/s² or m/s²;
    ``relative`` is the first to that of the exact acceleration.
    """
    found = exam.accelerations
    if found is None or not len(found.instants):
        return pl.DataFrame()
    exact = _rms(found.exact)
    named = {**dict(zip(CAUSES, found.parts, strict=True)), "together": found.difference}
    rows = [
        {"cause": cause, "rms": _rms(part), "max": largest(part), "relative": _rms(part) / exact if exact else None}
        for cause, part in named.items()
    ]
    return pl.DataFrame(rows, infer_schema_length=None)


def _rms(vectors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def trials_table(exam: Examination) -> pl.DataFrame:
    """A row a run that was made to find what holds."""
    rows = [
        {
            "label": trial.label,
            "start": trial.start,
            "timestep_s": trial.setting.timestep_s,
            "integrator": trial.setting.integrator,
            "solref": None if trial.setting.solref is None else list(trial.setting.solref),
            "drift": trial.drift,
            "unit": trial.unit,
            "equality": trial.equality.name,
            "energy_error_j": trial.energy_error,
            "cost": trial.cost,
            "chosen": exam.recipe is not None and trial is exam.recipe.chosen,
        }
        for trial in (exam.recipe.trials if exam.recipe else ())
    ]
    return pl.DataFrame(rows, infer_schema_length=None)
