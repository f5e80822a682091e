"""What limits, friction and contacts do to loops: who pushes, what they lock, hide, share and fight."""

import mujoco
import numpy as np
import oarlock
import pytest
from mechanisms import four_bar, gripper
from oarlock.diagnosis.loops.stops import find_stops
from oarlock.diagnosis.runs.beside import find_beside
from oarlock.diagnosis.runs.pushes import Pushes


def pushes_of(xml: str, steps: int, ctrl: float = 0.0):
    model = mujoco.MjModel.from_xml_string(xml)
    data, pushes = mujoco.MjData(model), Pushes(model)
    data.ctrl[:] = ctrl
    for _ in range(steps):
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        pushes.take(data)
    return model, data, {push.name: push for push in pushes.found}


@pytest.mark.parametrize("cone", ["elliptic", "pyramidal"])
def test_the_block_is_carried_and_gripped(cone):
    """The table bears the block's weight before the fingers come; no friction is larger than its loss."""
    _, data, found = pushes_of(gripper(cone=cone), 400, -0.7)
    assert {push.kind for push in found.values()} == {"friction", "limit", "contact"}
    (table,) = (push for push in found.values() if push.kind == "contact" and "the world" in push.name)
    assert table.first_s <= 0.01
    # 0.08 kg; the fingers press on it and lift it, but no more than they can.
    assert 0.08 * 9.81 < table.largest < 100.0
    for push in found.values():
        assert push.first_s <= push.last_s <= data.time
        assert 0 < push.steps <= 400
        if push.kind == "friction":
            assert push.largest <= 0.05 * (1 + 1e-9)
            assert 0 < push.stuck <= push.steps


@pytest.mark.parametrize("option", ["", "noslip_iterations='3'"])
def test_who_pushes_is_told_and_noslip_with_it(tmp_path, option):
    path = tmp_path / "gripper.xml"
    path.write_text(gripper(option=option))
    (told,) = [one for one in oarlock.check(path, budget=0, duration=0.1).verdict if one.code == "R2"]
    assert told.severity == "note"
    assert all(kind in told.line for kind in ("friction of", "contact between"))
    assert ("noslip" in told.line) is bool(option)


def test_a_contact_counts_though_the_friction_before_it_has_its_number():
    """Friction of velocity 0 comes right before contact 0."""
    xml = """
<mujoco>
  <option cone="elliptic"/>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body pos="0 0 1"><joint name="first" frictionloss="0.1"/><geom size="0.01"/></body>
    <body pos="0 0 0.1"><freejoint/><geom name="ball" size="0.1" mass="2"/></body>
  </worldbody>
</mujoco>"""
    _, data, found = pushes_of(xml, 500)
    assert data.efc_id[:2].tolist() == [0, 0]
    assert found["contact between the world and geom 'ball'"].largest == pytest.approx(2 * 9.81, rel=0.1)


@pytest.mark.parametrize(("rocker", "locked"), [("0 1", False), ("-1 0", True)])
def test_two_limits_lock_a_four_bar_where_they_allow_no_common_way(rocker, locked):
    """The crank may only go forth, and takes the rocker along: forth, too, or it stands still."""
    xml = four_bar(rocker=f'limited="true" range="{rocker}"').replace(
        '<joint name="crank"', '<joint name="crank" limited="true" range="0 1"'
    )
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    found = find_stops(model, data)
    assert (found is not None) is locked
    if found is not None:
        assert (set(found.limits), found.dof) == ({"limit of joint 'crank'", "limit of joint 'rocker'"}, 1)


def test_one_limit_locks_nothing():
    model = mujoco.MjModel.from_xml_string(four_bar(rocker='limited="true" range="0 1"'))
    assert find_stops(model, mujoco.MjData(model)) is None


RESTING = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="box" pos="0 0 HEIGHT"><freejoint/><geom name="box" type="box" size="0.1 0.1 0.1"/></body>
  </worldbody>
  <equality><weld name="hold" body1="box"/></equality>
</mujoco>"""


@pytest.mark.parametrize(
    ("height", "others"), [("0.0999", ("contact between geom 'floor' and geom 'box'",)), ("0.5", None)]
)
def test_a_weld_beside_a_contact_is_not_unique(height, others):
    model = mujoco.MjModel.from_xml_string(RESTING.replace("HEIGHT", height))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found = find_beside(model, data)
    assert tuple((one.equality, one.others) for one in found) == (() if others is None else (("hold", others),))


COUPLED = """
<mujoco>
  <option timestep="0.002" gravity="0 0 0"/>
  <default><geom type="capsule" size="0.01" mass="0.1" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body><joint name="drive" axis="0 1 0" damping="0.05"/><geom fromto="0 0 0 0.1 0 0"/></body>
    <body pos="0 0.1 0"><joint name="driven" axis="0 1 0" damping="0.05" FRICTION/><geom fromto="0 0 0 0.1 0 0"/></body>
  </worldbody>
  <equality><joint name="mimic" joint1="driven" joint2="drive" solref="0.2 1"/></equality>
  <actuator><position name="servo" joint="drive" kp="5"/></actuator>
  <keyframe><key name="go" ctrl="0.5"/></keyframe>
