"""Relative poses of welds in a fixed file, beside plain MuJoCo."""

from pathlib import Path

import mujoco
import numpy as np
import oarlock
import pytest

TURN = np.array([0.8, 0.0, 0.6, 0.0])
"""w x y z, of length 1."""

PLATE = """<mujoco>
  <option timestep="0.002"/>
  <default><geom contype="0" conaffinity="0"/><joint damping="0.3"/></default>
  <worldbody>
    <body name="base" pos="0.2 0 0.5"><joint name="base" axis="0 1 0"/><geom type="box" size="0.1 0.05 0.02"/></body>
    <body name="plate" pos="0.2 0.3 0.6" quat="0.8 0 0.6 0"><joint name="plate" axis="0 1 0"/>
      <geom type="box" size="0.1 0.05 0.02"/></body>
  </worldbody>
  <equality><weld name="bolt" body1="base" body2="plate" {attributes}/></equality>
</mujoco>"""


def fixed(folder: Path, text: str, **asked):
    (folder / "model.xml").write_text(text)
    checked = oarlock.check(folder / "model.xml", **({"duration": 0.3} | asked))
    return checked.fix(folder / "fixed.xml"), checked, mujoco.MjModel.from_xml_path(str(folder / "fixed.xml"))


def opened(model: mujoco.MjModel, key: int | None = None) -> float:
    """The largest row of the start in plain MuJoCo."""
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, key)
    mujoco.mj_forward(model, data)
    return float(np.abs(data.efc_pos[: data.ne]).max())


def relposes(fix) -> list[str]:
    return [one.what for one in fix.changes if one.what.startswith("relpose")]


@pytest.mark.parametrize(
    "given",
    [
        "0 0.3 0.1 0 0.6 0 0.8",  # x y z w
        "0 0.7 0.1 0.8 0 0.6 0",  # 0.4 m beside the drawing
    ],
)
@pytest.mark.parametrize("anchor", ["", 'anchor="0 0 0"'])
def test_a_relpose_that_nobody_drew_is_written_as_it_is_drawn(tmp_path, given, anchor):
    source = PLATE.format(attributes=f'{anchor} relpose="{given}"')
    fix, checked, model = fixed(tmp_path, source)
    assert "S7" in {one.code for one in checked.verdict}
    assert opened(checked.examination.model) > 0.3
    (said,) = relposes(fix)
    assert "'bolt'" in said
    assert said.endswith("(S7)")
    np.testing.assert_allclose(model.eq_data[0, 3:10], [0, 0.3, 0.1, *TURN], atol=1e-12)
    assert opened(model) < 1e-12
    assert fix.reached, fix.reason
    assert "S7" in fix.mended
    assert [one.before.count("relpose") for one in fix.lines if one.before] == [1]


REACHING = """<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" gravity="0 0 0"/>
  <default><geom contype="0" conaffinity="0" size="0.05" mass="0.3"/><joint damping="1"/></default>
  <worldbody>
    <body name="arm"><joint name="arm" type="slide" axis="1 0 0" range="0 {far}"/><geom/></body>
    <body name="tray" pos="1 0.2 0"><joint name="x" type="slide" axis="1 0 0" range="-0.1 {far}"/>
      <joint name="turn" axis="0 0 1"/><geom/></body>
  </worldbody>
  <equality><weld name="grip" body1="arm" body2="tray"/></equality>
  <keyframe><key name="gripped" qpos="0.4 0 0.3"/></keyframe>
</mujoco>"""


def test_a_weld_without_a_relpose_gets_that_of_the_keyframe_where_no_pose_meets_its_own(tmp_path):
    """The turn of the tray is locked at 0.25 and more: the drawn pose, which the weld holds, cannot be had."""
    text = REACHING.format(far=0.5).replace('name="turn"', 'name="turn" range="0.25 0.5"')
    fix, checked, model = fixed(tmp_path, text)
    assert checked.examination.pose.outside
    (said,) = relposes(fix)
    assert "no pose near the start meets it as it is written" in said
    assert opened(model, 0) < 1e-9 < 0.1 < opened(checked.examination.model, 0)
    np.testing.assert_array_equal(model.key_qpos[0], [0.4, 0, 0.3])
    assert fix.reached, fix.reason


