"""Equalities that are switched off and were meant to hold, beside runs of plain MuJoCo."""

import mujoco
import numpy as np
import pytest
from oarlock import check

LINK = """<mujoco><compiler autolimits="true"/><worldbody>
  <body name="crank"><joint name="crank" axis="0 1 0" damping="0.05"/>
    <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" contype="0" conaffinity="0"/>
    <body name="rod" pos="0.1 0 0"><joint name="elbow" axis="0 1 0" damping="0.01"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.01" contype="0" conaffinity="0"/></body></body>
  <body name="rocker" pos="0.4 0 -0.2"><joint name="rocker" axis="0 1 0" damping="0.05"/>
    <geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.01" contype="0" conaffinity="0"/></body>
  <body name="arm" pos="0 1 0"><joint name="arm" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" contype="0" conaffinity="0"/></body></worldbody>
  <equality><connect name="pin" body1="rod" body2="rocker" anchor="{anchor}" active="false"/>
  <joint name="pair" joint1="arm" joint2="crank" solref="0.004 1"/></equality></mujoco>"""


TIPS = {2: np.array([0.3, 0.0, 0.0]), 3: np.array([0.0, 0.0, 0.2])}
"""Body → its end that the pin joins."""


def finding(tmp_path, text, **options):
    path = tmp_path / "model.xml"
    path.write_text(text, encoding="utf-8")
    checked = check(path, duration=0.6, budget=0, **options)
    (one,) = [one for one in checked.document()["findings"] if one["code"] == "L6"]
    return one, checked.document()


def widest(text, seconds=0.6, on=False):
    """Of the tip of the rod from that of the rocker, or of the pin's own rows where it is switched on, m."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.eq_active[0] = on
    found = 0.0
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_forward(model, data)
        rod, rocker = (data.xpos[body] + data.xmat[body].reshape(3, 3) @ TIPS[body] for body in TIPS)
        found = max(found, float(np.linalg.norm(rod - rocker)))
        mujoco.mj_step(model, data)
    return found


def test_a_pin_that_is_switched_off_leads(tmp_path):
    text = LINK.format(anchor="0.3 0 0")
    one, document = finding(tmp_path, text)
    assert one["severity"] == "warning"
    assert one["figures"]["apart_m"] == pytest.approx(widest(text), rel=1e-2)
    assert document["answer"].startswith("'pin' is switched off")
    held = float(one["line"].partition("opens by at most ")[2].split()[0])
    assert held == pytest.approx(widest(text, on=True), rel=1e-2)
    assert held < 0.01 * one["figures"]["apart_m"]


GRASPS = {
    "an object that is free": ('<body name="rocker"', '<body name="rocker"><freejoint/></body><body name="post"'),
    "a target that is moved": ('<body name="rocker"', '<body name="rocker" mocap="true"/><body name="post"'),
}


@pytest.mark.parametrize("change", GRASPS.values(), ids=GRASPS)
def test_a_grasp_that_is_switched_on_later_is_a_note(tmp_path, change):
    text = LINK.format(anchor="0.3 0 0").replace(*change)
    text = text.replace("<freejoint/>", '<freejoint/><geom size="0.01" contype="0" conaffinity="0"/>')
    one, _ = finding(tmp_path, text)
    assert one["severity"] == "note"
    assert one["figures"] == {}


def test_sides_that_are_apart_at_the_start_are_no_loop_that_was_meant(tmp_path):
    """Begun from a keyframe in which the pin's two points are apart."""
    text = LINK.format(anchor="0.3 0 0").replace("</mujoco>", '<keyframe><key qpos="0 0.3 0 0"/></keyframe></mujoco>')
    one, document = finding(tmp_path, text)
    assert one["severity"] == "note"
    assert "switched off" not in document["answer"]


def test_all_that_is_switched_off_by_a_flag_is_told_once(tmp_path):
    text = LINK.format(anchor="0.3 0 0").replace(
        "<worldbody>", '<option><flag equality="disable"/></option><worldbody>', 1
    )
    path = tmp_path / "model.xml"
    path.write_text(text, encoding="utf-8")
    found = check(path, duration=0.2, budget=0).document()["findings"]
    assert {one["severity"] for one in found if one["code"] == "L6"} == {"note"}
    assert [one["severity"] for one in found if one["code"] == "L1"] == ["error"]
