"""Servos at the edge of what a timestep bears, against runs of plain MuJoCo."""

import mujoco
import numpy as np
import oarlock
import pytest
from seen import lasts, of_file, of_text, only, text_of


def test_a_servo_that_the_timestep_does_not_bear():
    """Within the bounds that are named plain MuJoCo stays finite; as it is written it does not."""
    text, one = text_of("stiff_servo.xml"), only(of_file("stiff_servo.xml"), "A1")
    assert one.severity is None
    assert not lasts(text)
    assert lasts(text.replace('kp="400"', f'kp="{one.figures["kp_stable"]}"'))
    assert lasts(text, timestep=one.figures["timestep_stable_s"])
    assert one.figures["number"] == pytest.approx(number_of(text), rel=1e-6)


@pytest.mark.parametrize(("ctrl", "part"), [("0.2", 0.6), ("0.45", 0.25)])
def test_how_far_the_loops_help_is_measured_in_the_run_that_diverges(ctrl, part, tmp_path):
    """A step at the start says what small motions bear; the jump to the control takes the mechanism elsewhere."""
    text = text_of("stiff_servo.xml").replace('ctrl="0.2"', f'ctrl="{ctrl}"')

    def borne(kp: float) -> bool:
        return lasts(text.replace('kp="400"', f'kp="{kp!r}"'), 2.0)

    (tmp_path / "servo.xml").write_text(text)
    one = only(oarlock.check(tmp_path / "servo.xml", budget=0).verdict, "A1")
    most, of_a_step = one.figures["kp_with_loops"], only(of_text(text, 0), "A1").figures["kp_with_loops"]
    assert one.figures["kp_stable"] * 0.99 < most < part * of_a_step
    assert f"({most:g} with the loops, in this run)" in one.line
    assert borne(most)
    assert borne(0.5 * (most + one.figures["kp_stable"]))
    assert not all(borne(float(kp)) for kp in np.geomspace(most, 1.1 * most, 5))
    assert not borne(of_a_step)


