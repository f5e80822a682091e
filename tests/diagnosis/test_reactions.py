"""``oarlock.reactions``: forces that statics gives in closed form, what MuJoCo applies, and what nobody can know."""

import mujoco
import numpy as np
import oarlock
import pytest
from mechanisms import TANGLE, boat_with, four_bar
from oarlock import InputError
from oarlock.mechanics.load import load_model

G = 9.81
SPAN, WEIGHT_AT, WEIGHT, COUPLER, BAR = 0.8, 0.3, 2.0, 0.5, 0.7
"""Of ``HANGING``: distance of the pivots, m; the weight on the coupler, m and kg; the coupler and each bar, kg."""

STATIC = 1e-9
"""N and N m, of forces of 10: the condition of A times rounding."""

APPLIED = 1e-11
"""N and N m, of forces of 10: the same sums in another order."""

HANGING = f"""
<mujoco>
  <option gravity="0 0 -{G}"/>
  <default><joint axis="0 1 0"/><geom type="capsule" size="0.02" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="left">
      <joint name="left"/><geom fromto="0 0 0 0 0 -0.6" mass="{BAR}"/>
      <body name="coupler" pos="0 0 -0.6">
        <joint name="coupler"/><geom fromto="0 0 0 {SPAN} 0 0" mass="{COUPLER}"/>
        <geom type="sphere" pos="{WEIGHT_AT} 0 0" mass="{WEIGHT}"/><site name="tip" pos="{SPAN} 0 0"/>
      </body>
    </body>
    <body name="right" pos="{SPAN} 0 0">
      <joint name="right"/><geom fromto="0 0 0 0 0 -0.6" mass="{BAR}"/><site name="end" pos="0 0 -0.6"/>
    </body>
  </worldbody>
  <equality><connect name="pin" site1="tip" site2="end"/>{{more}}</equality>
</mujoco>"""
"""A coupler that hangs level from two bars, with a weight on it."""

CARRIED = G * (WEIGHT * WEIGHT_AT / SPAN + COUPLER / 2.0)
"""N, by the law of the lever: what the pin holds of the coupler and its weight."""


def state_of(xml, **changes):
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    for name, value in changes.items():
        getattr(data, name)[:] = value
    return model, data


def known(value):
    """What is there; not None."""
    assert value is not None
    return value


def test_a_weight_on_a_four_bar():
    (pin,) = oarlock.reactions(*state_of(HANGING.format(more="")))
    assert (pin.equality, pin.kind, pin.ends, pin.verdict) == ("pin", "connect", ("coupler", "right"), "unique")
    np.testing.assert_allclose(known(pin.exact.force), [0.0, 0.0, CARRIED], atol=STATIC)
    assert pin.exact.torque is None
    assert pin.exact.along is None
    assert pin.torque is None
    # MuJoCo's constraint gives way: what it carries is short of it, by the impedance, and in the same direction.
    assert 0.8 * CARRIED < known(pin.given.force)[2] < CARRIED


def test_of_two_pins_the_sum_is_known_and_the_parts_are_not():
    stiff = '<connect name="again" site1="tip" site2="end" solref="0.05 1" solimp="0.5 0.5"/>'
    pin, again = oarlock.reactions(*state_of(HANGING.format(more=stiff)))
    np.testing.assert_allclose(known(pin.exact.force) + known(again.exact.force), [0.0, 0.0, CARRIED], atol=STATIC)
    np.testing.assert_allclose(known(pin.exact.force), known(again.exact.force), atol=STATIC)  # of the least norm
    assert (pin.verdict, again.verdict) == ("not unique", "not unique")
    # MuJoCo shares it out otherwise, by the softness, and that part is free: it adds up to nothing.
    assert np.abs(known(pin.free.force)).max() > 0.1
    np.testing.assert_allclose(known(pin.free.force) + known(again.free.force), 0.0, atol=STATIC)


def test_a_weld_carries_a_weight_beside_it():
    model, data = state_of(f"""<mujoco><option gravity="0 0 -{G}"/><worldbody><body name="arm"><freejoint/>
      <geom type="sphere" size="0.05" pos="0.3 0 0" mass="{WEIGHT}"/></body></worldbody>
      <equality><weld name="bond" body1="arm"/></equality></mujoco>""")
    (bond,) = oarlock.reactions(model, data)
    assert (bond.kind, bond.ends, bond.verdict) == ("weld", ("arm", "world"), "unique")
    np.testing.assert_allclose(known(bond.exact.force), [0.0, 0.0, WEIGHT * G], atol=STATIC)
    np.testing.assert_allclose(known(bond.exact.torque), [0.0, -0.3 * WEIGHT * G, 0.0], atol=STATIC)


