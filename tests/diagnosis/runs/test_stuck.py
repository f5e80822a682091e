"""Servos that something holds short of where they are told to be, beside plain MuJoCo with and without it."""

import mujoco
import oarlock
import pytest
from oarlock.diagnosis.beginning import begin
from oarlock.diagnosis.examination import examine
from oarlock.diagnosis.fix.fix import fix_model
from oarlock.diagnosis.options import CheckOptions
from oarlock.diagnosis.verdict.verdicts import judge
from tolerances import SAME_RUN

SLED = """<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <body name="frame">
      <geom type="box" size=".01 .01 .01" pos="0 0 -.2"/>
      <body name="left">
        <joint name="left" type="slide" axis="1 0 0" damping="5"/>
        <geom name="left_tail" type="box" size=".02 .01 .01" mass=".2"/>
      </body>
      <body name="right" pos="{apart} 0 0">
        <joint name="right" type="slide" axis="-1 0 0" damping="5"/>
        <geom name="right_tail" type="box" size=".02 .01 .01" mass=".2"/>
      </body>
    </body>
  </worldbody>
  <equality>
    <joint name="mirror" joint1="right" joint2="left" solref="0.002 0.5" solimp="0.9999 0.9999 0.001"/>
  </equality>
  <actuator><position name="drive" joint="left" kp="2000" kv="20" forcerange="-15 15"/></actuator>
  <keyframe><key name="home" ctrl="0.05"/></keyframe>
</mujoco>"""
"""Two sleds that a coupling moves against each other; 0.04 apart they touch."""

CRANKS = """<mujoco>
  <compiler {angle} autolimits="true"/>
  <option timestep="0.001" integrator="implicitfast" gravity="0 0 -9.81"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="a">
      <joint name="a" axis="0 1 0" {range} damping="0.02"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size=".01" mass="{mass}"/>
    </body>
    <body name="b" pos="0 .1 0">
      <joint name="b" axis="0 1 0" {range} damping="0.02"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.1" size=".01" mass="0.2"/>
    </body>
  </worldbody>
  <equality><joint name="belt" joint1="b" joint2="a" solref="0.002 0.5" solimp="0.9999 0.9999 0.001"/></equality>
  <actuator><position name="motor" joint="a" kp="20" kv=".5" forcerange="-1 1"/></actuator>
  <keyframe><key name="home" ctrl="{told}"/></keyframe>
</mujoco>"""