def number_of(text: str) -> float:
    """h²kp/I of the first actuator on a tree without its loops."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    dof = model.jnt_dofadr[model.actuator_trnid[0, 0]]
    gear = model.actuator_gear[0, 0]
    return float(model.opt.timestep**2 * -model.actuator_biasprm[0, 1] * gear**2 * np.linalg.inv(mass)[dof, dof])


SPINNING = """<mujoco><option timestep="0.001" integrator="{integrator}" gravity="0 0 0"/><worldbody>
  <body name="rotor"><joint name="rotor" axis="0 0 1" damping="{damping}"/>
    <inertial pos="0 0 0" mass="1" diaginertia="1 1 0.001"/></body>
  <body name="other" pos="1 0 0"><joint name="other" axis="0 0 1"/>
    <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
  <body name="third" pos="2 0 0"><joint name="third" axis="0 0 1"/>
    <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
  </worldbody><equality><joint joint1="other" joint2="third"/></equality>
  <actuator>{actuator}</actuator></mujoco>"""

EDGES = [
    ("Euler", 0.0, '<position joint="rotor" kp="{}" kv="0"/>', 4000.0),
    ("implicit", 0.0, '<position joint="rotor" kp="{}" kv="0"/>', 4000.0),
    ("RK4", 0.0, '<position joint="rotor" kp="{}" kv="0"/>', 8000.0),
    ("Euler", 0.0, '<position joint="rotor" gear="4" kp="{}" kv="0"/>', 250.0),
    ("Euler", 0.0, '<position joint="rotor" kp="{}" kv="0.5"/>', 3000.0),  # h²k + 2hc < 4 I
    ("implicitfast", 0.0, '<position joint="rotor" kp="{}" kv="0.5"/>', 5000.0),  # h²k < 4 I + 2hc
    ("Euler", 0.5, '<position joint="rotor" kp="{}" kv="0"/>', 5000.0),  # eulerdamp
    ("Euler", 0.0, '<velocity joint="rotor" kv="{}"/>', 2.0),
    ("implicitfast", 0.0, '<velocity joint="rotor" kv="{}"/>', None),
    ("Euler", 0.0, '<general joint="rotor" gainprm="7" biastype="affine" biasprm="0 -{} 0"/>', 4000.0),
    (
        "Euler",
        0.0,
        '<general joint="rotor" dyntype="filter" dynprm="0.1" gainprm="7" biastype="affine" biasprm="0 -{} 0"/>',
        4000.0,
    ),
]


@pytest.mark.parametrize(("integrator", "damping", "actuator", "edge"), EDGES)
def test_the_edge_of_stability(integrator, damping, actuator, edge):
    """Of a rotor of 1 g m² at 1 ms, where the formulas are those of a single oscillator; 2 % to either side."""

    def text(gain: float) -> str:
        return SPINNING.format(integrator=integrator, damping=damping, actuator=actuator.format(repr(gain)))

    def grows(gain: float) -> bool:
        model = mujoco.MjModel.from_xml_string(text(gain))
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        data = mujoco.MjData(model)
        data.qpos[0], data.qvel[0] = 1e-9, 1e-9
        for _ in range(2000):
            mujoco.mj_step(model, data)
        return not abs(data.qpos[0]) < 1e-6

    for gain in [0.98 * edge, 1.02 * edge] if edge else [10.0, 1e5]:
        found = [one for one in of_text(text(gain)) if one.code == "A1"]
        assert bool(found) == grows(gain) == bool(edge and gain > edge)
        if found:
            stable = found[0].figures.get("kp_stable") or found[0].figures["kv_stable"]
            assert stable == pytest.approx(edge, rel=0.01)


PADDLES = """<mujoco><option timestep="0.002"/><worldbody>
  <body name="left"><joint name="left" axis="0 0 1"/>
    <geom type="box" pos="0.03 0 0" size="0.03 0.01 0.002" mass="0.01" contype="0" conaffinity="0"/></body>
  <body name="right" pos="0.2 0 0"><joint name="right" axis="0 0 1" armature="{armature}"/>
    <geom type="box" pos="0.03 0 0" size="0.03 0.01 0.002" mass="0.01" contype="0" conaffinity="0"/></body>
  </worldbody><equality><joint name="mimic" joint1="left" joint2="right" polycoef="0 -1 0 0 0"/></equality>
  <actuator><position name="turn" joint="right" kp="{kp}" kv="{kv}"/></actuator>
  <keyframe><key name="k" qpos="0 0" ctrl="0.3"/></keyframe></mujoco>"""
"""Two light paddles, 1.24e-5 kg m² each."""


def paddles(kp: float = 0.5, kv: float = 0.06, armature: float = 0.0) -> str:
    return PADDLES.format(kp=repr(kp), kv=repr(kv), armature=repr(armature))


def test_a_damper_that_is_too_stiff_is_named_and_not_the_spring():
    """No kp makes it stable; each cure that is named does, and what is twice as far off does not."""
    one = only(of_text(paddles(), 0), "A1")
    assert not any(lasts(paddles(kp=kp)) for kp in (0.5, 0.05, 0.0005))
    assert "kp_stable" not in one.figures
    assert "must be below 4 under euler" in one.line
    assert ", by its kv: unstable by itself; stable with kv below" in one.line
    assert "implicitfast" in one.line
    assert lasts(paddles(kv=0.99 * one.figures["kv_stable"]))
    assert not lasts(paddles(kv=2.2 * one.figures["kv_stable"]))
    assert lasts(paddles(armature=one.figures["armature"]))
    assert not lasts(paddles(armature=0.2 * one.figures["armature"]))
    assert lasts(paddles(), timestep=one.figures["timestep_stable_s"])
    assert lasts(paddles().replace('timestep="0.002"', 'timestep="0.002" integrator="implicitfast"'))


@pytest.mark.parametrize(("kp", "kv"), [(35.0, 0.06), (13.0, 0.2), (20.0, 0.115)])
def test_where_spring_and_damper_are_too_stiff_each_alone_other_cures_are_named(kp, kv):
    """No bound on one of them cures it; the armature that is named does, with whatever digits it is told."""
    one = only(of_text(paddles(kp, kv), 0), "A1")
    assert not {"kp_stable", "kv_stable"} & set(one.figures)
    assert lasts(paddles(kp, kv, armature=one.figures["armature"]))
    assert not lasts(paddles(kp, kv, armature=0.6 * one.figures["armature"]))
    assert "implicitfast" in one.line
    assert lasts(paddles(kp, kv).replace('timestep="0.002"', 'timestep="0.002" integrator="implicitfast"'))


def test_the_bounds_with_the_loops_and_without_them():
    """The coupling doubles the inertia: without it kv breaks at half."""
    one = only(of_text(paddles(), 0), "A1")
    with_loops = float(one.line.partition("kv below ")[2].partition("(")[2].partition(" with")[0])
    assert lasts(paddles(kv=0.98 * with_loops))
    assert not lasts(paddles(kv=1.15 * with_loops))  # between them the row becomes stiffer where it is off
    alone = paddles(kv=1.03 * one.figures["kv_stable"]).replace('joint name="mimic"', 'joint active="false"')
    assert not lasts(alone)
    assert lasts(alone.replace(repr(1.03 * one.figures["kv_stable"]), repr(0.99 * one.figures["kv_stable"])))


def test_a_spring_and_a_damper_that_break_it_together():
    """Either is told a bound with the other as it is, and either bound holds."""
    one = only(of_text(paddles(kp=6.0, kv=0.01), 0), "A1")
    assert lasts(paddles(kp=0.99 * one.figures["kp_stable"], kv=0.01))
    assert lasts(paddles(kp=6.0, kv=0.99 * one.figures["kv_stable"]))
    assert "by its" not in one.line


def test_two_servos_that_shake_only_together():
    actuator = (
        '<position name="one" joint="rotor" kp="2500" kv="0"/><position name="two" joint="rotor" kp="2400" kv="0"/>'
    )
    one = only(of_text(SPINNING.format(integrator="Euler", damping=0, actuator=actuator)), "A1")
    assert one.element == "one"
    assert one.figures["also"] == ["two"]


def test_a_servo_with_a_force_range_chatters():
    actuator = '<position name="one" joint="rotor" kp="5000" kv="0" forcerange="-1 1"/>'
    assert only(of_text(SPINNING.format(integrator="Euler", damping=0, actuator=actuator)), "A1").severity == "warning"
