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
    assert exam.missing["causes"] == "the steps of the log are not those of this model (R3)"
    (finding,) = [one for one in checked.verdict if one.code == "R3"]
    assert "misses the next one by up to" in finding.line
    assert ": forces that the log does not have, another model, or too few digits" in finding.line
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
        (lambda rows: {name: values[:1] for name, values in rows.items()}, "1 row, expected 2 at least: a state alone"),
        (lambda rows: {**rows, "qvel": rows["qvel"] * np.nan}, "column 'qvel', row 1: nan, expected a finite number"),
        (lambda rows: {**rows, "ctrl": rows["ctrl"][1:]}, "column 'ctrl' has 119 values, expected 120, as 'time'"),
    ],
)
def test_what_is_wrong_with_a_log_is_one_line(tmp_path, change, line):
    path = saved(tmp_path, change(logged()))
    with pytest.raises(InputError, match=line):
        oarlock.check(XML, states=path, budget=0)


@pytest.mark.parametrize(("every", "word"), [(2, "2nd"), (10, "10th")])
def test_a_log_of_every_so_manieth_step_is_not_one_of_another_timestep(tmp_path, every, word):
    path = saved(tmp_path, logged(every=every))
    with pytest.raises(InputError, match=rf"the log has every {word} step of the model, and needs each$"):
        oarlock.check(XML, states=path, budget=0)
    with pytest.raises(InputError, match=r"expected a row every 0.0015 s, the timestep of the model \(--timestep\)"):
        oarlock.check(XML, states=path, budget=0, timestep=0.0015)


@pytest.mark.parametrize("kind", ["npz", "csv", "short csv"])
def test_a_log_in_single_precision_is_read(tmp_path, kind):
    """Times that are off by the digits of such numbers, far beyond those of a timestep in double precision."""
    rows = {name: values.astype(np.float32) for name, values in logged().items()}
    rows["time"] = (rows["time"].astype(float) + 20.0).astype(np.float32)
    assert np.abs(np.diff(rows["time"].astype(float)) - 0.002).max() > 1e-4 * 0.002
    if kind == "short csv":
        columns = np.hstack([rows["time"][:, None], *(rows[name] for name in ("qpos", "qvel", "ctrl"))])
        names = ["time", *(f"qpos{n}" for n in range(3)), *(f"qvel{n}" for n in range(3)), "ctrl0"]
        path = tmp_path / "log.csv"
        path.write_text("\n".join([",".join(names), *(",".join(map(str, row)) for row in columns)]))
    else:
        path = saved(tmp_path, rows, kind)
    checked = oarlock.check(XML, states=path, budget=0)
    recorded = checked.examination.recording
    assert np.array_equal(recorded.qpos.astype(np.float32), rows["qpos"])
    assert checked.examination.attribution is not None  # its steps are the model's


@pytest.mark.parametrize("kind", ["npz", "csv"])
def test_of_a_single_actuator_the_controls_may_be_a_vector(tmp_path, kind):
    rows = logged()
    rows["ctrl"] = rows["ctrl"][:, 0]
    if kind == "npz":
        path = saved(tmp_path, rows)
    else:
        path = saved(tmp_path, {**rows, "ctrl": rows["ctrl"][:, None]}, "csv")
        path.write_text(path.read_text().replace("ctrl0", "ctrl", 1))
    log = StateLog(path, mujoco.MjModel.from_xml_string(XML))
    np.testing.assert_array_equal(log.ctrl[:, 0], rows["ctrl"])
    lacking = {**rows, "qvel": rows["qvel"][:, 0]}
    with pytest.raises(InputError, match="'qvel' has 1 number a row, expected 3"):
        StateLog(saved(tmp_path, lacking), mujoco.MjModel.from_xml_string(XML))


def test_times_are_those_of_the_log(tmp_path):
    """Of the run, of the exact one beside it, and of what is said of both; all else is as if it began at 0."""
    rows = logged()
    early = oarlock.check(XML, states=saved(tmp_path, rows), budget=0)
    late = oarlock.check(XML, states=saved(tmp_path, {**rows, "time": rows["time"] + 34.5}), budget=0)
    for run in ("recording", "exact"):
        times = [getattr(one.examination, run).time for one in (early, late)]
        np.testing.assert_allclose(times[1] - times[0], 34.5, atol=1e-9)
        assert getattr(late.examination, run).end.time_s == pytest.approx(rows["time"][-1] + 34.5)
    drifts = [one.examination.drifts[0] for one in (early, late)]
    assert drifts[1].time_s == pytest.approx(drifts[0].time_s + 34.5)
    assert drifts[1].metres == pytest.approx(drifts[0].metres, rel=1e-9)
    assert f"t = {drifts[1].time_s:.4g} s" in drifts[1].at
    np.testing.assert_allclose(late.examination.exact.qpos, early.examination.exact.qpos, atol=1e-12)


def test_a_lint_looks_at_no_log(tmp_path, oarlock_here):
    path = saved(tmp_path, logged())
    with pytest.raises(InputError, match="a log of states with lint, expected one of the two"):
        oarlock.check(XML, states=path, lint=True)
    (tmp_path / "model.xml").write_text(XML)
    for flag, value in (("--states", path), ("--duration", "1"), ("--target", "1e-3"), ("--hold", "crank")):
        said = oarlock_here("check", "--lint", "model.xml", flag, value)
        assert said.returncode == 2
        assert said.stderr == f"oarlock: {flag} with --lint, expected one of the two: it shows a run\n"


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


def test_controls_that_the_log_lacks_are_named(tmp_path):
    """The motor moved what was logged: the model has it, and the log not what it was told."""
    rows = logged()
    del rows["ctrl"]
    checked = oarlock.check(XML, states=saved(tmp_path, rows), budget=0)
    assert checked.examination.driven == "no controls: the log has no 'ctrl'"
    (finding,) = [one for one in checked.verdict if one.code == "R3"]
    assert "it has no 'ctrl', and the model has 1 actuator" in finding.line


def test_a_duration_beyond_the_log_is_refused(tmp_path):
    path, timestep = saved(tmp_path, logged()), mujoco.MjModel.from_xml_string(XML).opt.timestep
    part = oarlock.check(XML, states=path, duration=0.5 * STEPS * timestep, budget=0)
    assert part.examination.recording.steps == STEPS // 2
    with pytest.raises(InputError, match=rf"duration = 5 s, expected at most {STEPS * timestep:g} s: the states '"):
        oarlock.check(XML, states=path, duration=5.0, budget=0)
