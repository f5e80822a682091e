"""Numbers that are legal and not what was meant: whole lengths, no controls, swapped joints, inertias, relposes."""

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from diagnosis.verdict.test_verdicts import examined
from oarlock.diagnosis.verdict.answer import answer
from oarlock.diagnosis.verdict.verdicts import judge
from seen import of_text, only, runs
from tolerances import CLOSED


def at_start(text: str, key: int | None = None) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Plain MuJoCo after mj_forward."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, key)
    mujoco.mj_forward(model, data)
    return model, data


def written(figure: list[float]) -> str:
    return " ".join(map(repr, figure))


# Whole lengths.

BEAD = """<mujoco><worldbody><site name="hook"/>
  <body name="bead" pos="0 0 -0.4"><joint name="bead" type="slide" axis="0 0 1" {ref}/><geom size="0.02"/>
    <site name="eye"/></body>
  <body name="twin" pos="1 0 -0.7"><joint name="twin" type="slide" axis="0 0 1"/><geom size="0.02"/><site name="ear"/>
  </body></worldbody>
  <tendon><spatial name="rope"><site site="hook"/><site site="eye"/></spatial>
    <fixed name="other"><joint joint="twin" coef="1"/></fixed></tendon>
  <equality>{equality}</equality>
  <keyframe><key name="low" qpos="{low} 0"/></keyframe></mujoco>"""
ROPE = '<tendon name="rope" tendon1="rope" polycoef="{} 0 0 0 0"/>'


@pytest.mark.parametrize(
    ("constant", "low", "found"),
    [("0.4", "0", True), ("0.55", "-0.15", True), ("0", "0", False), ("0.15", "-0.15", False), ("0.25", "0", False)],
)
def test_a_constant_that_is_the_whole_length_of_a_tendon(constant, low, found):
    text = BEAD.format(equality=ROPE.format(constant), low=low, ref="")
    remarks = [one for one in of_text(text, 0) if one.code == "A2"]
    assert [one.element for one in remarks] == (["rope"] if found else [])
    if found:
        mended = text.replace(f"{constant} 0 0 0 0", written(remarks[0].figures["wanted"]))
        assert abs(at_start(text, 0)[1].efc_pos[0]) > 0.1
        assert abs(at_start(mended, 0)[1].efc_pos[0]) <= CLOSED


def test_of_a_coupling_of_joints_the_polynomial_is_moved_to_where_mujoco_counts_from():
    """bead = 0.3 + 0.5 twin − twin², in whole coordinates, with ref on the bead alone."""
    equality = '<joint name="law" joint1="bead" joint2="twin" polycoef="0.3 0.5 -1 0 0"/>'
    text = BEAD.format(equality=equality, low="0.3", ref='ref="0.3"')
    one = only(of_text(text, 0), "A2")
    mended = text.replace("0.3 0.5 -1 0 0", written(one.figures["wanted"]))
    for twin in (0.0, 0.1, 0.4):
        model = mujoco.MjModel.from_xml_string(mended)
        data = mujoco.MjData(model)
        data.qpos[:] = 0.3 + 0.5 * twin - twin * twin, twin
        mujoco.mj_forward(model, data)
        assert abs(data.efc_pos[0]) <= CLOSED


# Keyframes without controls.

RODS = """<mujoco><compiler angle="radian"/><option timestep="0.001"/>
  <default><geom contype="0" conaffinity="0"/></default><worldbody>
  <body name="a"><joint name="a" axis="0 1 0" damping="0.01"/><geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.01"/>
    <body name="b" pos="0 0 0.2"><joint name="b" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.01"/></body></body>
  <body name="c" pos="0.3 0 0"><joint name="c" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.01"/></body></worldbody>
  <equality><connect name="pin" body1="b" body2="c" anchor="0.3 0 0"/></equality>
  <actuator>{motor}<motor name="idle" joint="c"/></actuator>
  <keyframe><key name="lean" qpos="0.5 -0.5 0.5" {ctrl}/></keyframe></mujoco>"""
SERVO = '<position name="drive" joint="a" kp="200" kv="2" gear="{gear}"/>'