</mujoco>"""


@pytest.mark.parametrize(("friction", "lags"), [('frictionloss="0.2"', True), ("", False)])
def test_friction_that_makes_a_coupling_lag_is_found(tmp_path, friction, lags):
    path = tmp_path / "mimic.xml"
    path.write_text(COUPLED.replace("FRICTION", friction))
    checked = oarlock.check(path, budget=0)
    found = [one for one in checked.verdict if one.code == "C2"]
    assert bool(found) is lags
    if lags:
        (one,) = found
        assert one.element == "mimic"
        assert "'driven'" in one.line
        given, without = one.figures["given"], one.figures["without"]
        assert without < 0.5 * given
        assert f"by {given:.4g} rad, by {without:.3g} rad without" in one.line
        assert one.cost == pytest.approx((given - without) * checked.examination.size, rel=1e-12)
        exact = checked.examination.exact
        assert exact is not None
        assert exact.drift[:, 0].max() < 1e-12
        assert exact.loads[:, 1].max() == pytest.approx(0.2, rel=1e-6)


def test_a_limit_that_fights_a_loop_is_found(tmp_path):
    """The coupling holds the driven joint beyond its limit, and an equality holds the drive."""
    xml = COUPLED.replace("FRICTION", 'limited="true" range="-1 -0.05"').replace(
        "<equality>", '<equality><joint name="held" joint1="drive"/>'
    )
    path = tmp_path / "fight.xml"
    path.write_text(xml)
    checked = oarlock.check(path, budget=0)
    (one,) = [one for one in checked.verdict if one.code == "C1"]
    assert one.figures["largest"] > 0
    exact = checked.examination.exact
    assert exact is not None
    assert exact.blocked.tolist() == [1] * len(exact.time)
    assert np.abs(exact.qpos).max() < 1e-12


FIGHTING = """
<mujoco>
  <option gravity="0 0 0"/>
  <default><joint axis="0 1 0" damping="0.05"/><geom type="capsule" size="0.01" contype="0"/></default>
  <worldbody>
    <body><joint name="drive"/><geom fromto="0 0 0 0.1 0 0"/></body>
    <body pos="0 1 0"><joint name="driven"/><geom fromto="0 0 0 0.1 0 0"/></body>
    <body pos="0 2 0"><joint name="still" limited="true" range="-1 0.1"/><geom fromto="0 0 0 0.1 0 0"/></body>
    <body pos="0 3 0"><joint name="pressed" limited="true" range="-9 0.1"/><geom fromto="0 0 0 0.1 0 0"/></body>
  </worldbody>
  <equality>
    <joint name="mimic" joint1="driven" joint2="drive"/>
    <joint name="held" joint1="still" polycoef="0.2 0 0 0 0"/>
  </equality>
  <actuator><position joint="drive" kp="5"/><motor joint="pressed"/></actuator>
  <keyframe><key ctrl="0.5 50" qpos="0 0 0.2 0"/></keyframe>
</mujoco>"""


def test_a_fight_names_who_fights_whom_and_how_hard(tmp_path):
    """Another limit is pressed harder, and another equality moves freely: neither has a part in it."""
    path = tmp_path / "fighting.xml"
    path.write_text(FIGHTING)
    checked = oarlock.check(path, budget=0)
    (one,) = [one for one in checked.verdict if one.code == "C1"]
    fight = checked.examination.fight
    assert fight is not None
    assert (fight.others, fight.equalities, fight.first_s) == (("limit of joint 'still'",), ("held",), 0.0)
    assert "limit of joint 'still' pushes against 'held' alone" in one.line
    # What holds the joint there is all that the equality bears.
    exact = checked.examination.exact
    assert exact is not None
    assert one.figures["largest"] == pytest.approx(np.abs(exact.force[:, 1]).max(), rel=1e-9)
    assert exact.loads[:, 0].max() > 10 * one.figures["largest"]


TOUCHING = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="below" pos="0 0 0.1"><freejoint/><geom type="box" size="0.05 0.05 0.05"/></body>
    <body name="above" pos="0 0 HEIGHT"><freejoint/><geom type="box" size="0.05 0.05 0.05"/></body>
  </worldbody>
  <equality><weld name="tie" body1="below" body2="above"/></equality>
</mujoco>"""


@pytest.mark.parametrize(("height", "fights"), [("0.2", False), ("0.199", True)])
def test_welded_bodies_that_just_touch_fight_nobody_and_overlapping_ones_do(tmp_path, height, fights):
    path = tmp_path / "touching.xml"
    path.write_text(TOUCHING.replace("HEIGHT", height))
    checked = oarlock.check(path, budget=0)
    found = [one for one in checked.verdict if one.code == "C1"]
    assert bool(found) is fights
    if fights:
        assert found[0].line.count("contact between body 'below' and body 'above' pushes against 'tie' alone") == 1


def test_a_touch_that_is_rounding_is_certified(tmp_path):
    """In free fall the two boxes' contact is all there is to measure its own gradient against."""
    path = tmp_path / "touching.xml"
    path.write_text(TOUCHING.replace("HEIGHT", "0.2"))
    for stepping in ("native", "python"):
        results = oarlock.run(path, solver="auto", mode="all", form="both", duration=0.15, stepping=stepping)
        assert set(results.summary["status"]) == {"done"}


def test_a_reaction_beside_a_contact_is_not_called_unique(tmp_path):
    path = tmp_path / "resting.xml"
    path.write_text(RESTING.replace("HEIGHT", "0.0999"))
    model = mujoco.MjModel.from_xml_path(str(path))
    (one,) = oarlock.reactions(model, mujoco.MjData(model))
    assert one.beside == ("contact between geom 'floor' and geom 'box'",)
    (one,) = oarlock.reactions(model, mujoco.MjData(model), ignore_inequalities=True)
    assert one.beside == ()
    page = oarlock.check(path, budget=0).report(tmp_path / "page")
    text = "".join(file.read_text() for file in (tmp_path / "page").glob("*.md"))
    assert page is not None
    assert "unique, not beside others (U3)" in text
