"""A run's own estimate of its error: what it is worth where the truth is known, and where a run has lost its way."""

import numpy as np
import pytest
from mechanisms import four_bar, frames_of, only, parallelogram, write_model
from oarlock import load_case, model_names, run
from oarlock.tables.promise import ERROR_BOUND
from tolerances import ESTIMATE_FACTOR, ESTIMATE_ROUNDING, ESTIMATE_SHARP

SWUNG = 'title = "swung"\nstart.qvel.crank = 6.0\nbaumgarte = { beta = 20.0, k = 400.0 }'

FINER = 16
"""Its errors are a hundredth of those that are told of a run of the first order, and nothing for one of the fourth."""

RIGID = ("scissor_lift", "standing_leg")
"""Whose truth stands on a rigid floor: what they are off by is the floor's softness, which is no error of the run."""


def exact(path, **asked):
    results = run(path, mode="free", form="hard", solver="auto", **asked)
    return only(results.rows, mode="free"), frames_of(results)[-1]


@pytest.mark.parametrize("stabilisation", ["projection", "baumgarte", "both"])
@pytest.mark.parametrize("integrator", ["euler", "implicitfast", "rk4"])
def test_the_estimate_is_the_error(tmp_path, integrator, stabilisation):
    path = write_model(tmp_path, four_bar(), SWUNG)
    asked = {"integrator": integrator, "stabilisation": stabilisation, "duration": 0.4}
    row, steps = exact(path, timestep=2e-3, **asked)
    _, finer = exact(path, timestep=2e-3 / FINER, **asked)
    apart = np.array(steps["qpos"].to_list()) - np.array(finer["qpos"].to_list())[::FINER]
    told = steps["error_estimate"].to_numpy()
    assert told[0] == 0.0
    assert row["error_estimate_max"] == told.max() == pytest.approx(np.abs(apart).max(), rel=ESTIMATE_SHARP)


@pytest.mark.parametrize("stabilisation", ["projection", "baumgarte"])
@pytest.mark.parametrize("name", [name for name in model_names() if load_case(name).file.truth and name not in RIGID])
def test_the_estimate_of_what_a_truth_speaks_of(name, stabilisation):
    duration = min(0.5, load_case(name).file.run.duration_s)
    row, _ = exact(name, stabilisation=stabilisation, duration=duration)
    told, error = row["truth_error_estimate_max"], row["truth_error_max"]
    assert told <= ESTIMATE_FACTOR * error + ESTIMATE_ROUNDING
    assert error <= ESTIMATE_FACTOR * told + ESTIMATE_ROUNDING


def test_a_run_that_passes_by_a_singular_pose_says_that_it_is_lost(tmp_path):
    """Bars that differ by 1e-7 m: where they lie flat the coupler turns over within a microsecond: no step sees it."""
    xml = parallelogram().replace('name="tip2" pos="0 0 0.5"', 'name="tip2" pos="0 0 0.5000001"')
    row, steps = exact(write_model(tmp_path, xml, 'title = "near"\nstart.qvel = { crank = 3.0 }'), duration=4.0)
    assert row["status"] in ("diverged", "drifted", "inaccurate")
    assert (steps["error_estimate"] > ERROR_BOUND).any()


def test_only_exact_free_runs_have_an_estimate(tmp_path):
    results = run(write_model(tmp_path, four_bar(), SWUNG), mode="all", solver=["pinv", "mujoco"], duration=0.02)
    known = {row["run"] for row in results.rows if row["error_estimate_max"] is not None}
    assert known == {"free-hard-pinv-projection-rk4"}
    assert all(row["truth_error_estimate_max"] is None for row in results.rows)


@pytest.mark.parametrize("stepping", ["native", "python"])
def test_a_solver_that_is_wrong_is_no_judge_of_itself(tmp_path, stepping):
    """It softens rows alike at every timestep, and so agrees with itself: the walk beside has another solver."""
    path = write_model(tmp_path, four_bar(), SWUNG)
    asked = {"mode": "free", "form": "hard", "duration": 0.4, "stepping": stepping}
    softened = "cholesky-regularised:epsilon=0.01,max_iterations=1"
    results = run(path, solver=[softened, "auto"], **asked)
    soft, right = (np.array(frame["qpos"].to_list()) for frame in frames_of(results)[1:])
    told = only(results.rows, mode="free", solver=softened)["error_estimate_max"]
    apart = np.abs(soft - right).max()
    assert apart > 100 * only(results.rows, mode="free", solver="auto")["error_estimate_max"]
    assert told == pytest.approx(apart, rel=ESTIMATE_SHARP)
