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
