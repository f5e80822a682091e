"""Loops with more freedom than drives, beside plain MuJoCo with the spring that is named."""

import mujoco
import numpy as np
import oarlock
import pytest

FIVE = """<mujoco><compiler angle="radian"/><option timestep="0.001"/>
  <default><geom type="capsule" size="0.01" contype="0" conaffinity="0" density="1200"/>
    <joint axis="0 1 0" damping="0.01"/></default><worldbody>
  <body name="l1" pos="-0.06 0 0"><joint name="q1"/><geom fromto="0 0 0 -0.08 0 0.12"/>
    <body name="l2" pos="-0.08 0 0.12"><joint name="q2"/><geom fromto="0 0 0 0.14 0 0.15"/></body></body>
  <body name="r1" pos="0.06 0 0"><joint name="q3" {spring}/><geom fromto="0 0 0 0.08 0 0.12"/>
    <body name="r2" pos="0.08 0 0.12"><joint name="q4"/><geom fromto="0 0 0 -0.14 0 0.15"/></body></body></worldbody>
  <equality><connect name="tip" body1="l2" body2="r2" anchor="0.14 0 0.15"/>{more}</equality>
  <actuator><position name="left" joint="q1" kp="20" kv="0.2"/>{second}</actuator>
  <keyframe><key name="home" ctrl="{ctrl}"/></keyframe></mujoco>"""

PASSIVE = """<mujoco><option timestep="0.001"/>
  <default><geom type="capsule" size="0.01" contype="0" conaffinity="0"/><joint axis="0 1 0" damping="0.005"/></default>
  <worldbody>{legs}</worldbody><equality>{pins}</equality>
  <actuator><position name="drive" joint="a_crank" kp="20" kv="0.2"/></actuator>
  <keyframe><key name="k" ctrl="0.2"/></keyframe></mujoco>"""


def five(spring: str = "", more: str = "", second: str = "", ctrl: str = "0") -> str:
    return FIVE.format(spring=spring, more=more, second=second, ctrl=ctrl)


def bars(name: str, x: float) -> str:
    return f"""<body name="{name}crank" pos="{x} 0 0"><joint name="{name}_crank"/>
      <geom fromto="0 0 0 0.05 0 0.1"/>
      <body name="{name}rod" pos="0.05 0 0.1"><joint name="{name}_rod"/><geom fromto="0 0 0 0.1 0 0"/></body></body>
      <body name="{name}rocker" pos="{x + 0.1} 0 0"><joint name="{name}_rocker"/>
      <geom fromto="0 0 0 0.05 0 0.1"/></body>"""


def undriven(text: str, tmp_path):
    file = tmp_path / "m.xml"
    file.write_text(text)
    checked = oarlock.check(file, budget=0)
    return next((one for one in checked.verdict if one.code == "A8"), None), checked.answer


