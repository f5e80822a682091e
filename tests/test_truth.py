"""Outside truths: every table made again by its script; the boat's also made otherwise, and interpolated; and tables
that are no truth."""

import importlib.util
import runpy
import shutil

import boat_paper as paper
import numpy as np
import pytest
from mechanisms import BOAT, boat_with
from oarlock import InputError, load_case
from oarlock.cases import MODELS
from oarlock.truth import TruthTrajectory, load_truth
from scipy.integrate import solve_ivp
from tolerances import (
    TRUTH_INTERPOLATION,
    TRUTH_OTHER_SOLVER,
    TRUTH_REGENERATED,
    TRUTH_REGENERATED_ACCELERATION,
    TRUTH_TABLE,
    TRUTH_TABLE_ACCELERATION,
)

SCRIPTS = sorted(MODELS.glob("*/reference.py"))


def tables_in(folder):
    """Name of a table → its head (comment and columns) and its numbers, of every table of a truth in a folder."""
    found = {}
    for path in sorted(folder.glob("reference*.csv")):
        lines = path.read_text(encoding="utf-8").splitlines()
        begin = next(index for index, line in enumerate(lines) if line[0] in "0123456789-")
        found[path.name] = lines[:begin], np.loadtxt(lines[begin:], delimiter=",")
    return found


def test_every_table_has_a_script():
    """What the next test does not walk would be believed unseen."""
    with_tables = {path.parent for path in MODELS.glob("*/reference*.csv")}
    assert with_tables == {path.parent for path in SCRIPTS}
    assert load_case("boat").folder in with_tables


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.parent.name)
def test_tables_are_what_their_script_makes(script, tmp_path):
    copy = shutil.copy(script, tmp_path)
    runpy.run_path(copy, run_name="__main__")
    shipped, made = tables_in(script.parent), tables_in(tmp_path)
    assert shipped.keys() == made.keys()
    for name, (head, table) in shipped.items():
        head_made, table_made = made[name]
        assert head == head_made
        assert table.shape == table_made.shape
        np.testing.assert_array_equal(table[:, 0], table_made[:, 0])
        kinds = zip(np.split(table[:, 1:], 3, axis=1), np.split(table_made[:, 1:], 3, axis=1), strict=True)
        bounds = {"position": TRUTH_TABLE, "velocity": TRUTH_TABLE, "acceleration": TRUTH_TABLE_ACCELERATION}
        for (kind, bound), (values, values_made) in zip(bounds.items(), kinds, strict=True):
            gap = np.abs(values - values_made).max() / np.abs(values_made).max()
            assert gap <= bound, f"{name}: {kind} off by {gap:.2g} of its largest, expected at most {bound:g}"


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
