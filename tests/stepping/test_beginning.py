"""Where a run of a file begins, and what drives it: the rule, held against plain loops around ``mj_step``."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from mechanisms import four_bar, write_model
from oarlock import InputError, check, load_case, run
from oarlock.cases.conditions import Conditions
from oarlock.cases.motion import Motion
from oarlock.experiments.laboratory import Laboratory
from oarlock.experiments.opening import open_case
from oarlock.experiments.task import Task
from oarlock.stepping.beginning import beginning_of_case, beginning_of_file
from oarlock.stepping.solvers import SolverSpec
from tolerances import HELD_ERROR
from walks import require_equal

STEPS = 60

DRIVEN = """
  <actuator>
    <motor name="push" joint="crank" ctrlrange="-0.4 0.6" ctrllimited="true"/>
    {filter}
  </actuator>
"""
FILTER = '<general name="lag" joint="rocker" dyntype="filter" dynprm="0.05" gainprm="0.5"/>'
KEYS = """
  <keyframe>
    <key name="away" qvel="0.4 -0.4 0" {act} ctrl="{ctrl}"/>
    <key name="other" qvel="-1 1 0" {act} ctrl="{ctrl}"/>
  </keyframe>
"""


def written(folder: Path, *, keys: bool = True, act: bool = True, ctrl: str = "0.3", integrator: str = "Euler") -> Path:
    rest = DRIVEN.format(filter=FILTER if act else "")
    if keys:
        rest += KEYS.format(act='act="0.7"' if act else "", ctrl=f"{ctrl} -0.2" if act else ctrl)
    return write_model(folder, four_bar(rest=rest).replace("<option", f'<option integrator="{integrator}"'))


def loop(path: Path, key: int | None, control, steps: int = STEPS) -> np.ndarray:
    """Positions (steps, nq) of what a user writes: controls set before every mj_step."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, key)
    seen = []
    for _ in range(steps):
        seen.append(data.qpos.copy())
        if control is not None:
            data.ctrl[:] = control(data.time)
        mujoco.mj_step(model, data)
    return np.array(seen)


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "RK4"])
@pytest.mark.parametrize("keys", [True, False])
def test_check_runs_what_a_plain_loop_runs(tmp_path, integrator, keys):
    """Bit for bit: the keyframe with its controls and activations; without one held controls, at Runge–Kutta too."""
    path = written(tmp_path, keys=keys, integrator=integrator)
    recording = check(path, budget=0, duration=STEPS * 0.002).examination.recording
    assert recording is not None
    assert recording.integrator == integrator.lower()
    laws = beginning_of_file(mujoco.MjModel.from_xml_path(str(path))).laws.parsed()
    control = None if keys else lambda time: [laws[name].at(time) for name in ("push", "lag")]
    np.testing.assert_array_equal(recording.qpos, loop(path, 0 if keys else None, control))
    assert np.ptp(recording.qpos, axis=0).max() > 1e-3


def test_run_begins_where_check_begins(tmp_path):
    """MuJoCo's own walk of a run is the loop as well."""
    path = written(tmp_path, act=False, integrator="RK4")
    path.write_text(path.read_text().replace('qvel="0.4 -0.4 0"', ""))
    results = run(path, mode="free", solver="mujoco", duration=STEPS * 0.002)
    row = next(row for row in results.rows if row["run"] == "free-mujoco-rk4")
    frame = results.tables[results.rows.index(row)].collect()
    walked = np.array(frame["qpos"].to_list())
    assert results.motion == "from keyframe 'away'; the keyframe's controls, held"
    assert results.provenance["motion"] == results.motion
    np.testing.assert_array_equal(walked, loop(path, 0, None))


@pytest.mark.parametrize(
    ("asked", "begins", "driven"),
    [
        ({}, "keyframe 'away'", "the keyframe's controls, held"),
        ({"keyframe": "other"}, "keyframe 'other'", "the keyframe's controls, held"),
        ({"keyframe": "1"}, "keyframe 'other'", "the keyframe's controls, held"),
        (
            {"keyframe": "none"},
            "the model's own pose, at rest",
            "a random smooth control of every actuator (seed 0)",
        ),
        ({"keyframe": "none", "control": {"push": "t"}}, "the model's own pose, at rest", "controls push = t"),
        ({"control": {"push": 0.5}}, "keyframe 'away'", "the keyframe's controls, held, but push = 0.5"),
        ({"controls": "constant"}, "keyframe 'away'", "constant controls"),
    ],
)
def test_the_rule_and_what_is_asked_for(tmp_path, asked, begins, driven):
    model = mujoco.MjModel.from_xml_path(str(written(tmp_path)))
    found = beginning_of_file(model, Motion(**asked))
    assert (found.begins, found.driven) == (begins, driven)


def test_a_keyframe_without_controls_is_run_without(tmp_path):
    path = written(tmp_path, act=False, ctrl="0")
    assert beginning_of_file(mujoco.MjModel.from_xml_path(str(path))).laws == {}


