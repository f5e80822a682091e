"""The boat's outside truth: made again, made otherwise, interpolated; and tables that are no truth."""

import importlib.util

import boat_paper as paper
import numpy as np
import pytest
from mechanisms import BOAT, boat_with
from oarlock import InputError, load_case
from oarlock.truth import TruthTrajectory, load_truth
from scipy.integrate import solve_ivp
from tolerances import (
    TRUTH_INTERPOLATION,
    TRUTH_OTHER_SOLVER,
    TRUTH_REGENERATED,
    TRUTH_REGENERATED_ACCELERATION,
)


@pytest.fixture(scope="module")
def reference():
    """mjcf/boat/reference.py."""
    spec = importlib.util.spec_from_file_location("boat_reference", BOAT / "reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def table():
    return np.loadtxt(BOAT / "reference.csv", delimiter=",", skiprows=2)


@pytest.fixture(scope="module")
def truth():
    loaded = load_truth(load_case("boat"))
    assert loaded is not None
    return loaded


def test_table_is_what_its_script_makes(reference, table):
    times = table[:, 0]
    assert times[0] == 0.0
    assert times[-1] == reference.DURATION == load_case("boat").file.run.duration_s
    phi, phi_dot = reference.solve(times)
    assert np.abs(table[:, 1] - phi).max() <= TRUTH_REGENERATED
    assert np.abs(table[:, 2] - phi_dot).max() <= TRUTH_REGENERATED
    gap = np.abs(table[:, 3] - reference.acceleration(times, phi, phi_dot)).max()
    assert gap <= TRUTH_REGENERATED_ACCELERATION


@pytest.mark.parametrize(("method", "max_step"), [("DOP853", 1e-3), ("RK45", 1e-3), ("LSODA", np.inf)])
def test_other_methods_agree(reference, table, method, max_step):
    solution = solve_ivp(
        lambda t, y: (y[1], reference.acceleration(t, y[0], y[1])),
        (0.0, table[-1, 0]),
        (0.0, 0.0),
        method=method,
        max_step=max_step,
        rtol=1e-13,
        atol=1e-14,
    )
    assert abs(solution.y[0, -1] - table[-1, 1]) <= TRUTH_OTHER_SOLVER


def test_all_five_coordinates_of_the_paper_agree(table):
    """Multipliers from NumPy's pseudo-inverse, no reduction to one coordinate, no stabilisation."""
    times = table[: 1 + round(1.0 / 0.0025) : 40, 0]
    solution = solve_ivp(
        lambda t, y: np.concatenate([y[5:], paper.acceleration(t, y[:5], y[5:])]),
        (0.0, times[-1]),
        np.concatenate([paper.START, np.zeros(5)]),
        method="DOP853",
        t_eval=times,
        rtol=1e-12,
        atol=1e-13,
    )
    assert solution.success
    assert times[-1] == 1.0
    assert np.abs(solution.y[0] - table[: len(times) * 40 : 40, 1]).max() <= TRUTH_OTHER_SOLVER


def test_interpolation_between_rows(reference, truth, table):
    times = (table[1:, 0] + table[:-1, 0]) / 2
    phi, _ = reference.solve(times)
    assert np.abs(truth.position(times)[:, 0] - phi).max() <= TRUTH_INTERPOLATION


def test_rows_come_back_exactly(truth, table):
    np.testing.assert_allclose(truth.position(table[:, 0])[:, 0], table[:, 1], rtol=0, atol=TRUTH_INTERPOLATION)


def test_nothing_is_known_outside_the_table(truth):
    (inside,), *outside = truth.position(np.array([12.0, 12.0 + 1e-9, 100.0, np.nan]))
    assert np.isfinite(inside)
    assert np.isnan(outside).all()


def test_nothing_is_known_before_the_table(tmp_path):
    path = tmp_path / "late.csv"
    path.write_text("time,position,velocity,acceleration\n1,0,1,0\n2,1,1,0\n")
    late = TruthTrajectory(path).position(np.array([0.0, 0.999, 1.0, 2.0]))
    assert np.isnan(late[:2]).all()
    assert np.isfinite(late[2:]).all()


HEAD = "time,position,velocity,acceleration\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r"columns \[\], expected"),
        (b"# only a comment\n", r"columns \[\], expected"),
        (b"time,position,velocity\n0,0,0\n1,1,1\n", "columns .*expected"),
        (b"0,0,0,0\n1,1,1,1\n", "columns .*expected"),
        (HEAD.encode(), "at least two rows"),
        ((HEAD + "0,0,0,0\n").encode(), "at least two rows"),
        ((HEAD + "0,0,0,0\n1,nan,0,0\n").encode(), "finite numbers"),
        ((HEAD + "0,0,0,0\n1,0,inf,0\n").encode(), "finite numbers"),
        ((HEAD + "0,0,0,0\n0,0,0,0\n").encode(), "rising times"),
        ((HEAD + "1,0,0,0\n0,0,0,0\n").encode(), "rising times"),
        ((HEAD + "0,0,0,0\n1,zero,0,0\n").encode(), "zero"),
        ((HEAD + "0,0,0,0\n1,0,0\n").encode(), "bad.csv: "),
        ((HEAD + "0,0,0,0,0\n1,0,0,0,0\n").encode(), "bad.csv: "),
        (b"\xff\xfe\x00binary\x00", "bad.csv: "),
    ],
)
def test_malformed_tables_are_named(tmp_path, content, message):
    path = tmp_path / "bad.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as raised:
        TruthTrajectory(path)
    assert "bad.csv: " in str(raised.value)


def test_missing_table_is_named():
    case = boat_with(truth={"file": "gone.csv", "joint": "crank", "source": "nobody"})
    with pytest.raises(InputError, match=r"gone\.csv: cannot read the truth"):
        load_truth(case)
