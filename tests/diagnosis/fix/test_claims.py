"""What a fixed file may not claim: errors that stiffer equalities hide, and findings that are not seen any more."""

from pathlib import Path

import mujoco
import numpy as np
import oarlock
import pytest
from places import FIXTURES

CHECKED = FIXTURES / "check"

CLAWS = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.001" gravity="0 0 0"/>
  <default><geom contype="0" conaffinity="0" mass="0.1" size="0.02"/><joint damping="0.05" axis="0 1 0"/></default>
  <worldbody>
  <body><joint name="lead" range="{lead}"/><geom pos="0.1 0 0"/></body>
  <body pos="0 0.1 0"><joint name="follow" range="{follow}"/><geom pos="0.1 0 0"/></body></worldbody>
  <equality><joint name="mimic" joint1="follow" joint2="lead" polycoef="0 {ratio} 0 0 0"/></equality>
  <actuator><position name="pull" joint="lead" kp="20" kv="1"/></actuator>
  <keyframe><key name="go" ctrl="{ctrl}"/></keyframe></mujoco>"""

WRONG = {
    "S3": (CHECKED / "locked_cranks.xml").read_text(),
    "L9": (CHECKED / "mimic_ring.xml").read_text(),
    "L10": (CHECKED / "welded_pin.xml").read_text(),
    "C3": CLAWS.format(lead="0 1.1", follow="0 1.1", ratio=-1, ctrl=0.7),
    "A2": CLAWS.format(lead="0 0.5", follow="0 0.5", ratio=1, ctrl=200),
}
"""Code of an error → a file that has it, and whose equalities open."""


def fixed(folder: Path, text: str, **asked):
    (folder / "model.xml").write_text(text)
    checked = oarlock.check(folder / "model.xml", **({"duration": 0.5} | asked))
    return checked.fix(folder / "fixed.xml"), checked


@pytest.mark.parametrize("code", WRONG)
def test_equalities_are_not_stiffened_beside_an_error_that_stays(tmp_path, code):
    fix, checked = fixed(tmp_path, WRONG[code])
    assert code in {one.code for one in checked.verdict if one.severity == "error"}
    models = [mujoco.MjModel.from_xml_path(str(tmp_path / name)) for name in ("model.xml", "fixed.xml")]
    np.testing.assert_array_equal(models[0].eq_solref, models[1].eq_solref)
    np.testing.assert_array_equal(models[0].eq_solimp, models[1].eq_solimp)
    assert not fix.reached
    assert f"{code} " in fix.reason
    assert "stay" in fix.reason
    assert code in {one.code for one in fix.left}
    assert code not in fix.mended
    assert any("solref" in said and f"beside {code} " in said for said in fix.left_out)
    assert not any("solref" in one.what for one in fix.changes)


def test_the_command_does_not_call_it_fixed(oarlock_here):
    said = oarlock_here("check", CHECKED / "mimic_ring.xml", "--fix", "fixed.xml", "--duration", "0.3")
    assert said.returncode == 1
    assert "Not fixed: fixed.xml" in said.stdout
    assert "\nFixed" not in said.stdout
    assert "L9 contradictory of" in said.stderr


def test_no_copy_of_an_included_file_is_left_that_has_no_change(tmp_path):
    """The equalities stand in a file of their own, of which the first try has a copy with settings."""
    equality = WRONG["C3"][WRONG["C3"].index("<equality>") : WRONG["C3"].index("<actuator>")]
    (tmp_path / "loops.xml").write_text(f"<mujoco>{equality}</mujoco>")
    fix, _ = fixed(tmp_path, WRONG["C3"].replace(equality, '<include file="loops.xml"/>'))
    assert not fix.reached
    assert {path.name for path in tmp_path.iterdir()} == {"model.xml", "loops.xml", "fixed.xml"}
    assert [path.name for path in fix.written] == ["fixed.xml"]


def test_settings_that_the_user_asks_for_are_written_all_the_same(tmp_path):
    fix, _ = fixed(tmp_path, WRONG["C3"], timestep=0.0005)
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "fixed.xml")).opt.timestep == 0.0005
    assert not fix.reached
    assert any("beside C3" in said for said in fix.left_out)


MIMIC = """<mujoco><option timestep="0.002"/><default><geom contype="0" conaffinity="0" mass="0.05"/></default>
  <worldbody><body name="a"><joint name="a" axis="0 0 1" damping="0.1"/><geom size="0.02"/></body>
    <body name="b" pos="0.1 0 0"><joint name="b" axis="0 0 1" damping="0.1"/><geom size="0.02"/></body></worldbody>
  <equality><joint name="follow" joint1="b"/></equality>
  <actuator><position joint="a" kp="2" kv="0.1"/></actuator><keyframe><key ctrl="0.5"/></keyframe></mujoco>"""


@pytest.mark.parametrize(("text", "code"), [(MIMIC, "S3 locked of 'follow'"), (WRONG["A2"], "A2 unit of 'pull'")])
def test_what_the_check_puts_first_is_not_called_fixed_while_it_stands(text, code, tmp_path):
    """The loops hold, or nearly: what the mechanism lacks is another thing, and has to be written by hand."""
    fix, _ = fixed(tmp_path, text)
    assert not fix.reached
    found, answer = list(fix.by_hand)
    assert found == code
    assert answer == oarlock.check(tmp_path / "fixed.xml", duration=0.5).answer
    told = list(fix.told())
    assert f"not fixed  {code}, by hand: {answer}" in told
    assert not any("no change mends" in said for said in told)


PULLED = """<mujoco><option timestep="0.002"/>
  <default><geom contype="0" conaffinity="0" type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" mass="0.3"/>
    <joint damping="0.3" axis="0 1 0"/><position kp="60" kv="3"/></default>
  <worldbody><body name="a"><joint name="a"/><geom/></body>
    <body name="b" pos="0 0.3 0"><joint name="b"/><geom/></body></worldbody>
  <equality><joint name="belt" joint1="b" joint2="a" polycoef="0 0.5 0 0 0"/></equality>
  <actuator><position joint="a"/><position joint="b"/></actuator><keyframe><key ctrl="0.9 -0.2"/></keyframe></mujoco>"""


def test_servos_that_fight_one_another_do_so_in_the_fixed_file(tmp_path):
    """The belt holds, and plain MuJoCo has both servos pull as hard as before, one against the other."""
    fix, checked = fixed(tmp_path, PULLED, duration=1.0)
    assert "A5" in {one.code for one in checked.verdict}
    assert fix.after.drift <= fix.target
    data = []
    for name in ("model.xml", "fixed.xml"):
        model = mujoco.MjModel.from_xml_path(str(tmp_path / name))
        data.append(mujoco.MjData(model))
        mujoco.mj_resetDataKeyframe(model, data[-1], 0)
        while data[-1].time < 2.0:
            mujoco.mj_step(model, data[-1])
    for one in data:
        a, b = one.actuator_force
        assert min(abs(a), abs(b)) > 1.0
        assert a * b * 0.5 < 0.0  # along the motion that the belt admits
    assert "A5" not in fix.mended
    (one,) = (one for one in fix.left if one.code == "A5")
    assert one.line.startswith("stiffer equalities hide it, and do not mend it")


def test_what_lasts_behind_a_closed_start_is_not_mended(tmp_path):
    """S4 is looked for behind an open start; the drift that it is of has another code behind a closed one."""
    fix, checked = fixed(tmp_path, WRONG["S3"], duration=2.0)
    assert "S4" in {one.code for one in checked.verdict if one.severity == "warning"}
    assert fix.after.drift > 0.5 * fix.before.drift
    assert "S1" in fix.mended
    assert "S4" not in fix.mended


AGREED = PULLED.replace("0.9 -0.2", "0.9 0.45").replace("</default>", '<equality solref="0.08 1"/></default>')
"""The servos ask for what the belt admits, and the belt is soft."""


def test_the_users_bound_is_looked_at_again(tmp_path):
    for bound, mended in ((1e-3, True), (1e-12, False)):
        fix, checked = fixed(tmp_path, AGREED, fail_above=bound)
        assert checked.verdict[0].code == "D7"
        assert ("D7" in fix.mended) == mended == fix.reached
        assert ("D7" in {one.code for one in fix.left}) != mended
