"""Exit status and words of ``oarlock run`` and ``oarlock suite`` for runs that are not done."""

import pytest
from mechanisms import four_bar, write_model

FREE = """title = "bar"
[run]
duration_s = 1.0
timestep_s = 0.02
[start]
qvel = { crank = 12.0 }
[[experiments]]
mode = "free"
"""

ALLOWED = """
[[endings]]
status = "{}"
where = {{ mode = "free", solver = "pinv" }}
cause = "steps of a quarter of a radian"
"""


@pytest.mark.parametrize("command", ["run", "suite"])
@pytest.mark.parametrize(("status", "expected"), [("drifted", 0), ("diverged", 1), (None, 1)])
def test_a_run_that_is_not_done_fails_unless_its_case_expects_it(oarlock_here, tmp_path, command, status, expected):
    write_model(tmp_path / "bar", four_bar(), FREE + (ALLOWED.format(status) if status else ""))
    finished = oarlock_here(command, "bar", "--out", "r")
    assert finished.returncode == expected
    said = [line for line in finished.stderr.splitlines() if "drifted" in line]
    if command == "run":
        assert said[0].startswith("oarlock: run free-hard-pinv-projection-rk4 drifted: its energy, ")
        assert said[0].endswith("; the case expects that") is (expected == 0)
    else:
        assert [line.startswith("oarlock: run drifted: bar free-hard-pinv-projection-rk4: its ") for line in said] == [
            True
        ] * expected


def test_endings_of_unknown_runs_are_a_mistake(oarlock_here, tmp_path):
    write_model(tmp_path / "bar", four_bar(), FREE + ALLOWED.format("drifted").replace("solver =", "solvers ="))
    finished = oarlock_here("run", "bar", "--out", "r")
    assert finished.returncode == 2
    assert "oarlock: endings of case 'bar' name 'solvers', expected one of: run, case, mode" in finished.stderr


def test_an_ending_is_one_of_those_that_there_are(oarlock_here, tmp_path):
    write_model(tmp_path / "bar", four_bar(), FREE + ALLOWED.format("done"))
    finished = oarlock_here("run", "bar", "--out", "r")
    assert finished.returncode == 2
    assert "endings.0.status = 'done'" in finished.stderr
