"""Fixes that write what findings name: an armature, an equality that was switched off."""

import mujoco
import numpy as np
import oarlock
import pytest

BARS = """<mujoco><option timestep="0.002"/>
  <default><geom type="capsule" size="0.008" contype="0" conaffinity="0" density="900"/>
    <joint axis="0 1 0" damping="0.01"/></default><worldbody>
  <body name="crank" pos="0 0 0.5"><joint name="crank"/><geom fromto="0 0 0 0 0 0.06"/>
    <body name="rod" pos="0 0 0.06"><joint name="rod"/><geom fromto="0 0 0 0.3 0 0.12"/></body></body>
  <body name="rocker" pos="0.3 0 0.5"><joint name="rocker"/><geom fromto="0 0 0 0 0 0.18"/></body></worldbody>
  <equality><connect name="pin" body1="rod" body2="rocker" anchor="0.3 0 0.12" {active}/></equality>
  <actuator><position name="servo" joint="crank" kp="{kp}" {kv}/></actuator>
  <keyframe><key name="k" ctrl="0.3"/></keyframe></mujoco>"""


def fixed(tmp_path, **given):
    file, out = tmp_path / "m.xml", tmp_path / "out.xml"
    file.write_text(BARS.format(**{"active": "", "kp": 5, "kv": 'kv="0.01"'} | given))
    return oarlock.check(file, budget=2).fix(out), out


def apart(path) -> float:
    """How far the ends of the rod and of the rocker part in plain MuJoCo; infinite if it diverges."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    most = 0.0
    for _ in range(round(2.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        ends = [
            data.body(name).xpos + data.body(name).xmat.reshape(3, 3) @ np.array(end)
            for name, end in (("rod", (0.3, 0.0, 0.12)), ("rocker", (0.0, 0.0, 0.18)))
        ]
        most = max(most, float(np.linalg.norm(ends[0] - ends[1])))
    return np.inf if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number else most


def test_an_equality_that_was_switched_off_is_switched_on(tmp_path):
    fix, out = fixed(tmp_path, active='active="false"')
    assert 'active="true"' in out.read_text()
    assert {"L1", "L6"} <= set(fix.mended)
    assert apart(tmp_path / "m.xml") > 0.1
    assert apart(out) < 1e-3


def test_an_armature_that_a_servo_lacks_is_written_and_keeps_the_run_finite(tmp_path):
    fix, out = fixed(tmp_path, kp=400, kv='kv="0.5"')
    assert "armature=" in out.read_text()
    assert any("armature" in str(one) for one in fix.changes)
    assert "A1" in fix.mended
    assert apart(tmp_path / "m.xml") == np.inf
    assert apart(out) < 0.01


@pytest.mark.parametrize("word", ["armature", "active"])
def test_neither_is_written_where_nothing_asks_for_it(word, tmp_path):
    _, out = fixed(tmp_path)
    assert word not in out.read_text()


WHEELS = """<mujoco><option timestep="0.002"/><default><geom contype="0" conaffinity="0"/>
    <joint damping="0.01" axis="0 1 0"/></default><worldbody>
  <body><joint name="p"/><geom type="cylinder" size="0.03 0.01" euler="90 0 0" mass="0.2"/></body>
  <body pos="0.12 0 0"><joint name="q"/><geom type="cylinder" size="0.09 0.01" euler="90 0 0" mass="1"/></body>
  </worldbody><equality><joint name="mesh" joint1="p" joint2="q" polycoef="{polycoef} 0 0 0"/></equality>
  <actuator><velocity joint="p" kv="0.03"/></actuator><keyframe><key ctrl="4"/></keyframe></mujoco>"""


def test_beside_a_ratio_of_another_mechanism_no_settings_are_written(tmp_path):
    file = tmp_path / "m.xml"
    file.write_text(WHEELS.format(polycoef="0 -0.3333333"))
    checked = oarlock.check(file)
    fix = checked.fix(tmp_path / "fixed.xml")
    assert "L13" in {one.code for one in fix.left}
    assert "solref" not in (tmp_path / "fixed.xml").read_text()
    assert any("would only hide what is wrong" in said for said in fix.left_out)


RACKS = """<mujoco><option timestep="0.002" gravity="0 0 0"/><default><geom contype="0" conaffinity="0" mass="0.1"/>
    <equality solref="0.005 1"/></default><worldbody>
  <body><joint name="pinion" axis="0 1 0" damping="0.02" armature="0.01"/><geom size="0.02"/></body>
  <body pos="0.05 0 0"><joint name="east" type="slide" axis="1 0 0" range="0 0.03" limited="true" damping="1"/>
    <geom size="0.01"/></body>
  <body pos="-0.05 0 0"><joint name="west" type="slide" axis="-1 0 0" range="0 0.03" limited="true" damping="1"/>
    <geom size="0.01"/></body></worldbody>
  <equality><joint name="rack_e" joint1="east" joint2="pinion" polycoef="0 {ratio} 0 0 0"/>
    <joint name="rack_w" joint1="west" joint2="pinion" polycoef="0 {ratio} 0 0 0"/></equality>
  <actuator><position joint="pinion" kp="3" kv="0.3"/></actuator><keyframe><key ctrl="2"/></keyframe></mujoco>"""


def test_ratios_in_millimetres_are_written_together_though_the_start_is_closed(tmp_path):
    """One alone would contradict the other. In plain MuJoCo the pinion then turns, and both racks go out."""
    file = tmp_path / "racks.xml"
    file.write_text(RACKS.format(ratio=12))
    checked = oarlock.check(file)
    assert {one.element for one in checked.verdict if one.code == "A2"} == {"rack_e", "rack_w"}
    fix = checked.fix(tmp_path / "fixed.xml")
    assert fix.reached
    assert not fix.by_hand
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "fixed.xml"))
    np.testing.assert_allclose(model.eq_data[:, :5], [[0.0, 0.012, 0.0, 0.0, 0.0]] * 2)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    while data.time < 2.0:
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.qpos, [2.0, 0.024, 0.024], rtol=0.05)


def test_a_constant_in_degrees_is_written_in_radians_and_the_pose_stays_near(tmp_path):
    file = tmp_path / "m.xml"
    file.write_text(WHEELS.format(polycoef="30 -3"))
    checked = oarlock.check(file)
    assert 'polycoef="0.523599 -3 0 0 0"' in checked.answer
    checked.fix(tmp_path / "fixed.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "fixed.xml"))
    assert abs(model.eq_data[0, 0] - np.radians(30.0)) < 1e-6
