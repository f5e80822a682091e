"""What a report says before anything else: one sentence, and a light for every question that its runs answer."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from oarlock.base.numbers import figure
from oarlock.report.statements import Compared
from oarlock.report.tables import Tables

Row = dict[str, Any]

HELD, FAILED, OPEN = "🟢", "🔴", "⚪"
"""Every bound on it holds; one does not; the case sets none that was checked."""


@dataclass(frozen=True)
class Light:
    """A question, and what came out.

    Attributes:
        colour: as of ``HELD``, ``FAILED`` and ``OPEN``.
        question: in plain words.
        answer: with its figure and unit.
        bounds: how many bounds were checked, in words.
    """

    colour: str
    question: str
    answer: str
    bounds: str


def sentence(tables: Tables, compared: Compared) -> str:
    """How far the loops stand open with MuJoCo and with exact constraints, in one sentence; empty without such runs."""
    exact, default = compared.exact, compared.default
    if not exact or not default:
        return ""
    own = [row for row in compared.projected if row["integrator"] == exact["integrator"] and row["status"] == "done"]
    best = min([exact, *own], key=lambda row: row["drift_pos_max"])
    said = (
        f"In {figure(exact['steps_done'] * exact['timestep_s'], 's')} MuJoCo lets the loops stand open by "
        f"{figure(default['drift_pos_max'], tables.unit)}, exact constraints by "
        f"{figure(best['drift_pos_max'], tables.unit)}"
    )
    if best["truth_error_max"] is not None and default["truth_error_max"] is not None:
        said += (
            f"; from the outside truth MuJoCo is {figure(default['truth_error_max'], tables.truth_unit)} away, the "
            f"exact run {figure(best['truth_error_max'], tables.truth_unit)}"
        )
    return f"{said}."


def lights(tables: Tables, compared: Compared) -> list[Light]:
    """A light for each question that the runs answer; what there are no runs for is left out."""
    unit, truth = tables.unit, tables.truth_unit
    exact = [row for row in [compared.exact, *compared.projected] if row]
    lockstep = tables.all(mode="lockstep")
    asked: list[tuple[str, list[Row], dict[str, Callable[[float], str]]]] = [
        (
            "Does our stepping give MuJoCo's own run?",
            compared.calibrations,
            {"trajectory_diff_max": lambda value: f"to {figure(value)} rad or m"},
        ),
        (
            "Asked MuJoCo's question, is the answer MuJoCo's?",
            [compared.matched] if compared.matched else [],
            {
                "qacc_rel_diff_max": lambda value: f"accelerations to {figure(value)}",
                "qfrc_constraint_rel_diff_max": lambda value: f"forces to {figure(value)}",
            },
        ),
        (
            "Do exact loops stay closed?",
            exact,
            {"drift_pos_max": lambda value: f"open by {figure(value, unit)} at most"},
        ),
        (
            "Is the exact run where the outside truth is?",
            [compared.exact] if compared.exact else [],
            {"truth_error_max": lambda value: f"{figure(value, truth)} away at most"},
        ),
        (
            "Is energy kept?",
            exact,
            {"energy_drift_rel": lambda value: f"to {figure(value)} of the largest kinetic energy"},
        ),
        (
            "Do iterations find the least multipliers?",
            [row for row in lockstep if row["solver"].partition(":")[0] == "sr1-tracked"],
            {"min_norm_error_max": lambda value: f"off by {figure(value)} of them at most"},
        ),
    ]
    found = []
    for question, rows, told in asked:
        values = {name: [row[name] for row in rows if row.get(name) is not None] for name in told}
        answers = [told[name](max(known)) for name, known in values.items() if known]
        if answers:
            colour, bounds = _judged(tables, {row["run"] for row in rows}, set(told))
            found.append(Light(colour, question, "; ".join(answers), bounds))
    colour, bounds = _judged(tables, {row["run"] for row in tables.rows}, None)
    ends = Counter(row["status"] for row in tables.rows)
    answer = f"{ends.pop('done', 0)} of {len(tables.rows)} runs done"
    answer += "".join(f", {count} {status}" for status, count in sorted(ends.items()))
    found.append(Light(colour, "Do all bounds of the case hold?", answer, bounds))
    return found


def _judged(tables: Tables, runs: set[str], figures: set[str] | None) -> tuple[str, str]:
    """A colour, and how many bounds decided it: those on some figures of some runs, all if there are none."""
    checked = [
        gate
        for gate in tables.gates
        if gate["held"] is not None and (figures is None or (gate["figure"] in figures and gate["run"] in runs))
    ]
    if not checked:
        return OPEN, "none"
    held = sum(gate["held"] for gate in checked)
    return (HELD if held == len(checked) else FAILED), f"{held} of {len(checked)}"
