"""A log of what a program really did, in place of MuJoCo's own run of a case."""

import mujoco
import numpy as np
import oarlock
import pytest
from logs import STEPS, XML, logged, saved
from oarlock.base.errors import InputError

ROUNDING = 1e-12
"""m, rad or of a force. The same computed again at the same states."""


@pytest.fixture(scope="module")
def rows():
    return logged()


@pytest.fixture(scope="module")
def results(rows, tmp_path_factory):
    return oarlock.run(XML, states=saved(tmp_path_factory.mktemp("log"), rows))


def table(results, name):
    (found,) = (frame for row, frame in zip(results.rows, results.tables, strict=True) if row["run"].startswith(name))
    return found.collect()


@pytest.mark.parametrize(
    "name", ["free-mujoco", "lockstep-matched-along-mujoco-pinv", "lockstep-hard-along-mujoco-auto"]
)
def test_what_was_logged_is_what_is_run(results, rows, name):
    steps = table(results, name)
    assert np.array_equal(np.array(steps["qpos"].to_list()), rows["qpos"])
    assert steps["time_s"].to_numpy() == pytest.approx(rows["time"], abs=ROUNDING)


def test_drift_and_forces_are_those_of_a_check(results, rows, tmp_path):
    """One log, one implementation: what a check records of it."""
    recording = oarlock.check(XML, states=saved(tmp_path, rows), budget=0).examination.recording
    steps = table(results, "free-mujoco")
    assert np.abs(np.array(steps["residual"].to_list()) - recording.position).max() < ROUNDING
    scale = np.abs(recording.force).max()
    assert scale > 1.0
    assert np.abs(np.array(steps["multipliers"].to_list()) - recording.force).max() < ROUNDING * scale
    matched = table(results, "lockstep-matched-along-mujoco-pinv")
    assert np.abs(np.array(matched["multipliers"].to_list()) - recording.exact_force).max() < 1e-9 * scale


def test_solvers_walk_from_its_closed_start_under_its_controls(results, rows, tmp_path):
    exam = oarlock.check(XML, states=saved(tmp_path, rows), budget=0).examination
    steps = table(results, "free-hard")
    assert steps["drift_pos"].max() < 1e-9
    assert np.abs(np.array(steps["qpos"].to_list()) - exam.exact.qpos).max() < 1e-9
    assert "the controls of the log" in results.motion
    assert "misses the next by up to 0" in results.motion


def test_forces_that_the_log_does_not_have_are_told(tmp_path):
    path = saved(tmp_path, logged(np.array([0.0, 0.0, 30.0])), "csv")
    results = oarlock.run(XML, states=path, mode="lockstep", solver="pinv")
    off = float(results.motion.rpartition("up to ")[2])
    recording = oarlock.check(XML, states=path, budget=0).examination.recording
    assert off == pytest.approx(recording.strayed, rel=1e-2)
    assert off > 1e-6


def test_a_duration_takes_its_beginning(rows, tmp_path):
    timestep = mujoco.MjModel.from_xml_string(XML).opt.timestep
    results = oarlock.run(XML, states=saved(tmp_path, rows), mode="one-step", solver="pinv", duration=20 * timestep)
    assert {row["steps_done"] for row in results.rows} == {20}
    longer = oarlock.run(XML, states=saved(tmp_path, rows), mode="one-step", solver="pinv", duration=1.0)
    assert {row["steps_done"] for row in longer.rows} == {STEPS}


def test_one_step_begins_at_every_row(rows, tmp_path):
    results = oarlock.run(XML, states=saved(tmp_path, rows), mode="one-step", solver="pinv", form="matched")
    steps = table(results, "one-step-matched")
    assert np.array_equal(np.array(steps["qpos"].to_list()), rows["qpos"])
    assert steps["trajectory_diff"].max() < 1e-9  # from each row to the next of the log


def test_the_command_takes_it_and_says_so(rows, tmp_path, oarlock_here):
    (tmp_path / "bar.xml").write_text(XML)
    path = saved(tmp_path, rows)
    done = oarlock_here("run", "bar.xml", "--states", path.name, "--mode", "lockstep", "--out", "kept")
    assert done.returncode == 0, done.stderr
    assert f"from the states '{path.name}' (120 rows from 0 to 0.238 s); the controls of the log" in done.stdout
    again = oarlock_here("run", "bar.xml", "--mode", "lockstep", "--duration", "0.24", "--out", "kept")
    assert "runs from another start or with other controls" in again.stderr


def test_bad_input_is_one_line(rows, tmp_path):
    path = saved(tmp_path, rows)
    for asked, said in (
        ({"controls": "random"}, "a start or controls besides a log of states"),
        ({"keyframe": "home"}, "a start or controls besides a log of states"),
        ({"stepping": "native"}, "no native stepping: a log of states"),
        ({"timestep": 1e-3}, "expected a row every 0.001 s"),
    ):
        with pytest.raises(InputError, match=said):
            oarlock.run(XML, states=path, **asked)
    with pytest.raises(InputError, match=r"nowhere\.npz"):
        oarlock.run(XML, states="nowhere.npz")
