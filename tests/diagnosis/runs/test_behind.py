"""What is behind a drift or a run that diverges: found by runs without it, and so in plain MuJoCo."""

import mujoco
import numpy as np
import oarlock
import pytest

BARS = """<mujoco><compiler angle="radian"/><option timestep="{h}" integrator="implicitfast"/>
  <default><geom type="capsule" size="0.01" contype="0" conaffinity="0" density="1000"/>
    <joint axis="0 1 0" damping="0.05"/></default><worldbody>
  <body name="crank" pos="0 0 0.5"><joint name="crank"/><geom fromto="0 0 0 0 0 0.12"/>
    <body name="rod" pos="0 0 0.12"><joint name="rod" {rod}/><geom fromto="0 0 0 0.25 0 0"/></body></body>
  <body name="rocker" pos="0.25 0 0.5"><joint name="rocker" {rocker}/><geom fromto="0 0 0 0 0 0.12"/>
    <geom type="sphere" size="0.03" pos="0 0 0.12" mass="1"/></body></worldbody>
  <equality><connect name="pin" body1="rod" body2="rocker" anchor="0.25 0 0" {pin}/></equality>
  <actuator>{drive}</actuator><keyframe><key name="k" ctrl="{ctrl}"/></keyframe></mujoco>"""

SERVO = '<position name="servo" joint="crank" kp="40" kv="1"/>'

WELD = """<mujoco><option timestep="0.002"/><default><geom contype="0" conaffinity="0"/></default><worldbody>
  <body name="arm" pos="0 0 1"><joint name="arm" axis="0 1 0" damping="0.5"/>
    <geom type="box" size="0.15 0.02 0.02" pos="0.15 0 0" mass="1"/></body>
  <body name="tool" pos="0.3 0 1"><freejoint/>
    <geom type="box" size="0.2 0.01 0.01" pos="0.2 0 0" mass="2"/></body></worldbody>
  <equality><weld name="mount" body1="arm" body2="tool" torquescale="{scale}"/></equality>
  <actuator><position name="hold" joint="arm" kp="2000" kv="60"/></actuator>
  <keyframe><key name="k" ctrl="0"/></keyframe></mujoco>"""


def bars(h=0.002, rod="", rocker="", pin="", drive=SERVO, ctrl="0.4") -> str:
    return BARS.format(h=h, rod=rod, rocker=rocker, pin=pin, drive=drive, ctrl=ctrl)


def checked(text: str, tmp_path):
    file = tmp_path / "m.xml"
    file.write_text(text)
    return oarlock.check(file, budget=0)


def gap(text: str, last: bool = False, seconds: float = 2.0) -> float:
    """The largest deviation of a row in plain MuJoCo, or that at the end."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    found = []
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        found.append(float(np.abs(data.efc_pos[: data.ne]).max()))
    return found[-1] if last else max(found)


@pytest.mark.parametrize(
    ("given", "without", "said"),
    [
        ({"pin": 'solref="-800 -40"'}, {}, 'solref="-800 -40"'),
        ({"pin": 'solimp="0.1 0.3 0.01"'}, {}, 'solimp="0.1 0.3 0.01"'),
        ({"h": 0.005, "pin": 'solref="0.002 1"'}, {"h": 0.001, "pin": 'solref="0.002 1"'}, "which is taken as 0.01"),
        ({"rod": 'range="-0.15 0.15" limited="true"'}, {}, "range of joint 'rod'"),
    ],
)
def test_what_the_answer_names_opens_the_loop(given, without, said, tmp_path):
    exam = checked(bars(**given), tmp_path)
    assert said in exam.answer
    assert exam.examination.behind.share > 0.5
    last = exam.examination.behind.lasting is not None
    assert gap(bars(**without), last) < 0.6 * gap(bars(**given), last)


def test_a_small_torquescale_is_named_with_one_that_holds(tmp_path):
    exam = checked(WELD.format(scale="0.02"), tmp_path)
    assert 'torquescale="0.02"' in exam.answer
    tried = exam.examination.behind.suspect.tried.removeprefix('with torquescale="').removesuffix('"')
    left = exam.examination.behind.left
    assert left.radians < 0.5 * max(one.radians or 0.0 for one in exam.examination.drifts if one.level == "position")
    assert float(tried) >= 1.0


def test_a_motor_that_blows_a_run_up_is_named_with_a_part_of_it_that_does_not(tmp_path):
    motor = '<motor name="motor" joint="crank" gear="{gear}"/>'
    strong = bars(drive=motor.format(gear=4000.0), ctrl="1")
    exam = checked(strong, tmp_path)
    behind = exam.examination.behind
    assert exam.examination.recording.end.how == "diverged"
    assert behind.suspect.name == "motor"
    assert "actuator 'motor' gives 4e+03 N" in exam.answer
    if behind.factor:
        assert np.isfinite(gap(bars(drive=motor.format(gear=4000.0 * behind.factor), ctrl="1")))


def test_weight_is_named_where_nothing_else_is(tmp_path):
    exam = checked(bars(ctrl="0", rocker='stiffness="0"'), tmp_path)
    behind = exam.examination.behind
    assert behind is None or behind.suspect is None


FEATHER = """<mujoco><compiler angle="radian" boundmass="1e-6" boundinertia="1e-9"/><option timestep="0.002"/>
  <default><geom contype="0" conaffinity="0"/><joint axis="1 0 0"/></default><worldbody>
  <body name="beam" pos="0 0 0.5"><joint name="beam" damping="0.1"/>
    <geom type="capsule" fromto="0 0 0 0 0.3 0" size="0.02" mass="1.5"/></body>
  <body name="stay"><joint name="stay" damping="0.08"{armature}/>
    <inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia}"/></body></worldbody>
  <equality><connect name="eye" body1="stay" body2="beam" anchor="0 0.3 0.5" solref="0.004 1"/></equality>
  <actuator><position joint="beam" kp="200" kv="8"/></actuator>
  <keyframe><key name="k" ctrl="0.2"/></keyframe></mujoco>"""


def feather(armature: str = "", mass: str = "1e-6", inertia: str = "1e-9 1e-9 1e-9") -> str:
    text = f"{FEATHER}".replace(
        '<body name="stay">',
        '<body name="slot"><joint type="slide" axis="0 0.3 0.5"/><geom size="0.01" mass="0.1"/><body name="stay">',
    ).replace("</body></worldbody>", "</body></body></worldbody>")
    return text.format(armature=armature, mass=mass, inertia=inertia)


def test_a_damper_on_a_body_without_inertia_is_told_with_the_armature_that_makes_it_hold(tmp_path):
    given = checked(feather(), tmp_path)
    one = given.examination.behind
    assert one is not None
    assert (one.suspect.sort, one.suspect.name) == ("damper", "stay")
    assert one.armature is not None
    value, left = one.armature
    assert f'armature="{value:g}" on that joint' in given.answer
    assert "a mass of its body 'stay', which has 1e-06 kg" in given.answer
    mended = gap(feather(f' armature="{value:g}"'))
    assert mended < 0.15 * gap(feather())
    assert left.largest < 0.15 * gap(feather())


def test_a_rank_that_only_inertias_make_small_is_a_note(tmp_path):
    (one,) = [one for one in checked(feather(), tmp_path).verdict if one.code == "L8"]
    assert one.severity == "note"
    assert "by its inertias alone" in one.line
    assert "L8" not in {one.code for one in checked(feather(mass="0.2", inertia="1e-3 1e-3 1e-3"), tmp_path).verdict}
