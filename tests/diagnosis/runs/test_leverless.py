"""Starts in a dead point, beside plain MuJoCo with other forces and from the start that is told."""

import mujoco
import numpy as np
import oarlock
import pytest

TOGGLE = """<mujoco><compiler angle="radian"/><option timestep="0.001" gravity="0 0 0"/>
  <default><geom type="capsule" size="0.01" contype="0" conaffinity="0" density="1000"/>
    <joint axis="0 1 0" damping="0.01"/></default><worldbody>
  <body name="arm"><joint name="arm"/><geom fromto="0 0 0 0.2 0 0"/>
    <body name="link" pos="0.2 0 0"><joint name="knee"/><geom fromto="0 0 0 0.25 0 0"/></body></body>
  <body name="ram" pos="0.45 0 0"><joint name="ram" type="slide" axis="1 0 0" damping="1"/>
    <geom type="box" size="0.02 0.02 0.02"/></body></worldbody>
  <equality><connect name="pin" body1="link" body2="ram" anchor="0.25 0 0" solref="0.002 1"/></equality>
  <actuator><motor name="push" joint="{joint}" gear="-1"/></actuator>
  <keyframe><key name="k" qpos="{qpos}" ctrl="{force}"/></keyframe></mujoco>"""


def toggle(joint: str = "ram", qpos: str = "0 0 0", force: float = 5.0) -> str:
    return TOGGLE.format(joint=joint, qpos=qpos, force=force)


def found(text: str) -> tuple:
    checked = oarlock.check(text, budget=0, duration=1.0)
    return next((one for one in checked.verdict if one.code == "A11"), None), checked.answer


def way(text: str) -> float:
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    start = data.qpos[0]
    most = 0.0
    for _ in range(200):
        mujoco.mj_step(model, data)
        most = max(most, abs(data.qpos[0] - start))
    return most


def test_a_toggle_that_is_pushed_straight_stands_whatever_the_force():
    one, answer = found(toggle())
    assert answer.startswith("'pin': 'push' pushes with up to 5 N and has no lever")
    assert way(toggle()) < 1e-6
    assert way(toggle(force=50.0)) < 1e-6
    told = " ".join(f"{value:.6g}" for value in one.figures["qpos"])
    assert told in " ".join(f"{value:.6g}" for value in map(float, one.line.split('qpos="')[1].split('"')[0].split()))
    assert way(toggle(qpos=told)) > 0.5


@pytest.mark.parametrize("given", [{"joint": "arm"}, {"force": 0.0}])
def test_others_are_not_named(given):
    assert found(toggle(**given))[0] is None


def test_beside_the_dead_point_it_is_not_named():
    bent = 0.3
    knee = bent + np.arcsin(0.2 * np.sin(bent) / 0.25)
    slid = 0.2 * np.cos(bent) + 0.25 * np.cos(knee - bent) - 0.45
    assert found(toggle(qpos=f"{bent} {-knee} {slid}"))[0] is None


WHEELS = """<mujoco><compiler angle="radian"/><option timestep="0.001" integrator="implicitfast"/>
  <default><geom contype="0" conaffinity="0" density="1000"/><joint axis="0 1 0"/></default><worldbody>
  <body name="lead" pos="0.3 0 0"><joint name="lead" damping="0.05"/>
    <geom type="cylinder" size="0.1 0.01" euler="1.5707963 0 0"/>
    <body name="rod" pos="0 0 0.07"><joint name="rod" damping="0.001"/>
    <geom type="capsule" fromto="0 0 0 -0.6 0 0" size="0.01"/></body></body>
  <body name="led" pos="-0.3 0 0"><joint name="led" damping="0.3"/>
    <geom type="cylinder" size="0.1 0.01" euler="1.5707963 0 0"/>
    <geom type="sphere" size="0.03" pos="0 0 0.09" mass="1.5"/></body></worldbody>
  <equality><connect name="end" body1="rod" body2="led" anchor="-0.6 0 0" solref="0.004 1"/>{more}</equality>
  <actuator><velocity name="drive" joint="lead" kv="20"/></actuator>
  <keyframe><key name="k" ctrl="3"/></keyframe></mujoco>"""


def behind(more: str = "") -> float:
    """How far the wheel that is led stays behind the other, rad."""
    model = mujoco.MjModel.from_xml_string(WHEELS.format(more=more))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, 2000)
    return abs(float(data.qpos[0] - data.qpos[2]))


def test_wheels_that_part_in_line_are_no_softness_and_the_coupling_that_is_told_keeps_them(tmp_path):
    file = tmp_path / "m.xml"
    file.write_text(WHEELS.format(more=""))
    checked = oarlock.check(file)
    (one,) = [one for one in checked.verdict if one.code == "U5"]
    assert checked.answer.startswith("'end': at t = ")
    assert "its links come into line" in checked.answer
    coupling = one.figures["coupling"]
    assert coupling in one.line
    assert behind() > 1.0
    assert behind(coupling) < 0.1
