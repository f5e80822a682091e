"""The models closed by joint, tendon and weld equalities: their truths, and what MuJoCo's missing J̇v costs."""

import numpy as np
import pytest
from mechanisms import four_bar, frames_of, only, reference_script, setup_of, write_model
from oarlock import RunOptions, load_case, run
from oarlock.cases.conditions import Conditions
from oarlock.cases.truth import load_truth
from oarlock.experiments.laboratory import Laboratory
from oarlock.stepping.question import SolvedForce
from oarlock.stepping.solvers import SolverSpec
from oarlock.stepping.state import State
from oarlock.stepping.walkers import ForcedWalker
from tolerances import (
    CURVATURE_RESTORED,
    CURVATURE_SHOWS,
    GEAR_TORQUE,
    RK4_ORDER_HIGH,
    RK4_ORDER_LOW,
    TRUTH_INTERPOLATION,
)

NAMES = ["gear_train", "cable_loop", "welded_frame"]


@pytest.fixture(params=NAMES)
def name(request) -> str:
    return request.param


@pytest.fixture
def reference(name):
    return reference_script(name)


def test_interpolation(name, reference):
    """Between the rows of the first second, which has a whole swing of each."""
    truth = load_truth(load_case(name))
    assert truth is not None
    times = np.arange(0.0, 1.0, reference.INTERVAL / 4)
    assert np.abs(truth.position(times)[:, 0] - reference.solve(times)[0]).max() <= TRUTH_INTERPOLATION


def test_start_is_exactly_the_cases(name):
    assert setup_of(load_case(name)).start.moved == 0.0


def test_the_exact_run_comes_to_the_truth_with_the_order_of_the_integrator(name):
    """Any difference of mass, geometry or J̇v from the reference's would stay when the step shrinks."""
    errors = []
    for timestep in (2e-3, 1e-3):
        results = run(name, mode="free", form="hard", solver="pinv", timestep=timestep, duration=1.0)
        errors.append(only(results.rows, mode="free")["truth_error_max"])
    assert RK4_ORDER_LOW <= errors[0] / errors[1] <= RK4_ORDER_HIGH


def stiff_drift(name, restored):
    """Largest deviation in 1 s of MuJoCo's stiff question, as it is or with the J̇v that it leaves out; and J̇v/(K d)."""
    case = load_case(name)
    setup = Laboratory(case, Conditions(duration_s=1.0)).setup("rk4", "stiff")
    data = setup.data()
    state = State(setup.model, data, case.file.baumgarte)
    if restored:
        state.question = lambda form: (data.efc_aref - state.curvature, data.efc_R)
    force = SolvedForce(state, "matched", SolverSpec("pinv").make())
    walker = ForcedWalker(setup.model, data, setup.drive, force)
    drift = expected = 0.0
    for _ in range(setup.steps):
        walker.look()
        drift = max(drift, np.abs(data.efc_pos).max())
        stiffness, _, impedance, _ = data.efc_KBIP[: data.ne].T
        expected = max(expected, np.abs(state.curvature / (stiffness * impedance)).max())
        walker.step()
    return drift, expected


@pytest.mark.parametrize("name", ["gear_train", "cable_loop"])
def test_what_the_missing_curvature_costs(name):
    drift, expected = stiff_drift(name, restored=False)
    assert drift == pytest.approx(expected, rel=CURVATURE_SHOWS)
    assert stiff_drift(name, restored=True)[0] <= CURVATURE_RESTORED * drift


def test_the_gear_of_the_gripper_carries_half_the_torque():
    """Mirror images move alike, so that each finger gets half: λ = τ/2, with no engine's help."""
    case = load_case("gripper")
    results = run("gripper", mode="free", form="hard", solver="pinv", duration=1.0)
    (steps,) = [steps for row, steps in zip(results.rows, frames_of(results), strict=True) if row["mode"] == "free"]
    multipliers = np.array(steps["multipliers"].to_list())[:, -1]  # the gear is the last equality, of one row
    torque = np.array([case.file.drive.laws()["motor"].at(time) for time in steps["time_s"]])
    assert np.abs(torque).max() > 0.003
    assert np.abs(multipliers - torque / 2).max() <= GEAR_TORQUE * np.abs(torque).max()


def test_runs_of_a_model_with_a_row_that_mujoco_drops(tmp_path):
    """A tendon between two sites of the world: its row is zero, and MuJoCo leaves it out."""
    rest = """<worldbody><site name="p" pos="1 0 0"/><site name="q" pos="2 0 0"/></worldbody>
      <tendon><spatial name="still"><site site="p"/><site site="q"/></spatial></tendon>
      <equality><tendon name="nothing" tendon1="still"/></equality>"""
    # A projection stops at the rounding of the model's extent, which the sites change.
    asked = RunOptions(mode="all", solver="pinv", duration=0.1, stabilisation="baumgarte")
    found = run(write_model(tmp_path / "with", four_bar(rest=rest)), asked)
    plain = run(write_model(tmp_path / "without", four_bar()), asked)
    names = ["run", "status", "drift_pos_max", "qacc_rel_diff_max", "trajectory_diff_max", "rank_max"]
    assert [[row[name] for name in names] for row in found.rows] == [
        [row[name] for name in names] for row in plain.rows
    ]