def test_a_gear_holds_a_weight():
    model, data = state_of(f"""<mujoco><option gravity="0 0 -{G}"/><worldbody>
      <body><joint name="lift" type="slide" axis="0 0 1"/><geom type="sphere" size="0.05" mass="{WEIGHT}"/></body>
      <body pos="1 0 0"><joint name="drum" axis="0 1 0"/><geom type="sphere" size="0.05" mass="1"/></body></worldbody>
      <equality><joint name="gear" joint1="lift" joint2="drum" polycoef="0 0.1 0 0 0"/>
        <joint name="brake" joint1="drum" polycoef="0 0 0 0 0"/></equality></mujoco>""")
    gear, brake = oarlock.reactions(model, data)
    np.testing.assert_allclose(known(gear.exact.along), [WEIGHT * G, -0.1 * WEIGHT * G], atol=STATIC)
    np.testing.assert_allclose(known(brake.exact.along), [0.1 * WEIGHT * G], atol=STATIC)
    assert (gear.ends, brake.ends, gear.verdict) == (("lift", "drum"), ("drum",), "unique")


def applied(model, data, found):
    """Jᵀλ (nv), from the forces and torques of connects and welds as MuJoCo applies them to bodies at a state."""
    total = np.zeros(model.nv)
    for one in found:
        equality = model.equality(one.equality)
        assert model.eq_objtype[equality.id] == mujoco.mjtObj.mjOBJ_SITE
        for sign, site in ((1.0, int(model.eq_obj1id[equality.id])), (-1.0, int(model.eq_obj2id[equality.id]))):
            torque = np.zeros(3) if one.given.torque is None else sign * one.given.torque
            force, point, body = sign * one.given.force, data.site_xpos[site], int(model.site_bodyid[site])
            mujoco.mj_applyFT(model, data, force, torque, point, body, total)
    return total


SITES = (
    TANGLE.partition("  <equality>")[0]
    + """  <equality>
    <connect name="connect sites" site1="s1" site2="s2"/>
    <weld name="weld sites" site1="s1" site2="s2" torquescale="1.5"/>
    <weld name="weld world site" site1="w1" site2="s2"/>
  </equality></mujoco>"""
)


@pytest.mark.parametrize("xml", [HANGING.format(more=""), four_bar(), SITES], ids=["hanging", "four-bar", "tangle"])
def test_given_is_what_mujoco_applies(xml):
    model, data = state_of(xml)
    mujoco.mj_integratePos(model, data.qpos, 0.1 * np.random.default_rng(0).normal(size=model.nv), 1.0)
    data.qvel[:] = np.random.default_rng(1).normal(size=model.nv)
    found = oarlock.reactions(model, data)
    mujoco.mj_forward(model, data)
    scale = np.abs(data.qfrc_constraint).max()
    assert scale > 1.0
    np.testing.assert_allclose(applied(model, data, found), data.qfrc_constraint, atol=APPLIED * scale)


def test_model_and_data_are_left_alone():
    model, data = state_of(HANGING.format(more=""), qvel=0.1)
    mujoco.mj_step(model, data, 3)
    flags = (model.opt.jacobian, model.opt.disableflags, model.opt.enableflags)
    names = ("qpos", "qvel", "qacc", "qacc_warmstart", "efc_force", "qfrc_constraint", "xpos")
    before = {name: getattr(data, name).copy() for name in names}
    oarlock.reactions(model, data, ignore_inequalities=True)
    assert (model.opt.jacobian, model.opt.disableflags, model.opt.enableflags) == flags
    for name in names:
        np.testing.assert_array_equal(getattr(data, name), before[name])


def test_an_equality_that_is_off_carries_nothing():
    assert oarlock.reactions(*state_of(HANGING.format(more=""), eq_active=0)) == ()


def test_what_cannot_be_known_is_refused():
    model, data = state_of(HANGING.format(more=""), qpos=np.nan)
    with pytest.raises(InputError, match="not finite"):
        oarlock.reactions(model, data)
    boat = boat_with()
    with pytest.raises(InputError, match="data of a model with nq = "):
        oarlock.reactions(load_model(boat.model_path, boat.parameters), data)


def test_a_limit_takes_part_in_the_reactions():
    limited = HANGING.format(more="").replace('<joint name="left"/>', '<joint name="left" limited="true" range="5 9"/>')
    (pushed,) = oarlock.reactions(*state_of(limited))
    assert np.abs(known(pushed.exact.force) - [0.0, 0.0, CARRIED]).max() > 1.0
    (pin,) = oarlock.reactions(*state_of(limited), ignore_inequalities=True)
    np.testing.assert_allclose(known(pin.exact.force), [0.0, 0.0, CARRIED], atol=STATIC)
