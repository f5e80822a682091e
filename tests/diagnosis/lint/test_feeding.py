"""Actuators that feed energy in, against growth in runs of plain MuJoCo."""

import math

import mujoco
import pytest
from oarlock.diagnosis.lint.feeding import look
from seen import of_file, of_text, only, runs, view_of

COUPLED = """<mujoco><option timestep="0.0002" gravity="0 0 0"/><worldbody>
  <body name="a"><joint name="one" axis="0 0 1" damping="{own}" stiffness="{spring}"/>
    <inertial pos="0 0 0" mass="1" diaginertia="1 1 0.5"/></body>
  <body name="b" pos="1 0 0"><joint name="two" axis="0 0 1"/>
    <inertial pos="0 0 0" mass="1" diaginertia="1 1 0.25"/></body></worldbody>
  <equality><joint joint1="one" joint2="two" solref="0.001 1" solimp="0.9999 0.9999 0.001"/></equality>
  <tendon><fixed name="cord" damping="{cord}"><joint joint="two" coef="1"/></fixed></tendon>
  <actuator><general name="drive" joint="one" gear="{gear}" biastype="affine" biasprm="0 {k} {c}"/></actuator>
  <keyframe><key qpos="{start} {start}" qvel="{speed} {speed}"/></keyframe></mujoco>"""

GIVEN = {"own": 0.1, "spring": 0, "cord": 0.05, "gear": 2, "k": 0, "c": 0, "start": 0, "speed": 0.01}

INERTIA = 0.75
"""Of both wheels, kg m²: the coupling makes one of them."""

SOFT = 2e-3
"""Relative: what the coupling gives way."""


def text(**given):
    return COUPLED.format(**{**GIVEN, **given})


def growth(given: str, seconds: float) -> float:
    """By how much a run of plain MuJoCo grows, by its velocity."""
    speeds = [float(data.qvel[0]) for _, data in runs(given, seconds)]
    return speeds[-1] / speeds[len(speeds) // 2 - 1]


def test_a_damper_of_the_wrong_sign():
    """c gear² less what joint and tendon damp, over the inertia that the loop moves, is the rate of growth."""
    given = text(c=0.3)
    one = only(of_text(given), "A7")
    assert one.element == "drive"
    assert one.figures["rate"] == pytest.approx((0.3 * 4 - 0.15) / INERTIA, rel=1e-9)
    assert math.log(growth(given, 2.0)) == pytest.approx(one.figures["rate"], rel=SOFT)
    assert "biasprm[2] = 0.3 pushes along with the velocity: joint 'one' is left with a damping of -1.1 N m s/rad" in (
        one.line
    )


def test_a_servo_that_pushes_away():
    given = text(k=3.0, spring=2.0, own=0.0, cord=0.0)
    one = only(of_text(given), "A7")
    assert one.figures["rate"] == pytest.approx(math.sqrt((3.0 * 4 - 2.0) / INERTIA), rel=1e-9)
    # Of sinh: after two periods of growth it is an exponential.
    assert math.log(growth(given, 2.0)) == pytest.approx(one.figures["rate"], rel=SOFT)
    assert "a stiffness of -10 N m/rad" in one.line


@pytest.mark.parametrize("given", [{"c": -0.3}, {"c": 0.03}, {"k": -3.0}, {"k": 0.5, "spring": 2.5}])
def test_what_is_damped_or_held_by_the_rest_is_none(given):
    """Damping of 0.15 in all is more than 4 · 0.03, and a spring of 2.5 more than 4 · 0.5."""
    assert "A7" not in {one.code for one in of_text(text(**given))}
    assert abs(growth(text(**given), 2.0)) < 1.0 + SOFT


def test_what_the_loop_does_not_allow_is_not_fed():
    """Both wheels held by a second coupling, to a joint that a third holds: nothing can move."""
    given = text(c=0.3).replace("</equality>", '<joint joint1="two" polycoef="0 0 0 0 0"/></equality>')
    assert "A7" not in {one.code for one in of_text(given)}


def test_an_actuator_that_is_switched_off():
    given = text(c=0.3).replace('name="drive"', 'name="drive" group="3"')
    assert only(of_text(given), "A7")
    off = given.replace("<option ", '<option actuatorgroupdisable="3" ')
    assert "A7" not in {one.code for one in of_text(off)}


def test_a_gain_that_hangs_on_the_velocity_counts_at_the_control_of_the_start():
    given = text(c=0.0).replace(
        'biastype="affine" biasprm="0 0 0.0"', 'gaintype="affine" gainprm="0 0 0.3" biastype="none"'
    )
    model = mujoco.MjModel.from_xml_string(given)
    assert model.actuator_gainprm[0, 2] == 0.3
    assert "A7" not in {one.code for one in of_text(given)}
    view = view_of(model)
    view.data.ctrl[0] = 1.0
    (one,) = look(view)
    assert one.figures["rate"] == pytest.approx((0.3 * 4 - 0.15) / INERTIA, rel=1e-9)


def test_servos_as_they_should_be():
    for name in ("gripper_2f/scene.xml", "biped_leg/scene.xml", "stiff_servo.xml"):
        assert "A7" not in {one.code for one in of_file(name)}
