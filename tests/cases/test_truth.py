"""Outside truths: every table is what its script makes; the boat's also made otherwise, and interpolated; and tables
that are no truth."""

import hashlib
import runpy
import shutil

import boat_paper as paper
import mujoco
import numpy as np
import pytest
from mechanisms import BOAT, boat_with, case_of, four_bar, reference_script, setup_of, write_model
from oarlock import InputError, load_case
from oarlock.cases.case import MODELS
from oarlock.cases.truth import SITE_COLUMNS, TruthTrajectory, load_truth
from scipy.integrate import solve_ivp
from tolerances import TRUTH_INTERPOLATION, TRUTH_OTHER_SOLVER, TRUTH_TABLE, TRUTH_TABLE_ACCELERATION

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


def sums(folder):
    """What the file of sums says, and what it should say: path → SHA-256."""
    lines = (folder / "reference.sha256").read_text(encoding="utf-8").splitlines()
    names = ["reference.py", "../_truth.py", *sorted(path.name for path in folder.glob("reference*.csv"))]
    return (
        {name: digest for digest, name in (line.split("  ") for line in lines)},
        {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in names},
    )


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.parent.name)
def test_no_script_and_no_table_was_changed_since_the_tables_were_made(script):
    """The deep tests make the tables again. Of a change that no number depends on, record the sums by hand."""
    recorded, present = sums(script.parent)
    changed = [name for name in present if recorded.get(name) != present[name]]
    assert recorded.keys() == present.keys()
    assert not changed, f"{changed} changed: make the tables again by python mjcf/{script.parent.name}/reference.py"


@pytest.mark.parametrize(
    "script",
    [
        pytest.param(path, marks=[] if path.parent == BOAT else pytest.mark.slow, id=path.parent.name)
        for path in SCRIPTS
    ],
)
def test_tables_are_what_their_script_makes(script, tmp_path):
    """In another place, from nothing but the script and what it shares with others; with sums of what was made."""
    folder = tmp_path / "model"
    folder.mkdir()
    shutil.copy(MODELS / "_truth.py", tmp_path)
    runpy.run_path(shutil.copy(script, folder), run_name="__main__")
    recorded, present = sums(folder)
    assert recorded == present
    shipped, made = tables_in(script.parent), tables_in(folder)
    assert shipped.keys() == made.keys()
    for name, (head, table) in shipped.items():
        head_made, table_made = made[name]
        assert head == head_made
        assert table.shape == table_made.shape
        assert table[0, 0] == 0.0
        np.testing.assert_array_equal(table[:, 0], table_made[:, 0])
        kinds = zip(np.split(table[:, 1:], 3, axis=1), np.split(table_made[:, 1:], 3, axis=1), strict=True)
        bounds = {"position": TRUTH_TABLE, "velocity": TRUTH_TABLE, "acceleration": TRUTH_TABLE_ACCELERATION}
        for (kind, bound), (values, values_made) in zip(bounds.items(), kinds, strict=True):
            gap, largest = np.abs(values - values_made).max(), np.abs(values_made).max()  # at rest nothing but zeros
            assert gap <= bound * largest, f"{name}: {kind} off by {gap:.2g} of {largest:.2g}, expected {bound:g} of it"


@pytest.fixture(scope="module")
def reference():
    return reference_script("boat")


@pytest.fixture(scope="module")
def table():
    return np.loadtxt(BOAT / "reference.csv", delimiter=",", skiprows=2)


@pytest.fixture(scope="module")
def truth():
    loaded = load_truth(load_case("boat"))
    assert loaded is not None
    return loaded


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


# Truth of a site, and of a variant.

SITE_HEAD = "time,x,y,z,vx,vy,vz,ax,ay,az\n"


def swinging(times):
    """A circle in the plane y = 0.2, and its two derivatives, (n, 9)."""
    sin, cos, flat = np.sin(times), np.cos(times), np.zeros_like(times)
    return np.column_stack([sin, flat + 0.2, cos, cos, flat, -sin, -sin, flat, -cos])


def write_site(path, times):
    rows = np.column_stack([times, swinging(times)])
    path.write_text(SITE_HEAD + "\n".join(",".join(f"{x:.16g}" for x in row) for row in rows) + "\n")


def test_truth_of_a_site_has_three_components(tmp_path):
    write_site(tmp_path / "site.csv", np.arange(0, 1.01, 0.01))
    truth = TruthTrajectory(tmp_path / "site.csv", SITE_COLUMNS)
    times = np.arange(0.005, 1.0, 0.01)
    assert np.abs(truth.position(times) - swinging(times)[:, :3]).max() <= TRUTH_INTERPOLATION
    assert truth.position(np.array([0.5, 2.0])).shape == (2, 3)
    assert np.isnan(truth.position(np.array([2.0]))).all()