@pytest.mark.parametrize("gear", [1.0, -3.0])
def test_a_keyframe_without_controls_and_those_that_hold_it(gear):
    text = RODS.format(motor=SERVO.format(gear=gear), ctrl="")
    one = only(of_text(text, 0), "A3")
    assert (one.element, one.figures["loops"], one.severity) == ("lean", ["pin"], None)
    assert one.figures["jump"] == pytest.approx(0.5)
    ctrl = f'ctrl="{written(one.figures["wanted"])}"'
    assert abs(at_start(text, 0)[1].actuator_force[0]) > 10.0
    mended = RODS.format(motor=SERVO.format(gear=gear), ctrl=ctrl)
    assert abs(at_start(mended, 0)[1].actuator_force[0]) <= CLOSED * 200.0
    assert "A3" not in {each.code for each in of_text(mended, 0)}


@pytest.mark.parametrize(
    ("motor", "ctrl"),
    [
        ('<motor name="drive" joint="a"/>', ""),
        ('<velocity name="drive" joint="a" kv="1"/>', ""),
        (SERVO.format(gear=1), 'ctrl="-0.2 0"'),
        (SERVO.format(gear=1).replace("gear=", 'ctrlrange="0.4 1" gear='), ""),
        ('<position name="drive" joint="a" kp="200" timeconst="0.2"/>', ""),
    ],
)
def test_no_jump(motor, ctrl):
    assert "A3" not in {one.code for one in of_text(RODS.format(motor=motor, ctrl=ctrl), 0)}


def test_a_jump_is_the_answer_of_a_check(tmp_path):
    file = tmp_path / "jump.xml"
    file.write_text(RODS.format(motor=SERVO.format(gear=1), ctrl=""))
    exam = examined(file)
    findings = judge(exam)
    assert findings[0].code == "A3"
    assert "gives no ctrl" in answer(exam, findings)


# Controls in degrees.


def test_a_control_in_degrees_leads_what_comes_of_it(tmp_path):
    servo = SERVO.format(gear=1).replace('kp="200" kv="2"', 'kp="0.5" kv="0.05"')
    file = tmp_path / "degrees.xml"
    text = RODS.format(motor=servo, ctrl='ctrl="40 0"').replace('qpos="0.5 -0.5 0.5"', "")
    rocker = text[text.index('<body name="c"') : text.index("</worldbody>")]
    longer = rocker.replace("0.3 0 0", "0.3 0 -0.1").replace("0 0 0 0 0 0.2", "0 0 0 0 0 0.3")
    file.write_text(text.replace(rocker, longer).replace('damping="0.01"', 'damping="0.1"'))
    findings = judge(examined(file))
    assert (findings[0].code, findings[0].element) == ("A2", "drive")
    assert findings[0].figures["loops"] == ["pin"]
    assert f"40° are {math.radians(40):.6g}" in findings[0].line
    motion = next(one for one in findings if one.code == "D8")
    assert findings[0].cost == motion.cost > 0.0


@pytest.mark.parametrize("ctrl", ["0.698 0", "12.566371 0", "0 40"])
def test_controls_that_are_no_degrees(ctrl):
    text = RODS.format(motor=SERVO.format(gear=1), ctrl=f'ctrl="{ctrl}"')
    assert "A2" not in {one.code for one in of_text(text, 0)}


# Controls in another unit.

