"""Ranges that a coupling does not admit, beside plain MuJoCo with those that are named."""

import mujoco
import numpy as np
import pytest
from seen import of_text, only, runs

CLAWS = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.001" gravity="0 0 0"/>
  <default><geom contype="0" conaffinity="0" mass="0.1" size="0.02"/><joint damping="0.05"/></default><worldbody>
  <body name="arm"><joint name="arm" type="slide" axis="1 0 0"/><geom/>
    <body name="lead"><joint name="lead" type="{kind}" axis="0 1 0" range="{lead}" ref="{ref}"/>
      <geom pos="0.1 0 0"/></body>
    <body name="follow" pos="0 0.1 0"><joint name="follow" type="{kind}" axis="0 1 0" range="{follow}"/>
      <geom pos="0.1 0 0"/></body></body></worldbody>
  <equality><joint name="mimic" joint1="follow" joint2="lead" polycoef="{polycoef} 0 0 0"/></equality>
  <actuator><position name="pull" joint="lead" kp="20" kv="1"/></actuator>
  <keyframe><key name="go" qpos="0 {ref} 0" ctrl="{ctrl}"/></keyframe></mujoco>"""


def claws(lead: str, follow: str, polycoef: str, ctrl: float, kind: str = "hinge", ref: float = 0.0) -> str:
    return CLAWS.format(lead=lead, follow=follow, polycoef=polycoef, ctrl=ctrl, kind=kind, ref=ref)


def left(text: str) -> float:
    """How far the coupling stands open after two seconds of plain MuJoCo."""
    *_, (_, data) = runs(text, 2.0)
    return abs(float(data.efc_pos[0]))


@pytest.mark.parametrize(
    ("lead", "follow", "polycoef", "ctrl", "kind", "ref", "where"),
    [
        ("0 1.1", "0 1.1", "0 -1", 0.7, "hinge", 0.0, "at 0 rad alone"),
        ("-0.05 0", "-0.02 0", "0 -0.4", -0.04, "slide", 0.0, "at 0 m alone"),
        ("0.2 0.9", "0 1.5", "0 -2", 0.6, "hinge", 0.2, "at 0 rad alone"),
        ("0 0.5", "0.2 0.6", "0 -0.5", 0.4, "hinge", 0.0, "in no pose"),
    ],
)
def test_a_range_that_the_coupling_leads_away_from(lead, follow, polycoef, ctrl, kind, ref, where):
    text = claws(lead, follow, polycoef, ctrl, kind, ref)
    one = only(of_text(text, 0), "C3")
    assert (one.element, one.severity, one.figures["joint"]) == ("mimic", "error", "follow")
    assert where in one.line
    low, high = one.figures["wanted"]
    mended = claws(lead, f"{low!r} {high!r}", polycoef, ctrl, kind, ref)
    assert left(mended) < 0.05 * left(text)
    assert "C3" not in {one.code for one in of_text(mended, 0)}


@pytest.mark.parametrize(
    ("lead", "follow", "polycoef"),
    [("0 1.1", "-1.1 0", "0 -1"), ("0 1.1", "-0.4 1", "0 -1"), ("-1 1", "0 1", "0 1"), ("0 1", "0 0.3", "0.1 0.5")],
)
def test_ranges_that_share_a_stretch_are_left_to_a_run(lead, follow, polycoef):
    assert "C3" not in {one.code for one in of_text(claws(lead, follow, polycoef, 0.5), 0)}


def test_the_other_sign_of_the_ratio_is_the_other_way_to_mend_it():
    one = only(of_text(claws("0 1.1", "0 1.1", "0 -1", 0.7), 0), "C3")
    assert one.line.endswith("or the other sign in its polycoef?")
    assert left(claws("0 1.1", "0 1.1", "0 1", 0.7)) < 1e-3


def test_the_wanted_range_is_where_the_leader_leads_it():
    text = claws("0.2 0.9", "0 1.5", "-0.3 -2", 0.6, ref=0.2)
    model = mujoco.MjModel.from_xml_string(text)
    (low, high), leads = only(of_text(text, 0), "C3").figures["wanted"], np.array([0.2, 0.9]) - 0.2
    assert (low, high) == pytest.approx(tuple(sorted(-0.3 - 2.0 * leads)))
    assert model.jnt_range[model.joint("follow").id].tolist() == [0.0, 1.5]
