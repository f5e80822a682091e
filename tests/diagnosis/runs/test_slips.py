"""Objects that a gripper loses, beside plain MuJoCo with the cure that is named."""

import mujoco
import oarlock
import pytest

GRIP = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="1 1 0.1"/>
  <body name="hand" pos="0 0 0.4"><geom type="box" size="0.06 0.02 0.01" pos="0 0 0.05" contype="0" conaffinity="0"/>
    <body name="left" pos="-0.045 0 0"><joint name="left" type="slide" axis="1 0 0" range="0 0.03" damping="5"/>
      <geom name="pad_l" type="box" size="0.005 0.01 0.03" mass="0.05" {pad}/></body>
    <body name="right" pos="0.045 0 0"><joint name="right" type="slide" axis="-1 0 0" range="0 0.03" damping="5"/>
      <geom name="pad_r" type="box" size="0.005 0.01 0.03" mass="0.05" {pad}/></body></body>
  <body name="cube" pos="0 0 0.39"><freejoint/>
    <geom name="cube" type="box" size="0.02 0.02 0.02" mass="0.2" {pad}/></body>
  </worldbody><equality><joint name="pair" joint1="right" joint2="left" solref="0.004 1"/></equality>
  <actuator><position name="grip" joint="left" kp="400" kv="10"/></actuator>
  <keyframe><key name="k" qpos="0.0199 0.0199 0 0 0.39 1 0 0 0" ctrl="{ctrl}"/></keyframe></mujoco>"""


def slip(tmp_path, **given):
    file = tmp_path / "grip.xml"
    file.write_text(GRIP.format(**{"pad": "", "ctrl": "0.04"} | given))
    checked = oarlock.check(file, budget=0)
    return next((one for one in checked.verdict if one.code == "C6"), None), checked.answer


def height(**given) -> float:
    model = mujoco.MjModel.from_xml_string(GRIP.format(**{"pad": "", "ctrl": "0.04"} | given))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(1000):
        mujoco.mj_step(model, data)
    return float(data.body("cube").xpos[2])


def test_contacts_without_friction_are_named_and_condim_3_holds(tmp_path):
    one, answer = slip(tmp_path, pad='condim="1"')
    assert one.element == "cube"
    assert 'condim="3"' in answer
    assert height(pad='condim="1"') < 0.1
    assert height(pad='condim="3"') > 0.35


def test_pads_that_are_too_smooth(tmp_path):
    one, answer = slip(tmp_path, pad='friction="0.1"')
    assert one is not None
    assert "friction 0.4 in place of 0.1" in answer or "friction 0.2 in place of 0.1" in answer
    assert height(pad='friction="0.1"') < 0.1 < 0.3 < height(pad='friction="0.4"')


@pytest.mark.parametrize("given", [{}, {"pad": 'friction="2"'}])
def test_what_is_held_is_not_named(given, tmp_path):
    assert slip(tmp_path, **given)[0] is None