def reached(text: str, joint: str) -> float:
    """Where a joint ends in two seconds of plain MuJoCo from the first keyframe, rad or m."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(round(2.0 / model.opt.timestep) - 1):
        mujoco.mj_step(model, data)
    return float(data.joint(joint).qpos[0])


def stuck(tmp_path, text: str, **asked):
    """The finding of servos that are held, and the whole check."""
    file = tmp_path / "model.xml"
    file.write_text(text)
    checked = oarlock.check(file, budget=0, **asked)
    return next((one for one in checked.verdict if one.code == "A6"), None), checked


def excluded(text: str) -> str:
    return text.replace("<equality>", '<contact><exclude body1="left" body2="right"/></contact><equality>')


def test_bodies_that_overlap_at_the_start_and_hold_a_servo_come_first(tmp_path):
    text = SLED.format(apart=0.0396)
    one, checked = stuck(tmp_path, text)
    assert one is checked.verdict[0]
    assert (one.severity, one.element, one.figures["exclude"]) == ("error", "drive", [["left", "right"]])
    assert one.figures["reached"] == pytest.approx(reached(text, "left"), rel=SAME_RUN)
    assert one.figures["without"] == pytest.approx(reached(excluded(text), "left"), rel=SAME_RUN)
    assert abs(one.figures["without"] - 0.05) < 0.1 * one.figures["short"]
    assert one.figures["full"]
    assert "geom 'left_tail' and geom 'right_tail'" in checked.answer
    assert '<exclude body1="left" body2="right"/>' in checked.answer


def test_a_fix_excludes_what_holds_a_servo(tmp_path):
    file = tmp_path / "model.xml"
    file.write_text(SLED.format(apart=0.0396))
    exam = begin(str(file), CheckOptions(budget=0))
    for _ in examine(exam):
        pass
    fixed = fix_model(exam, judge(exam), tmp_path / "fixed.xml")
    assert "A6" in fixed.mended
    assert any("whose contact holds 'drive'" in change.what for change in fixed.changes)
    assert reached((tmp_path / "fixed.xml").read_text(), "left") == pytest.approx(0.05, rel=1e-2)  # a kp is soft


def test_bodies_that_meet_only_later_are_a_warning(tmp_path):
    one, _ = stuck(tmp_path, SLED.format(apart=0.06))
    assert (one.severity, one.figures["exclude"]) == ("warning", [])
    assert one.figures["by"] == ["contact between geom 'left_tail' and geom 'right_tail'"]


@pytest.mark.parametrize("held", ["free", "world"])
def test_a_servo_that_presses_against_another_object_is_no_more_than_a_note(tmp_path, held):
    joint = '<freejoint name="box"/>' if held == "free" else ""
    box = f'<body pos=".1 0 0">{joint}<geom name="box" type="box" size=".06 .01 .01" mass=".1"/></body>'
    text = SLED.format(apart=0.2).replace("</worldbody>", f"{box}</worldbody>")
    text = text.replace("<option ", '<option gravity="0 0 0" ')
    one, checked = stuck(tmp_path, text)
    assert one.severity == "note"
    assert "box" in one.line
    assert "A6" not in {found.code for found in checked.verdict if found.severity != "note"}


def test_the_end_of_its_own_range_is_no_more_than_a_note(tmp_path):
    text = SLED.format(apart=0.3).replace('name="left" type="slide"', 'name="left" type="slide" range="0 0.01"')
    one, _ = stuck(tmp_path, text)
    assert (one.severity, one.figures["by"]) == ("note", ["limit of joint 'left'"])


def test_the_range_of_what_follows_holds_what_leads(tmp_path):
    text = SLED.format(apart=0.3).replace('name="right" type="slide"', 'name="right" type="slide" range="0 0.01"')
    one, checked = stuck(tmp_path, text)
    assert (one.severity, one.figures["by"]) == ("warning", ["limit of joint 'right'"])
    assert one.figures["reached"] == pytest.approx(reached(text, "left"), rel=SAME_RUN)
    assert checked.answer.startswith("'drive' is told 0.05 m")


@pytest.mark.parametrize("wide", ["-1.5 1.5", "-0.8 1.2"])
def test_ranges_in_radians_that_are_taken_for_degrees(tmp_path, wide):
    text = CRANKS.format(angle="", range=f'range="{wide}"', mass=0.2, told=-0.6)
    one, checked = stuck(tmp_path, text)
    meant = text.replace("<compiler ", '<compiler angle="radian" ')
    assert one is checked.verdict[0]
    assert one.severity == "error"
    assert one.figures["radians"] == pytest.approx(reached(meant, "a"), rel=SAME_RUN)
    assert 'angle="radian"' in checked.answer


def test_small_ranges_of_a_file_in_radians_are_what_they_are(tmp_path):
    text = CRANKS.format(angle='angle="radian"', range='range="-0.02 0.02"', mass=0.2, told=-0.6)
    one, _ = stuck(tmp_path, text)
    assert (one.severity, one.figures["radians"]) == ("note", None)


def test_a_load_that_a_servo_cannot_lift(tmp_path):
    """2 kg at 0.1 m against 1 N m."""
    text = CRANKS.format(angle="", range="", mass=2.0, told=-0.6)
    text = text.replace('name="a" axis="0 1 0"', 'name="a" axis="0 1 0" range="-90 5"')
    one, _ = stuck(tmp_path, text)
    assert (one.severity, one.figures["by"]) == ("warning", [])
    strong = text.replace('forcerange="-1 1"', "")
    assert one.figures["needed"] == pytest.approx(20.0 * (-0.6 - reached(strong, "a")), rel=1e-3)


@pytest.mark.parametrize("law", ["0.05 * sin(3 * t)", "0.02 * t"])
def test_a_command_that_moves_is_not_waited_for(tmp_path, law):
    one, _ = stuck(tmp_path, SLED.format(apart=0.0396), control={"drive": law})
    assert one is None


def test_what_arrives_is_not_stuck(tmp_path):
    one, _ = stuck(tmp_path, SLED.format(apart=0.3))
    assert one is None
