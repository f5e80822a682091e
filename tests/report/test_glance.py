"""What a report says before anything else."""

from types import SimpleNamespace

import pytest
from oarlock.report.glance import FAILED, HELD, OPEN, lights
from oarlock.report.statements import Compared


def cells(text):
    """The rows of the table of lights."""
    head = text.partition("\n## ")[0]
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in head.splitlines()
        if line[2:3] in (HELD, FAILED, OPEN)
    ]


def test_the_boat_in_one_sentence_and_a_light_a_question(boat_run, tmp_path):
    """Every answer is a figure of the summary, and every colour that of its gates."""
    from oarlock.report.case_report import write_report

    text = (write_report(boat_run.folder, tmp_path / "report") / "README.md").read_text(encoding="utf-8")
    lines = text.splitlines()
    rows = {row["run"]: row for row in boat_run.document["runs"]}
    default = rows["free-mujoco-rk4"]["drift_pos_max"]
    assert lines[2].startswith("In ")
    assert f"MuJoCo lets the loops stand open by {default:.2e} m, exact constraints by" in lines[2]
    assert lines[4] == "![mechanism](figures/mechanism.svg)"
    shown = cells(text)
    assert len(shown) >= 5
    assert {row[0] for row in shown} <= {HELD, OPEN}
    (closed,) = [row for row in shown if row[1] == "Do exact loops stay closed?"]
    exact = [row for run, row in rows.items() if run == "free-hard-pinv-rk4" or "-projection-" in run]
    worst = max(row["drift_pos_max"] for row in exact)
    assert float(closed[2].split()[2]) == pytest.approx(worst, rel=5e-3)
    gates = [gate for gate in boat_run.document["gates"] if gate["held"] is not None]
    assert shown[-1][3] == f"{len(gates)} of {len(gates)}"


def judged(gates):
    row = {"run": "calibration", "mode": "calibration", "status": "done", "trajectory_diff_max": 1e-12}
    tables = SimpleNamespace(unit="m", truth_unit="rad", rows=[row], gates=gates, all=lambda **where: [])
    compared = Compared([row], None, None, None, None, None, None, None, [], [])
    return lights(tables, compared)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("held", "colour", "bounds"),
    [((True, True), HELD, "2 of 2"), ((True, False), FAILED, "1 of 2"), ((None,), OPEN, "none"), ((), OPEN, "none")],
)
def test_a_colour_is_that_of_the_bounds_on_it(held, colour, bounds):
    """Bounds on other figures do not count for a question; for the whole they do."""
    gates = [{"figure": "trajectory_diff_max", "run": "calibration", "held": one} for one in held]
    other = {"figure": "drift_pos_max", "run": "calibration", "held": False}
    first, whole = judged([*gates, other])
    assert (first.colour, first.bounds) == (colour, bounds)
    assert first.answer == "to 1.00e-12 rad or m"
    assert whole.colour == FAILED
