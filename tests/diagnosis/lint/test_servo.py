"""Servos at the edge of what a timestep bears, against runs of plain MuJoCo."""

import mujoco
import numpy as np
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
            stable = found[0].figures.get("kp_stable") or found[0].figures.get("kv_stable")
            assert stable == pytest.approx(edge, rel=0.01) or "kp_stable" in found[0].figures


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