JAWS = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.001"/>
  <default><geom contype="0" conaffinity="0" mass="0.05"/><joint damping="4"/></default><worldbody>
  <body name="a"><joint name="a" type="{kind}" axis="0 1 0" range="-0.01 {end}"/>
    <geom size="0.01" pos="0.05 0 0"/></body>
  <body name="b" pos="0 0.2 0"><joint name="b" type="{kind}" axis="0 -1 0" range="-0.01 {end}"/>
    <geom size="0.01" pos="0.05 0 0"/></body></worldbody>
  <tendon><fixed name="both"><joint joint="a" coef="0.5"/><joint joint="b" coef="0.5"/></fixed></tendon>
  <equality><joint name="same" joint1="b" joint2="a"/></equality>
  <actuator>{servo}</actuator><keyframe><key name="shut" ctrl="{ctrl}"/></keyframe></mujoco>"""
ON_JOINT = '<position name="grip" joint="a" kp="150" {}/>'
ON_TENDON = '<position name="grip" tendon="both" kp="150" {}/>'


def jaws(servo: str, ctrl: float, kind: str = "slide", end: float = 0.04) -> str:
    return JAWS.format(servo=servo, ctrl=repr(ctrl), kind=kind, end=end)


@pytest.mark.parametrize("actuator", [ON_JOINT, ON_TENDON])
@pytest.mark.parametrize(
    ("limits", "ctrl", "said"),
    [
        ('ctrlrange="0 255"', 255.0, "another unit was meant? 0.04 leads it to its end; for its ctrlrange 0 255"),
        ('ctrlrange="0 100"', 80.0, "another unit was meant? 0.04"),
        ("", 30.0, "millimetres were meant? 30 mm are 0.03"),
    ],
)
def test_a_control_that_leads_far_beyond_the_range(actuator, limits, ctrl, said):
    """With the control that is named plain MuJoCo keeps the joints in their ranges; with the given one it does not."""
    text = jaws(actuator.format(limits), ctrl)
    one = only(of_text(text, 0), "A2")
    assert said in one.line
    assert (one.element, one.severity, one.figures["loops"]) == ("grip", "error", ["same"])
    assert furthest(text) > 0.4  # ten times its range
    assert furthest(jaws(actuator.format(limits), one.figures["wanted"])) < 0.045


def furthest(text: str) -> float:
    return max(float(np.abs(data.qpos).max()) for _, data in runs(text, 0.5))


def test_the_gain_that_is_named_makes_its_ctrlrange_the_range():
    one = only(of_text(jaws(ON_JOINT.format('ctrlrange="0 255"'), 255.0), 0), "A2")
    gain = float(one.line.rpartition("gainprm ")[2].split()[0])
    servo = f'<general name="grip" joint="a" ctrlrange="0 255" gainprm="{gain}" biastype="affine" biasprm="0 -150 0"/>'
    text = jaws(servo, 255.0)
    assert "A2" not in {one.code for one in of_text(text, 0)}
    *_, (_, data) = runs(text, 1.0)
    assert data.qpos[0] == pytest.approx(0.04, abs=1e-3)


@pytest.mark.parametrize(
    ("limits", "ctrl", "kind", "end"),
    [
        ("", 0.2, "slide", 0.04),  # presses
        ('forcerange="-40 40"', 255.0, "slide", 0.04),
        ('ctrlrange="0 0.04"', 255.0, "slide", 0.04),  # which MuJoCo clamps
        ("", 2.0, "hinge", 0.8),
    ],
)
def test_controls_that_are_in_no_other_unit(limits, ctrl, kind, end):
    assert "A2" not in {one.code for one in of_text(jaws(ON_JOINT.format(limits), ctrl, kind, end), 0)}


def test_counts_for_a_hinge_are_the_answer_and_no_wider_range_is(tmp_path):
    path = tmp_path / "counts.xml"
    path.write_text(jaws(ON_JOINT.format('ctrlrange="0 255"'), 255.0, "hinge", 0.8))
    exam = examined(path)
    findings = judge(exam)
    assert findings[0].code == "A2"
    assert "C5" not in {one.code for one in findings}
    assert answer(exam, findings).startswith("'grip': ctrl 255 leads joint 'a' to 255 rad")


# Swapped joints.

SCREW = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="nut"><joint name="nut" type="slide" axis="1 0 0" range="0 {stroke}"/><geom size="0.02"/></body>
  <body name="screw" pos="0 1 0"><joint name="screw" axis="1 0 0" range="0 {turns}"/><geom size="0.02"/></body>
  </worldbody><equality><joint name="thread" {order} polycoef="0 {ratio} 0 0 0"/></equality></mujoco>"""
ORDER, OTHER = 'joint1="nut" joint2="screw"', 'joint1="screw" joint2="nut"'