def way(text: str) -> float:
    """How far the tip goes in 2 s of plain MuJoCo."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    start, most = data.xipos.copy(), 0.0
    for _ in range(2000):
        mujoco.mj_step(model, data)
        most = max(most, float(np.linalg.norm(data.xipos - start, axis=1).max()))
    return most


def test_a_five_bar_with_one_motor_falls_and_the_spring_that_is_named_keeps_it(tmp_path):
    one, answer = undriven(five(), tmp_path)
    assert one.element == "tip"
    assert (one.figures["dof"], one.figures["driven"]) == (2, 1)
    assert "drives 1 of them" in answer
    (spring,) = one.figures["springs"]
    assert spring["joint"] == "q3"
    written = f'stiffness="{spring["stiffness"]:g}" damping="{spring["damping"] + 0.01:g}"'
    assert way(five(spring=written)) < 0.5 * way(five())


def test_a_loop_that_is_torn_comes_before_its_freedoms(tmp_path):
    soft = five().replace('name="tip"', 'name="tip" solref="0.5 1"')
    one, answer = undriven(soft, tmp_path)
    assert one is not None
    assert "degrees of freedom" not in answer
    assert answer.startswith("'tip' opens by ")


TRIPOD = """<mujoco><option timestep="0.001"/>
  <default><geom type="capsule" size="0.005" contype="0" conaffinity="0"/></default>
  <worldbody><body name="plate" pos="0 0 -0.2"><freejoint/><geom type="cylinder" size="0.05 0.005"/></body>{arms}
  </worldbody><equality>{pins}</equality><actuator>{motors}</actuator>
  <keyframe><key name="k" ctrl="0.3 0 0"/></keyframe></mujoco>"""


def test_freedoms_of_free_and_ball_joints_are_told_in_a_whole_sentence(tmp_path):
    arms, pins, motors = "", "", ""
    for leg, angle in enumerate((0.0, 2.0944, 4.1888)):
        cos, sin = np.cos(angle), np.sin(angle)
        arms += f"""<body name="arm{leg}" pos="{0.1 * cos} {0.1 * sin} 0">
          <joint name="arm{leg}" axis="{-sin} {cos} 0"/><geom fromto="0 0 0 {0.05 * cos} {0.05 * sin} 0"/>
          <body name="rod{leg}" pos="{0.05 * cos} {0.05 * sin} 0"><joint type="ball"/>
          <geom fromto="0 0 0 {-0.1 * cos} {-0.1 * sin} -0.2"/></body></body>"""
        pins += f'<connect name="pin{leg}" body1="rod{leg}" body2="plate" anchor="{-0.1 * cos} {-0.1 * sin} -0.2"/>'
        motors += f'<position joint="arm{leg}" kp="5" kv="0.1"/>'
    one, _ = undriven(TRIPOD.format(arms=arms, pins=pins, motors=motors), tmp_path)
    assert (one.figures["dof"], one.figures["driven"], one.figures["joints"]) == (9, 3, [])
    assert "the other 6 go their own way, turn 'plate' by " in one.line
    assert one.figures["turning"] == "plate"
    assert one.line.endswith("; drive, or couple, what its ball and free joints leave free")


@pytest.mark.parametrize(
    "given",
    [
        {"second": '<position name="right" joint="q3" kp="20" kv="0.2"/>', "ctrl": "0 0"},
        {"more": '<joint name="mirror" joint1="q3" joint2="q1" polycoef="0 -1 0 0 0"/>'},
        {"spring": 'stiffness="20"'},
    ],
)
def test_what_is_driven_coupled_or_sprung_is_not_named(given, tmp_path):
    assert undriven(five(**given), tmp_path)[0] is None


def test_a_loop_that_nothing_drives_beside_one_that_is_driven(tmp_path):
    legs, pins = bars("a", 0.0) + bars("b", 0.4), ""
    for name in "ab":
        pins += f'<connect name="{name}_pin" body1="{name}rod" body2="{name}rocker" anchor="0.1 0 0"/>'
    one, answer = undriven(PASSIVE.format(legs=legs, pins=pins), tmp_path)
    assert one.element == "b_pin"
    assert one.figures["driven"] == 0
    assert "no actuator drives it" in answer


def test_a_rod_that_turns_about_itself_is_not_named(tmp_path):
    text = five(second='<position name="right" joint="q3" kp="20" kv="0.2"/>', ctrl="0 0")
    spun = text.replace('<joint name="q4"/>', '<joint name="q4"/><joint name="spin" axis="-0.14 0 0.15" damping="0"/>')
    assert undriven(spun, tmp_path)[0] is None


def test_a_pendulum_on_a_string_is_not_named(tmp_path):
    text = """<mujoco><worldbody><site name="hook" pos="0 0 1"/>
      <body name="bob" pos="0.2 0 0.6"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
        <geom size="0.02" mass="1"/><site name="bob"/></body>
      <body name="arm" pos="1 0 1"><joint name="arm" axis="0 1 0"/><geom size="0.02" pos="0.1 0 0" mass="1"/></body>
      </worldbody><tendon><spatial name="s"><site site="hook"/><site site="bob"/></spatial></tendon>
      <equality><tendon name="string" tendon1="s"/></equality>
      <actuator><position joint="arm" kp="100" kv="5"/></actuator></mujoco>"""
    assert undriven(text, tmp_path)[0] is None


def test_a_flex_beside_the_loop_is_left_alone(tmp_path):
    cloth = """<flexcomp name="cloth" type="grid" count="3 3 1" spacing="0.05 0.05 0.05" pos="1 0 1" mass="0.1">
      <edge equality="true"/><contact selfcollide="none" contype="0" conaffinity="0"/></flexcomp>"""
    text = five().replace("</worldbody>", f"{cloth}</worldbody>")
    text = text.replace('<key name="home" ctrl="0"/>', "").replace(' damping="0.01"', "", 1)
    file = tmp_path / "flex.xml"
    file.write_text(text)
    checked = oarlock.check(file, controls="constant", budget=0, duration=1.0)
    assert "A8" in {one.code for one in checked.verdict}


SHARED = """<mujoco><option timestep="0.001"/>
  <default><geom type="capsule" size="0.01" contype="0" conaffinity="0"/>
    <joint axis="0 1 0" damping="{damping}"/></default>
  <worldbody>{legs}</worldbody>
  <tendon><fixed name="belt"><joint joint="a_crank" coef="1"/><joint joint="b_crank" coef="{coef}"/></fixed></tendon>
  <equality>{pins}{more}</equality><actuator><position name="belt" tendon="belt" kp="20" kv="0.5"/></actuator>
  <keyframe><key name="k" ctrl="0"/></keyframe></mujoco>"""


def shared(coef: float, more: str = "") -> str:
    legs, pins = bars("a", 0.0) + bars("b", 0.4), ""
    for name in "ab":
        pins += f'<connect name="{name}_pin" body1="{name}rod" body2="{name}rocker" anchor="0.1 0 0"/>'
    return SHARED.format(damping=0.02, legs=legs, pins=pins, coef=coef, more=more)


def test_loops_on_one_tendon_are_looked_at_together_and_the_coupling_that_is_named_keeps_them(tmp_path):
    one, answer = undriven(shared(-1.0), tmp_path)  # both fall the same way, and their difference is what is driven
    assert (one.figures["dof"], one.figures["driven"]) == (2, 1)
    assert {one.element, *one.figures["also"]} == {"a_pin", "b_pin"}
    (coupling,) = one.figures["couplings"]
    assert coupling in answer
    assert way(shared(-1.0, coupling)) < 0.1 * way(shared(-1.0))
    assert undriven(shared(-1.0, coupling), tmp_path)[0] is None


def test_a_difference_that_nothing_moves_is_not_named(tmp_path):
    text = shared(1.0).replace('name="b_crank"', 'name="b_crank" stiffness="50"')
    text = text.replace('name="a_crank"', 'name="a_crank" stiffness="50"')
    assert undriven(text, tmp_path)[0] is None


def test_what_the_loops_take_of_the_energy_is_a_note_where_they_hold(tmp_path):
    file = tmp_path / "m.xml"
    text = shared(-1.0, '<joint joint1="a_crank" joint2="b_crank" polycoef="0 -1 0 0 0"/>')
    file.write_text(text.replace("<default>", '<default><equality solref="0.002 1" solimp="0.999 0.999 0.001"/>'))
    checked = oarlock.check(file, budget=0)
    assert max(one.largest for one in checked.examination.drifts if one.level == "position") < 1e-4
    assert {one.severity for one in checked.verdict if one.code == "E1"} <= {"note"}
    assert checked.answer.startswith(("The loops hold", "Every loop holds"))
