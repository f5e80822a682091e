"""Versions of MuJoCo beside each other: the largest gap of a run, what changed at which version, and why."""

from itertools import pairwise
from typing import Any

from oarlock.base.numbers import short
from oarlock.conformance.states import RUN_S

ENGINE = "mujoco"

CHANGED = 1e-2
"""Relative change of the largest gap that counts: runs that are chaotic differ by less from rounding alone in 2 s."""


LOST = 1e3
"""m or rad: loops that open so far hold nothing, and how far they do says nothing of a version."""


def version_of(row: dict[str, Any]) -> str:
    """The version that answered."""
    return str(row["versions"].get(ENGINE, row["engine"]))


def table(rows: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Version → model → largest gap of its rows in the run, m or rad."""
    found: dict[str, dict[str, Any]] = {}
    for row in rows:
        found.setdefault(version_of(row), {})[row["model"]] = row["drift_max"]
    return found


def changes(rows: list[dict[str, Any]]) -> list[str]:
    """What changed from one version to the next, a line each model and step; one line where nothing did.

    And one for the models of which a single version answered.
    """
    said: list[str] = []
    by_model: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        by_model.setdefault(row["model"], []).append(row)
    alone = {model: own[0] for model, own in by_model.items() if len(own) == 1}
    models = [model for model in by_model if model not in alone]
    for model in models:
        own = by_model[model]
        for before, after in pairwise(own):
            if line := _change(before, after):
                said.append(f"{model}: {line}")
    if models and not said:
        said.append(f"nothing changed for {', '.join(models)} in the first {RUN_S:g} s")
    answered = dict.fromkeys(map(version_of, alone.values()))
    if alone:
        said.append(
            f"nothing to compare for {', '.join(alone)}: {', '.join(answered)} alone answered, expected two or more"
        )
    return said


def _change(before: dict[str, Any], after: dict[str, Any]) -> str:
    told = []
    if before["cause"] != after["cause"]:
        told.append(f"at the same states {before['verdict']} before, {after['verdict']} after")
    known = [row["facts"].get("jdotv") for row in (before, after)]
    if known[0] != known[1] and "unknown" not in known:
        words = {True: "holds −J̇v", False: "holds no J̇v"}
        told.append(f"aref of connects and welds {words[known[0]]} before, {words[known[1]]} after, as measured")
    gaps = before["drift_max"], after["drift_max"]
    lost = [gap is not None and gap > LOST for gap in gaps]
    if any(lost):
        if not all(lost):
            told.append(f"the run is lost {'before' if lost[0] else 'after'}: its loops open by {short(max(gaps))}")
    elif None not in gaps and abs(gaps[1] - gaps[0]) > CHANGED * min(gaps):
        factor = max(gaps) / max(min(gaps), 1e-300)
        told.append(f"largest gap {short(gaps[0])} → {short(gaps[1])}, a factor of {factor:.3g}")
    if not told:
        return ""
    return f"{version_of(before)} → {version_of(after)}: {'; '.join(told)}"
