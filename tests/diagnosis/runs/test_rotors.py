"""Couplings between tiny inertias: an armature is named where plain MuJoCo shows that it mends them."""

import re
from pathlib import Path

import mujoco
import numpy as np
import oarlock
import pytest
from tolerances import SAME_RUN

PHALANX = """<body name="p{n}" pos="{pos}"><joint name="j{n}" axis="0 1 0"/>
  <inertial pos="0 0 -0.01" mass="0.002" diaginertia="1e-6 1e-6 1e-6"/>{rest}</body>"""
MASS = '<body pos="0 0 -0.02"><geom type="sphere" size="0.01" mass="{mass}"/></body>'
COUPLED = '<joint name="c{n}" joint1="j{n}" joint2="motor" polycoef="0 0.5 0 0 0"/>'
CABLE = '<fixed name="{name}"><joint joint="{joint}" coef="{coef}"/></fixed>'
TIED = '<tendon name="c{n}" tendon1="t{n}" tendon2="pull" polycoef="0 0.5 0 0 0"/>'


def finger(cables: bool = False, mass: float = 0.2, armature: float = 0.0) -> str:
    """Four hinges of 1e-6 kg m² follow a motor, by joint equalities or by cables over pulleys of 10 mm."""
    rest = MASS.format(mass=mass)
    for n in range(4, 0, -1):
        rest = PHALANX.format(n=n, pos="0 0 -0.02" if n > 1 else "0 0 0", rest=rest)
    tendons = [CABLE.format(name=f"t{n}", joint=f"j{n}", coef=0.01) for n in range(1, 5)]
    tendons += [CABLE.format(name="pull", joint="motor", coef=0.01)]
    text = f"""<mujoco><option timestep="0.002"/>
      <default><geom contype="0" conaffinity="0"/><joint damping="1e-4" armature="{armature}"/></default>
      <worldbody><body pos="-0.05 0 0"><joint name="motor" axis="0 1 0" damping="0.01" armature="0.002"/>
        <geom type="cylinder" size="0.01 0.01" mass="0.05"/></body>{rest}</worldbody>
      {"<tendon>" + "".join(tendons) + "</tendon>" if cables else ""}
      <equality>{"".join((TIED if cables else COUPLED).format(n=n) for n in range(1, 5))}</equality>
      <actuator><position joint="motor" kp="20" kv="0.5"/></actuator>
      <keyframe><key ctrl="1"/></keyframe></mujoco>"""
    return text


GEARED = """<mujoco><option timestep="0.001"/><default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body><joint name="nut" type="slide" axis="0 0 1" damping="1"/><geom size="0.05" mass="2"/></body>
    <body pos="0.2 0 0"><joint name="screw" axis="0 0 1" damping="1e-5"/>
      <inertial pos="0 0 0" mass="0.01" diaginertia="1e-7 1e-7 1e-7"/></body>
  </worldbody>
  <equality><joint name="thread" joint1="screw" joint2="nut" polycoef="0 20 0 0 0"/></equality>
  <actuator><position joint="screw" kp="0.1" kv="0.002"/></actuator>
  <keyframe><key ctrl="0"/></keyframe></mujoco>"""
"""A nut of 2 kg on a screw of 1e-7 kg m², which turns 20 rad a metre."""

HEAVY = """<mujoco><option timestep="0.002"/>
  <default><joint axis="0 1 0" damping="0.05"/><geom type="capsule" size="0.01" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body><joint name="hand" stiffness="40"/><geom fromto="0 0 0 0.2 0 0" mass="0.1"/></body>
    <body pos="0 0.2 0"><joint name="arm"/><geom fromto="0 0 0 0.3 0 0" mass="0.3"/></body>
  </worldbody>
  <equality><joint name="gear" joint1="arm" joint2="hand" solref="0.1 1"/></equality></mujoco>"""
"""Two levers: a twentieth of the inertia of their motion is less than the lighter one has by itself."""


def checked(tmp_path: Path, text: str):
    (tmp_path / "model.xml").write_text(text)
    return oarlock.check(tmp_path / "model.xml", budget=0, duration=1.0)


def drifts(text: str, duration_s: float = 1.0) -> dict[str, float]:
    """Largest deviation of every coupling, in plain MuJoCo from the first keyframe."""
    model = mujoco.MjModel.from_xml_string(text)
    data, worst = mujoco.MjData(model), np.zeros(model.neq)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(round(duration_s / model.opt.timestep)):
        mujoco.mj_forward(model, data)
        worst = np.maximum(worst, np.abs(data.efc_pos[: data.ne]))
        mujoco.mj_step(model, data)
    return {model.equality(n).name: float(worst[n]) for n in range(model.neq)}


@pytest.mark.parametrize("cables", [False, True])
def test_the_armature_that_light_phalanges_lack_is_named_first(tmp_path, cables):
    found = checked(tmp_path, finger(cables))
    first = found.verdict[0]
    assert first.code == "D1"
    assert first.figures["joints"] == ["j1", "j2", "j3", "j4"]
    given = first.figures["armature"]
    mended = finger(cables)
    for n in range(1, 5):
        mended = mended.replace(f'<joint name="j{n}" ', f'<joint name="j{n}" armature="{given!r}" ')
    before, after = drifts(finger(cables)), drifts(mended)
    assert found.examination.rotors is not None
    for name, left in found.examination.rotors.left.items():
        assert left.largest == pytest.approx(after[name], rel=SAME_RUN)
    assert 2 * after[first.element] < before[first.element]
    told = f"with armature=\"{given:g}\" on 'j1', 'j2', 'j3' and 'j4' it opens by {after[first.element]:#.4g}"
    assert told in first.line
    assert told in found.answer


def test_the_load_hardly_notices_it(tmp_path):
    """Along the one motion of the finger: the motor turns by 1, each phalanx by a half."""
    rotors = checked(tmp_path, finger()).examination.rotors
    model = mujoco.MjModel.from_xml_string(finger())
    data, inertia = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    motion = np.array([1.0, 0.5, 0.5, 0.5, 0.5])
    added = rotors.armature * (motion[1:] ** 2).sum() / (motion @ inertia @ motion)
    assert 0.02 < added <= 0.05
    assert rotors.inertia == pytest.approx(1.0 / model.dof_invweight0.max())


def test_a_screw_that_carries_a_load(tmp_path):
    """Another sort: a hinge that follows a slide; the slide is heavy, and gets none."""
    found = checked(tmp_path, GEARED)
    rotors = found.examination.rotors
    assert (rotors.joints, rotors.unit) == (("screw",), "kg m²")
    assert found.verdict[0].figures["armature"] == rotors.armature
    mended = GEARED.replace('"screw" axis', f'"screw" armature="{rotors.armature!r}" axis')
    assert rotors.left["thread"].largest == pytest.approx(drifts(mended)["thread"], rel=SAME_RUN)
    assert 2 * drifts(mended)["thread"] < drifts(GEARED)["thread"]


@pytest.mark.parametrize("text", [HEAVY, finger(armature=2e-3)], ids=["levers", "geared finger"])
def test_what_has_its_inertia_is_stiffened(tmp_path, text):
    found = checked(tmp_path, text)
    (one,) = (one for one in found.verdict if one.code == "D1")
    assert "armature" not in one.line
    assert found.examination.rotors is None
    assert re.search("armature", found.answer) is None
