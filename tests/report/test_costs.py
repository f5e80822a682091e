"""What a solve costs: which runs a table has beside one another, and times beside the pseudo-inverse's."""

import json

import pytest
from oarlock.report.case_report import timings, write_report
from oarlock.report.costs import Costs, question, times_of_reference
from oarlock.report.tables import Tables
from oarlock.tables.folder import ResultFolder


def row(solver, mode="free", **given):
    """A run on exact constraints that converged in two iterations a solve."""
    key = {
        "run": f"{mode}-{solver}-{given.get('integrator', 'rk4')}",
        "solver": solver,
        "mode": mode,
        "walker": "pinv" if mode == "lockstep" else solver,
        "form": "hard",
        "integrator": "rk4",
        "settings": "default",
        "stabilisation": "baumgarte",
        "status": "done",
        "solves": 4800,
        "unconverged": 0,
        "iterations_mean": 2.0,
        "iterations_max": 3,
        "products_mean": 6.0,
        "products_per_iteration": 2.0,
        "solve_ns_median": 300.0,
    }
    return {**key, **given}


def direct(mode="free", **given):
    free = {"iterations_mean": 0.0, "iterations_max": 0, "products_mean": 0.0, "products_per_iteration": None}
    return row("pinv", mode, **{**free, "solve_ns_median": 1200.0, **given})


def tables(*rows):
    some = object.__new__(Tables)
    some.rows = list(rows)
    return some


def test_questions_are_told_apart():
    assert question(row("sr1", "lockstep")) == ("along pinv", "rk4")
    assert question(row("sr1", "lockstep", walker="mujoco", integrator="euler")) == ("along MuJoCo", "euler")
    assert question(row("sr1")) == question(direct()) == ("in the loop", "rk4")
    assert question(row("sr1", stabilisation="both", settings="stiff")) == ("in the loop", "rk4", "both", "stiff")
    assert question(row("sr1", form="matched")) is None
    assert question(row("mujoco")) is None
    assert question(row("sr1", "one-step")) is None


def test_a_row_a_solver_and_a_column_a_question():
    alone = row("sr1", stabilisation="projection")
    lost = row("cg", unconverged=7, status="unconverged")
    gone = row("cg", "lockstep", status="diverged", products_per_iteration=None, products_mean=3.0)
    classic = row("sr1-classic")
    costs = Costs(tables(direct("lockstep"), row("sr1", "lockstep"), gone, direct(), row("sr1"), lost, classic, alone))
    assert costs
    assert costs.questions == [
        ("along pinv", "rk4"),
        ("in the loop", "rk4"),
    ]  # what one solver was asked compares nothing
    assert costs.solvers == ["pinv", "sr1", "cg", "sr1-classic"]
    assert costs.shared == ("in the loop", "rk4")
    said = {solver: [costs.iterations(one) for one in costs.rows(solver)] for solver in costs.solvers}
    assert said == {
        "pinv": ["0", "0"],
        "sr1": ["2", "2"],
        "cg": ["2; diverged", "2; 7 of 4 800 not converged"],
        "sr1-classic": ["–", "2"],
    }
    assert [costs.per_iteration(solver) for solver in costs.solvers] == [None, 2.0, 2.0, 2.0]
    assert [costs.products(solver) for solver in costs.solvers] == [0.0, 6.0, 6.0, 6.0]


@pytest.mark.parametrize(
    "rows",
    [
        [row("mujoco")],
        [direct("lockstep"), row("sr1", "lockstep")],
        [direct("lockstep"), row("cholesky", "lockstep", iterations_max=0), direct(), row("sr1")],
    ],
)
def test_a_single_question_makes_no_table(rows):
    assert not Costs(tables(*rows))


def test_times_stand_beside_the_reference_of_the_same_question():
    euler = row("sr1", integrator="euler")
    unknown = row("cg", solve_ns_median=None)
    runs = tables(
        direct(), row("sr1"), unknown, euler, direct("lockstep", solve_ns_median=600.0), row("sr1", "lockstep")
    )
    assert times_of_reference(runs) == {
        "free-pinv-rk4": 1.0,
        "free-sr1-rk4": 0.25,
        "lockstep-pinv-rk4": 1.0,
        "lockstep-sr1-rk4": 0.5,
    }


# The boat: the paper's own experiment.


def test_the_boat_has_both_experiments_and_times_that_are_not_tracked(boat_run, tmp_path):
    found = Tables(ResultFolder(boat_run.folder))
    costs = Costs(found)
    assert {("along pinv", "rk4"), ("in the loop", "rk4"), ("in the loop", "euler")} <= set(costs.questions)
    assert costs.shared == ("along pinv", "rk4")
    assert {"pinv", "sr1", "sr1-classic", "bfgs", "cg", "minres"} <= set(costs.solvers)
    assert (costs.per_iteration("sr1"), costs.per_iteration("sr1-classic")) == (2.0, 3.0)
    written = write_report(boat_run.folder, tmp_path / "report")
    text = (written / "README.md").read_text(encoding="utf-8")
    (line,) = [line for line in text.partition("## What a solve costs")[2].splitlines() if line.startswith("| sr1 |")]
    for one in costs.rows("sr1"):
        assert f"| {costs.iterations(one)} |" in line
    kept = json.loads((written / "timings.json").read_text(encoding="utf-8"))
    assert kept == timings(found)
    beside = {run["run"]: run["solve_of_pinv"] for run in kept["runs"]}
    assert beside["free-hard-pinv-rk4"] == 1.0
    assert beside["lockstep-hard-along-pinv-sr1-rk4"] > 0
    assert beside["free-mujoco-rk4"] is None


def test_claims_stand_in_the_report(boat_run, tmp_path):
    claims = Tables(ResultFolder(boat_run.folder)).case["paper"]["claims"]
    text = (write_report(boat_run.folder, tmp_path / "report") / "README.md").read_text(encoding="utf-8")
    section = text.partition("## What the paper says, and what is so")[2].partition("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("| ")][1:]
    assert [" | **no** | " in line for line in lines] == [not claim["holds"] for claim in claims]
    assert "the two components across its oar" in section
