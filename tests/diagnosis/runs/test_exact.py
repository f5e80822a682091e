"""The exact run beside a recorded one: where it ends, and what is left of one that diverged."""

import math

import mujoco
import numpy as np
import oarlock
import pytest
from mechanisms import four_bar
from oarlock.diagnosis.runs.exact import record_exact
from oarlock.stepping import native_path
from oarlock.tables.promise import ERROR_BOUND

AWAY = four_bar(joint='stiffness="-1e5"', rest='<keyframe><key name="off" qpos="1e-3 0 0"/></keyframe>')
"""Springs that push away from their rest, so that every engine is thrown about until its numbers overflow."""


@pytest.mark.parametrize("stepping", ["native", "python"])
def test_an_exact_run_that_overflows_diverged_at_its_time(monkeypatch, stepping):
    if stepping == "python":
        monkeypatch.setattr(native_path, "refusal", lambda: "not here")
    model = mujoco.MjModel.from_xml_string(AWAY)
    data = mujoco.MjData(model)
    data.qvel[:] = 1e-3, 0.0, 0.0
    run = record_exact(model, data.qpos, data.qvel, {}, 500)
    assert run.end.how == "diverged"
    assert 0 < run.end.time_s < 0.1
    assert len(run.time) == len(run.qpos) == round(run.end.time_s / run.timestep_s)


def test_nothing_is_computed_from_an_exact_run_that_diverged(tmp_path):
    path = tmp_path / "away.xml"
    path.write_text(AWAY)
    document = oarlock.check(path).document()
    assert document["exact"] is None
    assert document["missing"]["exact"].startswith("it diverged at t = 0.01")
    assert {one["exact_metres"] for one in document["drift"]} == {None}
    assert not {one["code"] for one in document["findings"]} & {"L5", "U2", "U4", "U5"}


def test_the_exact_solution_says_how_far_it_got_and_how_far_it_is_off(tmp_path):
    path = tmp_path / "bar.xml"
    path.write_text(four_bar(rest='<keyframe><key name="up" qvel="3 -3 0"/></keyframe>'))
    found = oarlock.check(path, budget=0, integrator="rk4")
    exact = found.document()["exact"]
    assert exact["end"] == {"how": "finished", "time_s": pytest.approx(1.998), "message": ""}
    assert 0 < exact["error"] < ERROR_BOUND
    assert exact["integrator"] == "rk4"


CRANK, FRAME, END = 0.3, 0.8, (0.4, 0.35)
"""m: of a four-bar whose coupler and rocker meet at ``END`` while its crank stands upright."""

DRIVEN = f"""
<mujoco>
  <option timestep="0.001"/>
  <default><joint axis="0 1 0"/><geom type="capsule" size="0.02" density="500" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body><joint name="crank"/><geom fromto="0 0 0 0 0 {CRANK}"/>
      <body name="coupler" pos="0 0 {CRANK}"><joint/><geom fromto="0 0 0 {END[0]} 0 {END[1] - CRANK}"/></body>
    </body>
    <body name="rocker" pos="{FRAME} 0 0"><joint/><geom fromto="0 0 0 {END[0] - FRAME} 0 {END[1]}"/></body>
  </worldbody>
  <equality><connect body1="coupler" body2="rocker" anchor="{END[0]} 0 {END[1] - CRANK}"/></equality>
  <actuator><motor name="m" joint="crank" gear="GEAR"/></actuator>
</mujoco>"""


def test_whole_steps_of_a_higher_order_do_where_they_come_as_close():
    model = mujoco.MjModel.from_xml_string(DRIVEN.replace("GEAR", "-100"))
    data = mujoco.MjData(model)
    run = record_exact(model, data.qpos, data.qvel, {"m": "1.0"}, 300)
    assert (run.integrator, run.note) == ("rk4", "in place of euler, which is too far off")
    assert 0 < run.error.max() < 1e-5
    assert run.drift[:, 0].max() < 1e-12
    model.opt.timestep *= 0.1
    finer = record_exact(model, data.qpos, data.qvel, {"m": "1.0"}, 3000)
    # The crank turns back at a speed that its motor gives it, and what is off there is told by both.
    assert np.abs(run.qpos - finer.qpos[::10]).max() < 2.0 * (run.error.max() + finer.error.max())


@pytest.mark.parametrize(("gear", "why"), [("-800", "was lost at t = 0.0"), ("-200", "is too far off")])
def test_a_motor_that_drives_a_crank_into_its_dead_point_is_followed_by_finer_steps(gear, why):
    """Stretched out, coupler and rocker make a triangle with crank and frame: the crank turns no farther."""
    reach = math.hypot(END[0], END[1] - CRANK) + math.hypot(END[0] - FRAME, END[1])
    farthest = 0.5 * math.pi - math.acos((CRANK**2 + FRAME**2 - reach**2) / (2.0 * CRANK * FRAME))
    model = mujoco.MjModel.from_xml_string(DRIVEN.replace("GEAR", gear))
    data = mujoco.MjData(model)
    run = record_exact(model, data.qpos, data.qvel, {"m": "1.0"}, 300)
    assert (run.end.how, run.integrator) == ("finished", "rk4")
    assert run.end.time_s == pytest.approx(0.299)
    assert f"at a tenth of the timestep: with euler at the whole one it {why}" in run.note
    np.testing.assert_allclose(run.time, 0.001 * np.arange(300), atol=1e-12)
    assert run.drift[:, 0].max() < 1e-12
    error = float(run.error.max())
    assert 0 < error < 1e-6
    # Poses a step apart miss the turning point by what the crank goes in half a step at most.
    crank = run.qpos[:, 0]
    assert farthest - error <= crank.min() < farthest + 0.5 * np.abs(np.diff(crank)).max()
