"""Points that no pose brings together, beside plain MuJoCo with the site that is named."""

import re

import mujoco
import numpy as np
import oarlock
import pytest

ROCKER = """<mujoco><compiler angle="radian"/><option timestep="0.001"/>
  <default><geom type="capsule" size="0.01" contype="0" conaffinity="0"/><joint axis="1 0 0" damping="0.02"/></default>
  <worldbody><body name="crank"><joint name="crank"/><geom fromto="0 0 0 0 0.1 0.1"/>
    <body name="rod" pos="0 0.1 0.1"><joint name="rod"/><geom fromto="0 0 0 0 0.3 0"/><site name="eye" pos="{eye}"/>
    </body></body>
  <body name="rocker" pos="0 0.4 0"><joint name="rocker"/><geom fromto="0 0 0 0 0 0.1"/><site name="pin" pos="{pin}"/>
  </body></worldbody><equality><connect name="end" site1="eye" site2="pin"/></equality></mujoco>"""


def left(text: str) -> float:
    """What stays open at the end of 2 s of plain MuJoCo, m."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 2000)
    mujoco.mj_kinematics(model, data)
    return float(np.linalg.norm(data.site_xpos[0] - data.site_xpos[1]))


@pytest.mark.parametrize(("eye", "pin"), [("0.015 0.3 0", "0 0 0.1"), ("0 0.3 0", "-0.02 0 0.1")])
def test_a_gap_across_the_plane_is_told_with_the_site_that_closes_it(eye, pin):
    text = ROCKER.format(eye=eye, pin=pin)
    checked = oarlock.check(text, budget=0, controls="constant")
    (one,) = [one for one in checked.verdict if one.code == "S2"]
    assert "along x of the world apart" in one.line
    assert "across the plane" in checked.answer
    site, place = re.search(r'pos="([^"]*)" of site \'(\w+)\'', one.line).group(2, 1)
    moved = ROCKER.format(**({"eye": eye, "pin": pin} | {site: place}))
    assert left(text) > 0.01
    assert left(moved) < 0.1 * left(text)


def test_of_what_cannot_close_no_part_is_softness():
    """The load does not make the gap, and no stiffness takes it."""
    checked = oarlock.check(ROCKER.format(eye="0.015 0.3 0", pin="0 0 0.1"), budget=0, controls="constant")
    from oarlock.diagnosis.page.chapters.causes import causes

    chapter = causes(checked.examination)
    text = " ".join(block.text for block in chapter.blocks if block.kind == "text" and not block.detail)
    assert "softness" not in text
    short = next(block.short for block in chapter.blocks if block.kind == "table" and block.short is not None)
    assert not any("%" in cell for row in short.rows for cell in row)


TRIPOD = """<mujoco><option timestep="0.002"/><default><geom type="capsule" size="0.01" contype="0" conaffinity="0"/>
    <joint axis="1 0 0" damping="0.05"/></default><worldbody>
  <body name="a" pos="0 0 0"><joint name="a"/><geom fromto="0 0 0 0 0 0.2"/><site name="a" pos="0 0 0.2"/></body>
  <body name="b" pos="0 0.3 0"><joint name="b"/><geom fromto="0 0 0 0 0 0.2"/><site name="b" pos="0 0 0.2"/></body>
  <body name="top" pos="0 0 0.2"><joint name="x" type="slide" axis="0 1 0"/><joint name="z" type="slide" axis="0 0 1"/>
    <joint name="turn"/><geom fromto="0 0 0 0 0.3 0"/><site name="p"/><site name="q" pos="0 0.3 0"/></body></worldbody>
  <equality><connect name="left" site1="a" site2="{left}"/><connect name="right" site1="b" site2="{right}"/></equality>
  </mujoco>"""


def test_sites_that_are_exchanged_are_told_and_the_pose_is_not_moved(tmp_path):
    file = tmp_path / "m.xml"
    file.write_text(TRIPOD.format(left="q", right="p"))
    checked = oarlock.check(file, controls="constant", budget=0)
    (one,) = [one for one in checked.verdict if one.code == "S1"]
    assert "with the second sites of 'left' and 'right' exchanged" in checked.answer
    assert "T1" not in {each.code for each in checked.verdict}
    assert one.figures["meant"]
    model = mujoco.MjModel.from_xml_string(TRIPOD.format(left="p", right="q"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-12
    assert "S1" not in checked.fix(tmp_path / "fixed.xml").mended


def test_a_coupling_of_one_joint_says_so():
    text = """<mujoco><worldbody><body name="l"><joint name="l" axis="0 1 0" damping="0.1"/>
      <geom type="sphere" size="0.02" mass="0.1"/></body>
      <body name="r" pos="0.1 0 0"><joint name="r" axis="0 1 0" damping="0.1"/>
      <geom type="sphere" size="0.02" mass="0.1"/></body></worldbody>
      <equality><joint name="mimic" joint1="r"/></equality>
      <actuator><position joint="l" kp="1" kv="0.02"/></actuator></mujoco>"""
    assert oarlock.check(text, budget=0).answer.startswith("'mimic' names no joint2, and so holds joint 'r' at 0 ")
