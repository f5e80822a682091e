"""Ratios of couplings beside the wheels that are drawn, and beside plain MuJoCo."""

import mujoco
import oarlock
import pytest

WHEELS = """<mujoco><option timestep="0.002"/><default><geom contype="0" conaffinity="0"/>
    <joint damping="0.01"/></default><worldbody>
  <body name="small"><joint name="p" axis="0 1 0"/>
    <geom type="cylinder" size="0.03 0.01" euler="90 0 0" mass="0.2"/></body>
  <body name="large" pos="{away} 0 0"><joint name="q" axis="0 {way} 0"/>
    <geom type="cylinder" size="0.12 0.01" euler="90 0 0" mass="1"/></body></worldbody>
  <equality><joint name="mesh" joint1="{first}" joint2="{second}" polycoef="0 {ratio} 0 0 0" solref="0.004 1"/>
  </equality><actuator><velocity joint="p" kv="0.03"/></actuator>
  <keyframe><key name="k" ctrl="4"/></keyframe></mujoco>"""


def swapped(**given) -> list:
    text = WHEELS.format(**({"away": 0.15, "way": 1, "first": "p", "second": "q"} | given))
    return [one for one in oarlock.check(text, lint=True).verdict if one.code == "L13"]


def turned(**given) -> float:
    """How far the large wheel turns per turn of the small one."""
    model = mujoco.MjModel.from_xml_string(
        WHEELS.format(**({"away": 0.15, "way": 1, "first": "p", "second": "q"} | given))
    )
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, 1000)
    return float(data.qpos[1] / data.qpos[0])


def test_joints_that_are_exchanged_turn_by_the_inverse_of_what_is_drawn():
    (one,) = swapped(ratio=-0.25)
    assert 'joint1="q" joint2="p"' in one.line
    assert 'polycoef="0 -4 0 0 0"' in one.line
    assert turned(ratio=-0.25) == pytest.approx(-4.0, rel=0.05)
    for mended in ({"ratio": -4.0}, {"ratio": -0.25, "first": "q", "second": "p"}):
        assert turned(**mended) == pytest.approx(-0.25, rel=0.05)  # the radii of the wheels
        assert not swapped(**mended)


@pytest.mark.parametrize(
    "given",
    [
        {"ratio": 4.0, "way": -1},  # axes that point against each other
        {"ratio": 4.0, "away": 0.09},  # one inside of the other
        {"ratio": -0.3, "away": 0.3},  # a belt
        {"ratio": -0.7},  # neither
    ],
)
def test_others_are_not_named(given):
    assert not [one for one in swapped(**given) if one.severity != "note"]


def test_a_sign_that_wheels_do_not_have_is_a_note():
    (one,) = swapped(ratio=4.0)
    assert one.severity == "note"
    assert 'polycoef="0 -4 0 0 0"' in one.line