def test_a_weld_whose_own_pose_is_near_keeps_it(tmp_path):
    fix, _, model = fixed(tmp_path, REACHING.format(far=0.5))
    assert relposes(fix) == []
    (said,) = (said for said in fix.left_out if said.startswith("relpose"))
    assert "the closed pose holds the weld as it is" in said
    assert opened(model, 0) < 1e-9
    assert model.key_qpos[0].tolist() != [0.4, 0, 0.3]


CARRIED = """<mujoco>
  <option timestep="0.002"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="arm" pos="0 0 0.5"><joint name="arm" axis="0 1 0" damping="2"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.02"/></body>
    <body name="tray" pos="0.4 0.1 0.5" quat="0.8 0 0.6 0"><freejoint/>
      <geom type="box" pos="0.1 0 0.15" size="0.15 0.05 0.01" mass="1"/></body>
  </worldbody>
  <equality><weld name="grip" body1="arm" body2="tray" relpose="0.4 0.1 0 0 0.6 0 0.8"/></equality>
  <actuator><position joint="arm" kp="200" kv="5"/></actuator>
</mujoco>"""


def test_what_a_finding_names_is_written_although_another_pose_would_close_it(tmp_path):
    """The tray is free, and a start in which it hangs as the crooked relpose has it opens a little less."""
    fix, checked, model = fixed(tmp_path, CARRIED)
    assert "S7" in {one.code for one in checked.verdict}
    (said,) = relposes(fix)
    assert said.endswith("(S7)")
    np.testing.assert_allclose(model.eq_data[0, 3:10], [0.4, 0.1, 0, *TURN], atol=1e-12)
    assert opened(model) < 1e-12
    assert "S7" in fix.mended
    assert not [one for one in fix.changes if "keyframe" in one.what]


CARTON = """<mujoco><option timestep="0.002" gravity="0 0 0"/><default><geom contype="0" conaffinity="0"/></default>
  <worldbody><body name="hand" pos="0 0 0"><joint name="y" type="slide" axis="0 1 0" damping="5"/>
    <geom type="box" size="0.02 0.05 0.05" mass="1"/></body>
  <body name="box" pos="0 0.6 0"><freejoint name="box"/><geom type="box" size="0.1 0.1 0.1" mass="2"/></body>
  </worldbody><actuator><position name="y" joint="y" kp="100" kv="20"/></actuator>
  <equality><weld name="grasp" body1="hand" body2="box" {relpose}/></equality>
  <keyframe><key name="hold" qpos="0.45 0 0.6 0 1 0 0 0" ctrl="0.45"/></keyframe></mujoco>"""


def test_a_keyframe_far_from_the_drawing_is_what_a_weld_is_to_hold(tmp_path):
    text = CARTON.format(relpose="")
    fix, checked, model = fixed(tmp_path, text)
    (one,) = [one for one in checked.verdict if one.code == "S1"]
    assert 'relpose="0 0.15 0 1 0 0 0" holds it as it starts' in checked.answer
    assert "closed start" not in checked.answer
    assert one.figures["relpose"] == "0 0.15 0 1 0 0 0"
    assert "T1" not in {each.code for each in checked.verdict}  # it was tried from another start
    told = mujoco.MjModel.from_xml_string(CARTON.format(relpose='relpose="0 0.15 0 1 0 0 0"'))
    assert opened(mujoco.MjModel.from_xml_string(text), 0) > 0.4
    assert opened(told, 0) < 1e-9
    assert opened(model, 0) < 1e-9
    assert "S1" in fix.mended
    assert np.allclose(model.key_qpos[0], mujoco.MjModel.from_xml_string(text).key_qpos[0])
