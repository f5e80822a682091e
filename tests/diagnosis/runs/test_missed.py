"""Servos that do not come to where they are told, beside plain MuJoCo with what is named."""

import mujoco
import oarlock
import pytest

BARS = """<mujoco><compiler angle="radian"/><option timestep="0.001" integrator="implicitfast"/>
  <default><geom type="capsule" size="0.008" contype="0" conaffinity="0" density="900"/>
    <joint axis="0 1 0" damping="0.03"/></default><worldbody>
  <body name="crank" pos="0 0 0.5"><joint name="crank"/><geom fromto="0 0 0 0.1 0 0"/>
    <body name="rod" pos="0.1 0 0"><joint name="rod" {rod}/><geom fromto="0 0 0 0 0 -0.3"/></body></body>
  <body name="rocker" pos="0 0 0.2"><joint name="rocker" {rocker}/><geom fromto="0 0 0 0.1 0 0"/>
    <geom type="sphere" size="0.04" pos="0.2 0 0" mass="{load}"/></body></worldbody>
  <equality><connect name="pin" body1="rod" body2="rocker" anchor="0 0 -0.3" solref="0.004 1"/></equality>
  <actuator><position name="servo" joint="crank" kp="{kp}" kv="{kv}" {given}/></actuator>
  <keyframe><key name="k" ctrl="{told}"/></keyframe></mujoco>"""


def bars(rod="", rocker="", load=0.05, kp=10.0, kv=0.5, told=0.4, given="") -> str:
    return BARS.format(rod=rod, rocker=rocker, load=load, kp=kp, kv=kv, told=told, given=given)


def ends(text: str) -> float:
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(2000):
        mujoco.mj_step(model, data)
    return float(data.qpos[0])


def of(code: str, text: str, tmp_path):
    file = tmp_path / "bars.xml"
    file.write_text(text)
    checked = oarlock.check(file, budget=0)
    return next((one for one in checked.verdict if one.code == code), None), checked.answer


@pytest.mark.parametrize(
    ("held", "by"),
    [
        ({"load": 3.0, "told": 0.0}, "weight"),
        ({"rocker": 'stiffness="25"'}, "spring of joint 'rocker'"),
        ({"rod": 'damping="30"'}, "damping of joint 'rod'"),
    ],
)
def test_what_holds_a_servo_is_named_and_a_stronger_one_arrives(held, by, tmp_path):
    one, answer = of("A9", bars(**held), tmp_path)
    assert one.element == "servo"
    assert by in answer
    assert one.figures["reached"] == pytest.approx(ends(bars(**held)), abs=0.05)
    kp, told = one.figures["kp"], one.figures["told"]
    if kp is not None:
        there = ends(bars(**held | {"kp": kp, "kv": 0.5 * (kp / 10.0) ** 0.5}))
        assert abs(told - there) < 0.3 * one.figures["short"]


def test_who_arrives_is_not_named(tmp_path):
    assert of("A9", bars(), tmp_path)[0] is None


def test_a_control_beyond_its_range_is_named_with_a_range_that_admits_it(tmp_path):
    one, answer = of("A10", bars(given='ctrlrange="-0.1 0.1"'), tmp_path)
    assert (one.element, one.figures["asked"], one.figures["used"]) == ("servo", 0.4, 0.1)
    assert 'ctrlrange="-0.1 0.4"' in answer
    assert abs(ends(bars(given='ctrlrange="-0.1 0.4"')) - 0.4) < 0.05
    assert abs(ends(bars(given='ctrlrange="-0.1 0.1"')) - 0.1) < 0.05


def test_a_control_within_its_range_is_not_named(tmp_path):
    assert of("A10", bars(given='ctrlrange="-0.5 0.5"'), tmp_path)[0] is None


# A range of the joint that cuts what drives it, and what all joints have.


def cut(bound: float | None, drive: str = "") -> str:
    text = bars(load=1.0, kp=100.0, kv=5.0, told=0.0)
    if bound is not None:
        text = text.replace('name="crank"/>', f'name="crank" actuatorfrcrange="{-bound:g} {bound:g}"/>')
    return text.replace('<position name="servo" joint="crank" kp="100.0" kv="5.0" />', drive) if drive else text


def test_a_range_of_a_joint_that_cuts_its_servo_is_named_though_the_servo_gives_all(tmp_path):
    one, answer = of("A9", cut(0.3), tmp_path)
    assert one.element == "servo"
    assert one.figures["given"] == pytest.approx(-0.3)
    assert 'actuatorfrcrange="-0.3 0.3"' in answer
    assert answer.startswith("'servo': asks for ")
    assert abs(ends(cut(0.3))) > 0.3
    assert abs(ends(cut(None))) < 0.1
    assert one.figures["without"] < 0.1


def test_the_same_of_a_motor(tmp_path):
    motor = '<motor name="servo" joint="crank" gear="4"/>'
    text = cut(0.2, motor).replace('ctrl="0.0"', 'ctrl="-0.5"')
    one, answer = of("A9", text, tmp_path)
    assert (one.figures["asked"], one.figures["given"]) == pytest.approx((-2.0, -0.2))
    assert "gets up to" in answer


def test_a_range_of_a_joint_that_suffices_is_not_named(tmp_path):
    assert of("A9", cut(5.0), tmp_path)[0] is None


def every(damping: float, armature: float) -> str:
    return bars(told=0.4).replace('damping="0.03"', f'damping="{damping:g}" armature="{armature:g}"')


def test_what_all_joints_have_from_their_class_is_named_together(tmp_path):
    one, answer = of("A9", every(8.0, 1.0), tmp_path)
    assert one.element == "servo"
    assert "joints of its loops have together, damping (8 each)" in answer
    assert abs(ends(every(8.0, 1.0)) - 0.4) > 0.15
    assert ends(every(0.08, 0.01)) == pytest.approx(one.figures["without"], abs=0.05)
