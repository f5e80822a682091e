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