@pytest.mark.parametrize("observed", [{"site": "tip1"}, {"joint": "crank"}])
def test_columns_belong_to_what_is_observed(tmp_path, observed):
    path = write_model(tmp_path, four_bar())
    (tmp_path / "t.csv").write_text((SITE_HEAD if "joint" in observed else HEAD) + "0,0,0,0\n1,0,0,0\n")
    with pytest.raises(InputError, match=r"t\.csv: columns .* expected"):
        load_truth(case_of(path, truth={"file": "t.csv", "source": "s", **observed}))


def held_still(tmp_path, **offsets):
    """A four-bar at rest without gravity, and a truth that is off by ``offsets`` of the place of a site."""
    path = write_model(tmp_path, four_bar(rest='<option gravity="0 0 0"/>'))
    place = [0.5 + offsets.get("x", 0), offsets.get("y", 0), 0.5 + offsets.get("z", 0)]  # 0.3 + 0.2 high
    row = ",".join(map(str, [*place, *[0.0] * 6]))
    (tmp_path / "still.csv").write_text(SITE_HEAD + f"0,{row}\n1,{row}\n")
    truth = {"file": "still.csv", "site": "tip1", "source": "by hand"}
    return case_of(path, truth=truth, run={"duration_s": 0.02})


@pytest.mark.parametrize(("offsets", "error"), [({}, 0.0), ({"x": 0.1}, 0.1), ({"y": -0.3, "z": 0.2}, 0.3)])
def test_truth_error_of_a_site_is_its_worst_component(tmp_path, offsets, error):
    setup = setup_of(held_still(tmp_path, **offsets))
    assert setup.observed is not None
    assert setup.truth is not None
    assert setup.truth.columns == ["time_s", "x", "y", "z"]
    data = setup.data()
    mujoco.mj_forward(setup.model, data)
    (found,) = setup.truth_errors(np.array([3]), setup.observed.position(data)[None])
    assert found == pytest.approx(error, abs=TRUTH_INTERPOLATION)


@pytest.mark.parametrize(
    ("observed", "message"),
    [
        ({"site": "tip9"}, r"unknown site in \[truth\] of case 'made-up' 'tip9', expected one of: .*tip1"),
        ({"joint": "crnk"}, r"unknown joint in \[truth\] .*'crnk', expected one of: crank, coupler, rocker"),
    ],
)
def test_what_is_observed_must_be_there(tmp_path, observed, message):
    path = write_model(tmp_path, four_bar())
    write_site(tmp_path / "t.csv", np.array([0.0, 1.0]))
    (tmp_path / "j.csv").write_text(HEAD + "0,0,0,0\n1,0,0,0\n")
    with pytest.raises(InputError, match=message):
        setup_of(case_of(path, truth={"file": "t.csv" if "site" in observed else "j.csv", "source": "s", **observed}))


def test_truth_of_a_ball_joint_is_refused(tmp_path):
    xml = """<mujoco><worldbody><body name="bob"><joint name="ball" type="ball"/><geom size="0.1" pos="0 0 1"/>
      </body></worldbody><equality><connect body1="bob" anchor="0 0 1"/></equality></mujoco>"""
    (tmp_path / "j.csv").write_text(HEAD + "0,0,0,0\n1,0,0,0\n")
    case = case_of(write_model(tmp_path, xml), truth={"file": "j.csv", "joint": "ball", "source": "s"})
    with pytest.raises(InputError, match=r"\[truth\] .*'ball' has several coordinates, expected a hinge or slide"):
        setup_of(case)


def test_a_variant_has_its_own_table():
    truths = [load_truth(load_case(name)) for name in ("n_four_bar", "n_four_bar:N=10", "n_four_bar:connects=2")]
    two, ten, doubled = (truth.position(np.array([1.0]))[0] for truth in truths if truth)
    assert np.abs(two - ten).max() > 0.01  # the motion depends on N
    np.testing.assert_array_equal(two, doubled)  # and not on how a loop is closed
    assert load_truth(load_case("n_four_bar:N=3")) is None  # nobody made a table for it


def test_missing_table_is_named():
    case = boat_with(truth={"file": "gone.csv", "joint": "crank", "source": "nobody"})
    with pytest.raises(InputError, match=r"gone\.csv: cannot read the truth"):
        load_truth(case)