def test_integrators_that_exact_runs_cannot_take_are_replaced_and_that_is_said(tmp_path):
    results = run(written(tmp_path, integrator="RK4"), mode="free", solver="pinv", form="hard", duration=0.02)
    assert {row["integrator"] for row in results.rows} == {"implicitfast"}
    assert results.motion.endswith("; implicitfast in place of rk4, for the model has 1 actuator activation(s)")


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"keyframe": "home"}, "unknown keyframe 'home', expected one of: away, other, none"),
        ({"keyframe": "7"}, "keyframe 7, expected a number from 0 to 1"),
        (
            {"controls": "sine"},
            "unknown kind of controls 'sine', expected one of: keyframe, constant, random, or a log",
        ),
        ({"keyframe": "none", "controls": "keyframe"}, "starts from no keyframe"),
        ({"control": {"pull": 1.0}}, "unknown actuator 'pull', expected one of: push, lag"),
        ({"control": {"push": "sin("}}, "sin("),
        ({"seed": -1}, "seed = -1"),
    ],
)
def test_a_mistake_is_named(tmp_path, asked, said):
    model = mujoco.MjModel.from_xml_path(str(written(tmp_path)))
    with pytest.raises(InputError) as raised:
        beginning_of_file(model, Motion(**asked))
    assert said in str(raised.value)


def test_a_case_says_where_it_starts(tmp_path):
    """``[start] keyframe`` with its activations, ``none`` for the model's own pose; no other can be asked for."""
    path = written(tmp_path)
    for line, speed in (('keyframe = "other"', -1.0), ('keyframe = "none"', 0.0), ("", 0.0)):
        (tmp_path / "case.toml").write_text(f'title = "x"\n[start]\n{line}\n')
        case = load_case(tmp_path)
        found = beginning_of_case(mujoco.MjModel.from_xml_path(str(path)), case)
        assert found.qvel[0] == speed
        assert found.act.tolist() == [0.7 if speed else 0.0]
        assert found.laws == {}
    with pytest.raises(InputError, match="says where it starts"):
        beginning_of_case(mujoco.MjModel.from_xml_path(str(path)), case, Motion(keyframe="other"))


MOCAP = """
<mujoco>
  <worldbody>
    <body name="hand" mocap="true" pos="0 0 1"/>
    <body name="load" pos="0 0 1"><freejoint name="load"/><geom size="0.05" mass="0.2"/></body>
  </worldbody>
  <equality><weld name="grip" body1="hand" body2="load"/></equality>
  <keyframe><key name="moved" qpos="0.3 0 1 1 0 0 0" mpos="0.3 0 1"/></keyframe>
</mujoco>"""


def test_mocap_bodies_are_where_the_keyframe_has_them(tmp_path):
    results = run(write_model(tmp_path, MOCAP), mode="free", form="hard", solver="pinv", duration=0.02)
    free = next(table for row, table in zip(results.rows, results.tables, strict=True) if row["form"] == "hard")
    np.testing.assert_allclose(np.array(free.collect()["qpos"].to_list())[:, 0], 0.3, atol=1e-12)


def test_a_log_replays_a_loop(tmp_path):
    """What a controller wrote, replayed by check from both kinds of files: the motion of that loop, bit for bit."""
    path = written(tmp_path, act=False, integrator="RK4")
    time = np.cumsum(np.full(STEPS, 0.002)) - 0.002
    wave = 0.3 * np.sign(np.sin(90.0 * time))
    np.savez(tmp_path / "log.npz", time=time, push=wave)
    rows = "".join(f"{one!r},{two!r}\n" for one, two in zip(time.tolist(), wave.tolist(), strict=True))
    (tmp_path / "log.csv").write_text(f"time,push\n{rows}")
    theirs = loop(path, 0, lambda now: wave[round(now / 0.002)])
    for name in ("log.npz", "log.csv"):
        recording = check(path, budget=0, duration=STEPS * 0.002, controls=str(tmp_path / name)).examination.recording
        assert recording is not None
        np.testing.assert_array_equal(recording.qpos, theirs)
    assert not np.array_equal(theirs, loop(path, 0, None))


@pytest.mark.parametrize("mode", ["calibration", "lockstep", "one-step", "free"])
@pytest.mark.parametrize(("integrator", "act"), [("rk4", False), ("implicitfast", True), ("euler", True)])
def test_both_paths_give_the_same(tmp_path, mode, integrator, act):
    """With held controls, a law, a log and activations at the start."""
    path = written(tmp_path, act=act)
    np.savez(tmp_path / "log.npz", time=np.arange(9) * 0.007, push=np.cos(np.arange(9.0)))
    for motion in (
        Motion(keyframe="none"),
        Motion(controls=str(tmp_path / "log.npz")),
        Motion(control={"push": "0.3*cos(20*t)"}),
    ):
        walker = SolverSpec("pinv" if mode == "lockstep" else "mujoco")
        task = Task(mode, walker, ("hard",), (SolverSpec("auto"),), integrator, "default")
        require_equal(open_case(path), task, 30, motion)


def test_half_a_step_is_driven_as_a_whole_one(tmp_path):
    """A held control changes at whole steps only, also in the walk with half the timestep that tells the error.

    The control jumps at every step, and is 0 half-way: sampled anew there it is another motion.
    """
    path = written(tmp_path, act=False, integrator="RK4")
    task = Task("free", SolverSpec("pinv"), ("hard",), (SolverSpec("pinv"),), "rk4", "default")
    motion = Motion(keyframe="none", control={"push": "0.4*(cos(250*PI*t))^2"})
    (result,) = Laboratory(open_case(path), Conditions(duration_s=0.2, motion=motion)).run(task)
    assert result.steps.frame()["error_estimate"].max() < HELD_ERROR
