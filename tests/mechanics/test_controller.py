"""A controller is asked along MuJoCo's own run, and what it commands is a log like any other."""

import mujoco
import numpy as np
import oarlock
import polars as pl
import pytest
from mechanisms import four_bar
from oarlock.base.errors import InputError
from oarlock.mechanics.controller import commanded

XML = four_bar(rest='<actuator><motor name="motor" joint="crank"/><motor name="idle" joint="rocker"/></actuator>')


def follows(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Turns the crank after a sine: a servo of its own."""
    wanted = 0.3 * np.sin(5.0 * data.time)
    data.ctrl[0] = 2.0 * (wanted - data.qpos[0]) - 0.1 * data.qvel[0]


def log_of(path, steps):
    """What ``follows`` commands in a loop as anybody would write it."""
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    rows = []
    for _ in range(steps):
        follows(model, data)
        rows.append((data.time, data.ctrl[0]))
        mujoco.mj_step(model, data)
    np.savez(path, time=[row[0] for row in rows], motor=[row[1] for row in rows])
    return str(path)


def test_it_is_the_log_of_the_loop_that_it_drives(tmp_path):
    log = log_of(tmp_path / "log.npz", 50)
    timestep = mujoco.MjModel.from_xml_string(XML).opt.timestep
    checks = [
        oarlock.check(XML, duration=50 * timestep, budget=0, **given)
        for given in ({"control": follows}, {"controls": log})
    ]
    assert checks[0].drift.equals(checks[1].drift)
    assert np.array_equal(checks[0].examination.recording.ctrl, checks[1].examination.recording.ctrl)
    assert np.abs(checks[0].examination.recording.ctrl[:, 0]).max() > 0.1
    assert "controls of follows, along MuJoCo's own run" in str(checks[0].document())
    asked = {"mode": "free", "solver": ["mujoco", "auto"], "form": "hard", "duration": 50 * timestep}
    runs = [oarlock.run(XML, **asked, **given) for given in ({"control": follows}, {"controls": log})]
    tables = [run.steps.drop("step_us", "solve_ns") for run in runs]
    assert tables[0].equals(tables[1])
    assert "follows" in runs[0].motion


def test_what_it_never_moves_is_left_alone():
    model = mujoco.MjModel.from_xml_string(XML)
    start = model.qpos0.copy(), np.zeros(model.nv), np.zeros(0)
    laws, _ = commanded(model, start, follows, 20)
    assert list(laws) == ["motor"]
    assert laws.held


def pushes(model, data):
    data.qfrc_applied[0] = 5.0


def answers(model, data):
    return np.zeros(model.nu)


def steps(model, data):
    mujoco.mj_step(model, data)


class Integrates:
    """A controller with a state of its own."""

    def __init__(self):
        self.sum, self.asked = 0.0, 0

    def __call__(self, model, data):
        self.asked += 1
        self.sum += data.qpos[0]
        data.ctrl[0] = -0.5 * data.qpos[0] - 0.1 * self.sum


def test_one_with_a_state_walks_once():
    """MuJoCo's run is that of its own loop; every other run is given the same controls."""
    model = mujoco.MjModel.from_xml_string(XML)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    data, mine, theirs = mujoco.MjData(model), Integrates(), Integrates()
    data.qvel[:] = 0.0
    for _ in range(100):
        mine(model, data)
        mujoco.mj_step(model, data)
    results = oarlock.run(model, control=theirs, mode="lockstep", solver="auto", duration=100 * model.opt.timestep)
    assert theirs.asked == mine.asked == 100
    other = oarlock.run(model, control=Integrates(), mode="free", solver="mujoco", duration=100 * model.opt.timestep)
    for steps in (results.steps, other.steps):
        assert steps["qpos"].to_list()[0] == model.qpos0.tolist()
    last = other.steps.filter(pl.col("mode") == "free")["qpos"].to_list()[-1]
    data_before = mujoco.MjData(model)
    again = Integrates()
    for _ in range(99):
        again(model, data_before)
        mujoco.mj_step(model, data_before)
    assert np.abs(data_before.qpos - last).max() < 1e-12


def raises(model, data):
    raise KeyError("gain")


def blows_up(model, data):
    data.ctrl[1] = np.nan if data.time > 0.003 else 0.0


@pytest.mark.parametrize(
    ("control", "line"),
    [
        (raises, "control = raises raises KeyError at t = 0 s: 'gain'"),
        (blows_up, "control = blows_up gives nan for actuator 'idle' at t = 0.00"),
        (pushes, r"control = pushes writes data\.qfrc_applied at t = 0 s, expected data\.ctrl alone"),
        (answers, r"control = answers gives back ndarray, expected it to write data\.ctrl"),
        (steps, r"control = steps writes data\.time at t = 0 s"),
        (3, "control = 3, expected actuator → control, or a controller"),
    ],
)
def test_what_a_controller_does_wrong_is_one_line(control, line):
    for ask in (oarlock.check, oarlock.run):
        with pytest.raises(InputError, match=line):
            ask(XML, control=control, duration=0.05)


def test_a_controller_is_alone(tmp_path):
    with pytest.raises(InputError, match="controls = 'random' besides a controller, expected one of the two"):
        oarlock.check(XML, control=follows, controls="random")
    with pytest.raises(InputError, match="the model has no actuators"):
        oarlock.check(four_bar(), control=follows)


@pytest.mark.parametrize("law", ["1/t", "sqrt(t - 1)"])
def test_a_law_without_a_value_at_the_start_is_a_mistake(law):
    """Nothing is run, and no finding speaks of anything else."""
    with pytest.raises(InputError, match=r"at t = 0 s, expected a finite control"):
        oarlock.check(XML, control={"motor": law}, budget=0)