@pytest.mark.parametrize(
    ("order", "ratio", "stroke", "turns", "found"),
    [
        (OTHER, "0.01", "0.2", "20", True),
        (OTHER, "-0.01", "0.2", "30", True),
        (ORDER, "100", "0.2", "20", True),
        (ORDER, "0.01", "0.2", "20", False),
        (OTHER, "100", "0.2", "20", False),
        (OTHER, "0.01", "2", "20", False),  # fits neither way
        (OTHER, "1.5", "1", "2", False),
    ],
)
def test_joints_that_are_swapped(order, ratio, stroke, turns, found):
    text = SCREW.format(order=order, ratio=ratio, stroke=stroke, turns=turns)
    remarks = [one for one in of_text(text) if one.code == "L13"]
    assert [one.element for one in remarks] == (["thread"] if found else [])
    if found:
        names = ("nut", "screw") if order == OTHER else ("screw", "nut")
        assert f'joint1="{names[0]}" joint2="{names[1]}"' in remarks[0].line
        swapped = ORDER if order == OTHER else OTHER
        assert "L13" not in {one.code for one in of_text(text.replace(order, swapped))}


# Inertias.

PLATE = """<mujoco><worldbody><body name="plate"><joint name="plate" axis="0 1 0"/>
  <inertial pos="0.1 0 0" mass="0.4" {inertia}/><geom type="box" pos="0.1 0 0" size="0.1 0.05 0.01"/></body>
  </worldbody></mujoco>"""
SOUND = np.array([0.00034, 0.00135, 0.00167])
"""kg m², of that box."""


@pytest.mark.parametrize(("factor", "unit"), [(1e6, "kg mm²"), (1e4, "kg cm²"), (1e9, "another unit"), (10.0, None)])
def test_inertias_in_another_unit(factor, unit):
    text = PLATE.format(inertia=f'diaginertia="{written((factor * SOUND).tolist())}"')
    remarks = [one for one in of_text(text) if one.code == "A2"]
    assert [one.element for one in remarks] == (["plate"] if unit else [])
    if unit:
        assert f"{unit} w" in remarks[0].line
        assert remarks[0].figures["radius"] == pytest.approx(math.sqrt(factor * SOUND.max() / 0.4))


# A relpose that asks for a distance.

HELD = """<mujoco><worldbody>
  <body name="base" pos="0.2 0 0" euler="0 0 90"><joint axis="0 0 1"/><geom size="0.05"/></body>
  <body name="lid" pos="0.2 0 0.3" euler="0 0 90"><joint axis="0 0 1"/><geom size="0.05"/></body></worldbody>
  <equality><weld name="bolt" body1="base" body2="lid" {relpose}/></equality></mujoco>"""


@pytest.mark.parametrize(
    ("relpose", "way"),
    [("0 0.6 0.3 1 0 0 0", "along y"), ("0.4 0.4 0.3 1 0 0 0", ""), ("0 0 0.3 1 0 0 0", None), ("", None)],
)
def test_a_relpose_that_asks_for_a_distance(relpose, way):
    text = HELD.format(relpose=f'relpose="{relpose}"' if relpose else "")
    remarks = [one for one in of_text(text) if one.code == "S7"]
    assert [one.element for one in remarks] == ([] if way is None else ["bolt"])
    gap = float(np.linalg.norm(at_start(text)[1].efc_pos[:3]))
    if way is None:
        assert gap <= CLOSED
        return
    assert remarks[0].figures["opening"] == pytest.approx(gap)
    assert (way or "m between") in remarks[0].line
    mended = HELD.format(relpose=f'relpose="{written(remarks[0].figures["wanted"])} 1 0 0 0"')
    assert float(np.linalg.norm(at_start(mended)[1].efc_pos[:3])) <= CLOSED


def test_a_relpose_that_some_pose_closes_is_how_it_is_pulled_together():
    joints = '<joint axis="0 0 1"/><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><geom'
    text = HELD.format(relpose='relpose="0 0.6 0.3 1 0 0 0"').replace('<joint axis="0 0 1"/><geom', joints)
    assert {"S1"} == {one.code for one in of_text(text)} - {"S3"}


def test_a_relpose_that_no_pose_closes_is_an_error_and_the_answer(tmp_path):
    file = tmp_path / "bolt.xml"
    file.write_text(HELD.format(relpose='relpose="0 0.6 0.3 1 0 0 0"'))
    exam: Any = examined(file)
    findings = judge(exam)
    assert (findings[0].code, findings[0].severity) == ("S7", "error")
    assert answer(exam, findings).startswith("'bolt': relpose asks for 0.6 m along y")
