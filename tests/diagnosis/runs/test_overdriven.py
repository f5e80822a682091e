"""Servos that pull a loop apart which has less freedom than they are many, beside plain MuJoCo without them."""

import itertools
from pathlib import Path

import mujoco
import numpy as np
import oarlock
import pytest

SHAFTS = """<mujoco><option timestep="0.002"/>
  <default><geom contype="0" conaffinity="0"/><joint damping="0.3"/></default>
  <worldbody>
  <body name="a"><joint name="a" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" mass="0.3"/></body>
  <body name="b" pos="0 0.3 0"><joint name="b" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" mass="{mass}"/></body>
  <body name="c" pos="0 0.6 0"><joint name="c" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" mass="0.3"/></body></worldbody>
  <tendon><fixed name="sum"><joint joint="a" coef="1"/><joint joint="b" coef="-1"/>{third}</fixed></tendon>
  <equality><tendon name="sum" tendon1="sum"/></equality>
  <actuator>{servos}</actuator><keyframe><key name="k" ctrl="{ctrl}"/></keyframe></mujoco>"""


def shafts(told: dict[str, float], third: bool = False, mass: float = 0.3) -> str:
    """Shafts a = b, or a + c = b, with a servo on each that is told something."""
    servos = "".join(f'<position name="at_{name}" joint="{name}" kp="80" kv="4"/>' for name in told)
    ctrl = " ".join(map(repr, told.values()))
    coef = '<joint joint="c" coef="1"/>' if third else ""
    return SHAFTS.format(third=coef, servos=servos, ctrl=ctrl, mass=mass)


def opened(text: str, off: tuple[int, ...] = ()) -> np.ndarray:
    """Deviation of the equality at each step of plain MuJoCo, with some servos without force."""
    model = mujoco.MjModel.from_xml_string(text)
    model.actuator_gainprm[list(off)] = model.actuator_biasprm[list(off)] = 0.0
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    found = []
    for _ in range(1000):
        mujoco.mj_step(model, data)
        found.append(abs(float(data.efc_pos[0])))
    return np.array(found)


def verdict(text: str, tmp_path: Path) -> list:
    file = tmp_path / "shafts.xml"
    file.write_text(text)
    return oarlock.check(file, budget=0).verdict


@pytest.mark.parametrize(
    ("told", "third", "dof"),
    [({"a": 0.6, "b": 0.1}, False, 1), ({"a": 0.5, "b": 0.2, "c": 0.6}, True, 2)],
)
def test_servos_that_are_told_what_the_loop_cannot_have(tmp_path, told, third, dof):
    text = shafts(told, third)
    given = opened(text)
    worst = int(given.argmax())
    about = slice(max(0, worst - 20), worst + 21)  # 2 % of the steps
    fewer = [opened(text, off)[about].max() for off in itertools.combinations(range(len(told)), len(told) - dof)]
    assert max(fewer) < 0.5 * given.max()
    one = verdict(text, tmp_path)[0]
    assert (one.code, one.element, one.figures["dof"]) == ("A5", "sum", dof)
    assert one.figures["drift"] == pytest.approx(given.max(), rel=1e-9)
    assert one.figures["drift_without"] == pytest.approx(max(fewer), rel=1e-6)
    assert all(f"'at_{name}'" in one.line and f"{name} {value:g} rad" in one.line for name, value in told.items())


@pytest.mark.parametrize(
    ("told", "third", "mass"),
    [
        ({"a": 0.4, "b": 0.4}, False, 0.3),  # the same
        ({"a": 0.4}, False, 60.0),  # a load
        ({"a": 0.1, "b": 0.1}, False, 60.0),  # a load that two bear
        ({"a": 0.5, "b": 0.2}, True, 0.3),  # not more than it has freedom
    ],
)
def test_others_are_not_named(tmp_path, told, third, mass):
    assert "A5" not in {one.code for one in verdict(shafts(told, third, mass), tmp_path)}


MIMIC = """<mujoco><option timestep="0.002"/>
  <default><geom contype="0" conaffinity="0"/><joint damping="0.05"/></default>
  <worldbody><body name="base"><joint name="base" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.1"/>
    <body name="tip" pos="0.1 0 0"><joint name="tip" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.05"/></body></body></worldbody>
  <equality><joint name="mimic" joint1="tip" joint2="base" polycoef="0 0.5 0 0 0"/></equality>
  <actuator><position name="lead" joint="base" kp="20" kv="1"/>{second}</actuator>
  <keyframe><key name="k" ctrl="{ctrl}"/></keyframe></mujoco>"""


def reached(text: str) -> float:
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, 1000)
    return float(data.qpos[0])


def test_what_a_servo_too_many_keeps_the_leader_from_is_told_with_what_frees_it(tmp_path):
    second = '<position name="follow" joint="tip" kp="20" kv="1"/>'
    given = MIMIC.format(second=second, ctrl="0.8 0")
    (one,) = [one for one in verdict(given, tmp_path) if one.code == "A5"]
    assert f"'base' comes to {reached(given):.3g} of 0.8 rad" in one.line
    alone, same = MIMIC.format(second="", ctrl="0.8"), MIMIC.format(second=second, ctrl="0.8 0.4")
    assert "with 'lead' alone" in one.line
    assert "remove 'follow', or tell 'follow' " in one.line
    assert reached(given) < 0.79
    for text in (alone, same):
        assert abs(reached(text) - 0.8) < 0.5 * (0.8 - reached(given))
    assert float(one.line.rsplit(" ", 1)[1]) == pytest.approx(0.4, abs=0.02)


def test_beside_servos_too_many_no_settings_are_offered(tmp_path):
    file = tmp_path / "m.xml"
    file.write_text(MIMIC.format(second='<position name="follow" joint="tip" kp="20" kv="1"/>', ctrl="0.8 0"))
    checked = oarlock.check(file)
    codes = {one.code for one in checked.verdict}
    assert "A5" in codes
    assert "T1" not in codes
    assert checked.mjcf == ""
    assert "solref" not in checked.answer
