"""Damping at the edge of what an explicit step bears, against runs of plain MuJoCo."""

import pytest
from seen import lasts, of_file, of_text, only, text_of

WHEEL = """<mujoco><option timestep="0.001" integrator="{integrator}" gravity="0 0 0">{flag}</option><worldbody>
  <body><joint name="wheel" axis="0 0 1" damping="{damping}"/>
    <inertial pos="0 0 0" mass="1" diaginertia="0.001 0.001 0.001"/></body>
  <body pos="1 0 0"><joint name="one" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
  <body pos="2 0 0"><joint name="two" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
  </worldbody><equality><joint joint1="one" joint2="two"/></equality>
  <keyframe><key qvel="1 0 0"/></keyframe></mujoco>"""

EXPLICIT = '<flag eulerdamp="disable"/>'


@pytest.mark.parametrize(("integrator", "flag", "edge"), [("RK4", "", 2.7853), ("Euler", EXPLICIT, 2.0)])
def test_the_bound_is_that_of_the_method(integrator, flag, edge):
    """h d/I of a single wheel is its damping here."""
    for factor, stable in ((0.99, True), (1.01, False)):
        text = WHEEL.format(integrator=integrator, flag=flag, damping=factor * edge)
        assert lasts(text) == stable
        found = [one for one in of_text(text) if one.code == "A4"]
        assert bool(found) == (not stable)
    assert found[0].figures["bound"] == pytest.approx(edge, rel=1e-4)
    armature = found[0].line.rpartition("armature ")[2].split()[0]
    assert lasts(text.replace('name="wheel"', f'name="wheel" armature="{armature}"'))


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast"])
def test_what_is_taken_at_the_end_of_a_step_is_borne(integrator):
    text = WHEEL.format(integrator=integrator, flag="", damping=100)
    assert lasts(text)
    assert "A4" not in {one.code for one in of_text(text)}


def test_a_linkage_that_runge_kutta_does_not_bear():
    assert only(of_file("stiff_damping.xml"), "A4").element == "left"
    assert lasts(text_of("stiff_damping.xml").replace("RK4", "Euler"))
