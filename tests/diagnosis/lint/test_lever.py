"""Tendons over a pulley that contradict a belt: the lever that is told, and the side site that mends it."""

import mujoco
import numpy as np
import pytest
from seen import of_text, only

ARM = """<mujoco>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="drum" pos="0 .1 0"><joint name="drum" axis="0 1 0"/><geom size=".02" mass=".2"/></body>
    <body name="arm">
      {shoulder}<geom type="capsule" size=".01" fromto="0 0 0 .2 0 0" mass=".5"/>
      <geom name="wheel" type="cylinder" size="{radius} .01" pos=".2 0 0" euler="1.5707963 0 0" mass=".05"/>
      <site name="near" pos=".02 0 {near}"/><site name="side" pos=".2 0 -.06"/><site name="top" pos=".2 0 .06"/>
      <body name="hand" pos=".2 0 0" euler="0 -.5 0">
        <joint name="wrist" axis="0 -1 0"/><geom type="capsule" size=".01" fromto=".02 0 0 .15 0 0" mass=".2"/>
        <site name="far" pos=".12 0 {near}"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="cord"><site site="near"/><geom geom="wheel"{side}/><site site="far"/></spatial>
    <fixed name="line"><joint joint="drum" coef="{radius}"/></fixed>
  </tendon>
  <equality>
    <joint name="belt" joint1="wrist" joint2="drum" polycoef="0 1 0 0 0"/>
    <tendon name="cable" {order} polycoef="0 1 0 0 0"/>
  </equality>
  <actuator><motor joint="drum"/></actuator>
</mujoco>"""

SHOULDER = '<joint name="shoulder" axis="0 1 0"/>'
FIRST, SECOND = 'tendon1="cord" tendon2="line"', 'tendon1="line" tendon2="cord"'


def lever(text: str, tendon: str, joint: str) -> float:
    """dL/dq in the model's own pose, by plain MuJoCo."""
    model = mujoco.MjModel.from_xml_string(text)
    lengths = []
    for step in (1e-5, -1e-5):
        data = mujoco.MjData(model)
        data.joint(joint).qpos[0] = step
        mujoco.mj_forward(model, data)
        lengths.append(float(data.tendon(tendon).length[0]))
    return (lengths[0] - lengths[1]) / 2e-5


@pytest.mark.parametrize("shoulder", ["", SHOULDER])
@pytest.mark.parametrize("order", [FIRST, SECOND])
@pytest.mark.parametrize("radius", [0.02, 0.035])
def test_the_wrong_side_of_a_pulley(shoulder, order, radius):
    """With a shoulder the group moves otherwise, and only what is driven is held."""
    given = {"shoulder": shoulder, "order": order, "radius": radius, "near": -0.02}
    text = ARM.format(side="", **given)
    one = only(of_text(text), "L9")
    assert (one.element, one.figures["also"]) == ("cable", ["belt"])
    assert one.figures["lever"] == pytest.approx(lever(text, "cord", "wrist"), rel=1e-4)
    assert one.figures["wanted"] == pytest.approx(radius, rel=1e-4)
    assert '<geom geom="wheel" sidesite="side"/>' in one.line
    mended = ARM.format(side=' sidesite="side"', **given)
    assert lever(mended, "cord", "wrist") == pytest.approx(radius, rel=1e-4)
    assert not {"L9", "S3"} & {one.code for one in of_text(mended)}


def test_a_lever_that_no_side_mends():
    """Of a belt of another ratio the lever is told, and no site."""
    text = ARM.format(side=' sidesite="side"', shoulder=SHOULDER, order=FIRST, radius=0.02, near=-0.02)
    text = text.replace('joint2="drum" polycoef="0 1 ', 'joint2="drum" polycoef="0 0.5 ')
    one = only(of_text(text), "L9")
    assert one.figures["wanted"] == pytest.approx(0.04, rel=1e-4)
    assert "sidesite" not in one.line
    assert np.sign(one.figures["lever"]) == 1
