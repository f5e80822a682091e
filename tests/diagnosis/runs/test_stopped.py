"""Limits that stop a loop where its equality wants to go on, beside plain MuJoCo without them."""

import mujoco
import numpy as np
import oarlock
import pytest
from places import FIXTURES
from tolerances import SAME_RUN

FILE = FIXTURES / "check" / "short_range.xml"


def opened(text: str, change=None) -> tuple[np.ndarray, np.ndarray]:
    """Deviations of the first equality, (steps), and coordinates, in two seconds of plain MuJoCo."""
    model = mujoco.MjModel.from_xml_string(text)
    if change is not None:
        change(model)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    rows, poses = [], []
    for _ in range(round(2.0 / model.opt.timestep)):
        mujoco.mj_forward(model, data)
        rows.append(abs(data.efc_pos[0]))
        poses.append(data.qpos.copy())
        mujoco.mj_step(model, data)
    return np.array(rows), np.array(poses)


def test_a_limit_that_stops_a_follower_is_named_before_the_softness():
    def unlimited(model):
        model.jnt_limited[model.joint("jaw").id] = 0

    text = FILE.read_text()
    (given, _), (without, poses) = opened(text), opened(text, unlimited)
    worst = int(given.argmax())
    left = without[max(0, worst - 20) : worst + 21].max()  # 2 % of 1000 steps
    assert left < 0.1 * given.max()
    checked = oarlock.check(FILE, budget=0)
    findings = checked.verdict
    one = findings[0]
    assert (one.code, one.element, one.figures["joint"]) == ("C5", "follows", "jaw")
    assert one.figures["limit"] == 0.012
    assert one.figures["wanted"] == pytest.approx(poses[max(0, worst - 20) : worst + 21, 1].max(), rel=SAME_RUN)
    assert one.figures["drift"] == pytest.approx(given.max(), rel=SAME_RUN)
    assert one.figures["drift_without"] == pytest.approx(left, rel=SAME_RUN)
    assert "the limit of joint 'jaw' (0.012 m) stops it where 'follows' wants up to" in one.line
    assert "C1" not in {one.code for one in findings}


TWO = """<mujoco>
  <compiler autolimits="true"/>
  <option timestep="0.001" gravity="0 0 0"/>
  <worldbody>
    <body><joint name="cam" axis="0 0 1"/><geom type="capsule" size="0.01" fromto="0 0 0 0.1 0 0"/></body>
    <body pos="0.5 0 0"><joint name="jaw" axis="0 0 1" range="RANGE"/>
      <geom type="capsule" size="0.01" fromto="0 0 0 0.1 0 0"/></body>
    <body pos="1 0 0"><joint name="flap" axis="0 0 1" range="-0.5 0.5"/>
      <geom type="capsule" size="0.01" fromto="0 0 0 0.1 0 0"/></body>
  </worldbody>
  <equality><joint name="follows" joint1="jaw" joint2="cam"/><joint name="also" joint1="flap" joint2="cam"/></equality>
  <actuator><position joint="cam" kp="5" kv="0.5"/></actuator>
  <keyframe><key name="go" ctrl="0.4"/></keyframe>
</mujoco>"""


@pytest.mark.parametrize(("given", "meant"), [("-0.6 0.6", True), ("-0.1 0.1", False), ("-10 10", False)])
def test_a_range_whose_number_would_do_in_radians_is_asked_after(tmp_path, given, meant):
    """Of 0.4 rad that are wanted: 0.6 degrees would do as radians; 0.1 would not; 10 are no radians."""
    file = tmp_path / "two.xml"
    file.write_text(TWO.replace("RANGE", given))
    (one,) = [one for one in oarlock.check(file, budget=0).verdict if one.code == "C5" and one.element == "follows"]
    assert one.figures["others"] == ["flap"]
    assert "without that limit and that of 'flap'" in one.line
    assert ('angle="radian" in <compiler>' in one.line) is meant


def test_forces_of_limits_have_the_unit_of_their_joint():
    (one,) = [one for one in oarlock.check(FILE, budget=0).verdict if one.code == "R2"]
    assert one.line.startswith("in MuJoCo's run limit of joint 'jaw' from t = ")
    assert one.line.endswith(" N")


def test_a_limit_that_is_wide_enough_is_not_named(tmp_path):
    file = tmp_path / "wide.xml"
    file.write_text(FILE.read_text().replace('range="0 0.012"', 'range="0 0.05"'))
    assert not {one.code for one in oarlock.check(file, budget=0).verdict} & {"C5", "R2"}


def test_a_limit_of_what_leads_does_not_open_its_loop(tmp_path):
    """It stops the drive itself: the coupling bears none of it."""
    text = (
        FILE.read_text()
        .replace('range="0 0.012"', 'range="0 0.05"')
        .replace('<joint name="cam"', '<joint name="cam" range="0 0.6"')
    )
    file = tmp_path / "leader.xml"
    file.write_text(text)
    codes = {one.code for one in oarlock.check(file, budget=0).verdict}
    assert "R2" in codes
    assert "C5" not in codes
