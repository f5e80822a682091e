"""A log of what a program really did, in place of MuJoCo's own run."""

import mujoco
import numpy as np
import oarlock
import pytest
from logs import STEPS, XML, logged, saved
from oarlock.base.errors import InputError
from oarlock.mechanics.state_log import StateLog


@pytest.mark.parametrize("kind", ["npz", "csv"])
def test_the_log_of_a_run_is_that_run(tmp_path, kind):
    """Drift, its causes and the exact run are those of the same controls; the run itself is the log's."""
    rows = logged()
    path = saved(tmp_path, rows, kind)
    of_log = oarlock.check(XML, states=path, budget=0)
    np.savez(tmp_path / "controls.npz", time=rows["time"], motor=rows["ctrl"][:, 0])
    timestep = mujoco.MjModel.from_xml_string(XML).opt.timestep
    of_run = oarlock.check(XML, controls=str(tmp_path / "controls.npz"), duration=STEPS * timestep, budget=0)
    recorded, own = of_log.examination.recording, of_run.examination.recording
    assert np.array_equal(recorded.qpos, rows["qpos"])
    assert np.array_equal(recorded.ctrl, rows["ctrl"])
    assert np.abs(recorded.position - own.position).max() < 1e-12
    assert recorded.strayed < 1e-12
    causes, same = (one.causes.sort("equality", "cause") for one in (of_log, of_run))
    numbers = [name for name, kind in causes.schema.items() if kind.is_numeric()]
    assert causes.height == same.height > 0
    assert np.allclose(causes.select(numbers), same.select(numbers), rtol=1e-6, atol=1e-9, equal_nan=True)
    assert np.abs(of_log.examination.exact.qpos - of_run.examination.exact.qpos).max() < 1e-12


def test_forces_that_the_log_does_not_have_leave_the_causes_open(tmp_path):
    """Its drift is what was measured; by what it came about is not known, and is not said."""
    rows = logged(np.array([0.0, 0.0, 30.0]))
    checked = oarlock.check(XML, states=saved(tmp_path, rows), budget=1)
    exam = checked.examination
    assert exam.attribution is exam.exact is exam.recipe is None
    assert "misses the next one by up to" in exam.missing["causes"]
    (finding,) = [one for one in checked.verdict if one.code == "R3"]
    assert finding.severity == "warning"
    assert finding.figures["strayed"] == exam.recording.strayed
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    worst = 0.0
    for qpos in rows["qpos"]:
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        worst = max(worst, np.abs(data.efc_pos[: data.ne]).max())
    assert exam.recording.drift.max() == pytest.approx(worst, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda rows: {**rows, "qpos": rows["qpos"][:, :2]}, "'qpos' has 2 numbers a row, expected 3"),
        (lambda rows: {name: rows[name] for name in ("time", "qpos")}, "no 'qvel', expected 3 numbers a row"),
        (lambda rows: {**rows, "speed": rows["time"]}, "unknown column in .* 'speed'"),
        (
            lambda rows: {name: values[::2] for name, values in rows.items()},
            "rows 1 and 2 are 0.00. s apart, expected a",
        ),
        (lambda rows: {**rows, "qvel": rows["qvel"] * np.nan}, "column 'qvel', row 1: nan, expected a finite number"),
        (lambda rows: {**rows, "ctrl": rows["ctrl"][1:]}, "column 'ctrl' has 119 values, expected 120, as 'time'"),
    ],
)
def test_what_is_wrong_with_a_log_is_one_line(tmp_path, change, line):
    path = saved(tmp_path, change(logged()))
    with pytest.raises(InputError, match=line):
        oarlock.check(XML, states=path, budget=0)


def test_quaternions_of_a_log_are_quaternions(tmp_path):
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><freejoint/><geom size="0.1"/></body></worldbody></mujoco>'
    )
    rows = {"time": np.arange(3) * model.opt.timestep, "qpos": np.tile(model.qpos0, (3, 1)), "qvel": np.zeros((3, 6))}
    assert len(StateLog(saved(tmp_path, rows), model)) == 3
    rows["qpos"][1, 3] = 0.5
    with pytest.raises(InputError, match=r"qpos 3 to 6, row 2: a quaternion of norm 0\.5, expected 1"):
        StateLog(saved(tmp_path, rows), model)


def test_a_log_has_start_and_controls(tmp_path):
    path = saved(tmp_path, logged())
    with pytest.raises(InputError, match="besides a log of states, expected one of the two"):
        oarlock.check(XML, states=path, keyframe="home")
    with pytest.raises(InputError, match=r"expected a log of states FILE.csv or FILE.npz"):
        oarlock.check(XML, states="log.txt")


def test_a_fix_is_not_tried_beside_a_log(tmp_path):
    checked = oarlock.check(XML, states=saved(tmp_path, logged()), budget=0)
    with pytest.raises(InputError, match=r"expected no log of states"):
        checked.fix(tmp_path / "fixed.xml")
