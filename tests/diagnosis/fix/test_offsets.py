"""Couplings that the start contradicts: whether a fix moves the pose or the constant, by the rule of ``offsets``."""

import math
from pathlib import Path

import mujoco
import numpy as np
import oarlock
import pytest

CLOSED = 1e-9
"""m or rad: what the digits of a written offset may leave of an opening."""

HALF = 0.5
"""Of a drift: what plain MuJoCo has to show of a constant that is named."""


def fixed(source: Path, text: str, **asked):
    source.write_text(text)
    checked = oarlock.check(source, **({"duration": 0.5, "target": 1e-4} | asked))
    return checked.fix(source.with_name("fixed.xml")), mujoco.MjModel.from_xml_path(str(source.with_name("fixed.xml")))


def offs(model: mujoco.MjModel, key: int | None = 0) -> np.ndarray:
    """Deviations of all rows of equalities at a keyframe, in plain MuJoCo."""
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, key)
    mujoco.mj_forward(model, data)
    return data.efc_pos[: data.ne].copy()


def drift(model: mujoco.MjModel, polycoef=None, duration_s: float = 0.5) -> float:
    """Largest deviation of a row over a run from the first keyframe, in plain MuJoCo."""
    data, worst = mujoco.MjData(model), 0.0
    if polycoef is not None:
        model.eq_data[0, :5] = polycoef
    mujoco.mj_resetDataKeyframe(model, data, 0)
    while data.time < duration_s:
        mujoco.mj_step(model, data)
        worst = max(worst, float(np.abs(data.efc_pos[: data.ne]).max()))
    return worst


def constants(fix) -> list[str]:
    return [one.what for one in fix.changes if "polycoef" in one.what]


def left_out(fix) -> list[str]:
    return [said for said in fix.left_out if "polycoef" in said]


JAWS = """
<mujoco>
  <option timestep="0.002"/>
  <default><joint type="slide" axis="1 0 0" damping="20"/>
    <geom size="0.02" mass="0.5" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body><joint name="near" range="-0.1 0.1"/><geom/></body>
    <body pos="0 0.3 0"><joint name="far" range="-0.1 0.1"/><geom/></body>
  </worldbody>
  <!-- 40 mm apart -->
  <equality><joint name="together" joint1="far" joint2="near" polycoef="0.6 0.5 0 0 0"/></equality>
  <actuator><position joint="near" kp="50" kv="5"/></actuator>
  <keyframe><key qpos="0.02 0.05" ctrl="0.02"/></keyframe>
</mujoco>
"""


def test_a_constant_that_the_ranges_do_not_admit_is_written_anew(tmp_path):
    fix, model = fixed(tmp_path / "jaws.xml", JAWS)
    assert (tmp_path / "fixed.xml").read_text() == JAWS.replace('"0.6 0.5 0 0 0"', '"0.04 0.5 0 0 0"')
    (said,) = constants(fix)
    assert said.startswith('polycoef "0.04 0.5 0 0 0" of \'together\' in place of "0.6 0.5 0 0 0", for ')
    assert "inside of all ranges" in said
    assert fix.reached, fix.reason
    assert set(fix.mended) >= {"S4"}
    assert np.abs(offs(model)).max() <= CLOSED
    assert drift(model) <= 1e-4 < HALF * drift(mujoco.MjModel.from_xml_string(JAWS))
    assert [one.before for one in fix.lines] == [JAWS.splitlines()[10]]
    assert 'polycoef="0.04 0.5 0 0 0"' in fix.document()["lines"][0]["after"]


SERVOS = """
<mujoco>
  <option timestep="0.001"/>
  <default><joint axis="0 1 0" damping="0.5"/><geom type="capsule" size="0.01" mass="0.2" contype="0" conaffinity="0"/>
    <position kp="300" kv="3"/></default>
  <worldbody>
    <body><joint name="left"/><geom fromto="0 0 0 0.2 0 0"/></body>
    <body pos="0 0.2 0"><joint name="right"/><geom fromto="0 0 0 0.2 0 0"/></body>
  </worldbody>
  <equality><joint name="gear" joint1="right" joint2="left" polycoef="0.3 1 0 0 0" solref="0.05 1"/></equality>
  <actuator><position joint="left"/><position joint="right"/></actuator>
  <keyframe><key qpos="0.2 0.25" ctrl="0.2 0.25"/></keyframe>
</mujoco>
"""


def test_a_constant_that_servos_hold_off_is_written_anew(tmp_path):
    """Keyframe and controls agree with one another: the closed pose would be pulled open again."""
    fix, model = fixed(tmp_path / "model.xml", SERVOS, duration=1.0, target=1e-3)
    (said,) = constants(fix)
    assert said.startswith("polycoef \"0.05 1 0 0 0\" of 'gear'")
    assert "S4" in fix.mended
    assert model.key_qpos[0].tolist() == [0.2, 0.25]
    source = mujoco.MjModel.from_xml_string(SERVOS)
    closed = mujoco.MjModel.from_xml_string(SERVOS)
    closed.key_qpos[0] = [0.075, 0.375]  # the nearest: both turn by half
    assert np.abs(offs(closed)).max() <= CLOSED
    assert drift(source, [0.05, 1, 0, 0, 0], 1.0) < HALF * drift(closed, None, 1.0)


CABLES = """
<mujoco>
  <compiler autolimits="true"/>
  <option timestep="0.001"/>
  <default><joint axis="0 1 0" damping="0.3" range="-1 1"/><geom type="capsule" size="0.01" mass="0.2" contype="0"
    conaffinity="0"/></default>
  <worldbody>
    <site name="a" pos="0 0 0.5"/><site name="b" pos="1 0 0.5"/>
    <body><joint name="left"/><geom fromto="0 0 0 0.3 0 0"/><site name="l" pos="0.3 0 0"/></body>
    <body pos="1 0 0"><joint name="right"/><geom fromto="0 0 0 0.3 0 0"/><site name="r" pos="0.3 0 0"/></body>
  </worldbody>
  <tendon><spatial name="one"><site site="a"/><site site="l"/></spatial>
    <spatial name="two"><site site="b"/><site site="r"/></spatial></tendon>
  <equality><tendon name="tied" tendon1="one" tendon2="two" polycoef="{offset} 1 0 0 0"/></equality>
  <keyframe><key qpos="0.1 0.1"/></keyframe>
</mujoco>
"""


def test_the_same_of_a_tendon_coupling(tmp_path):
    text = CABLES.format(offset=0.7)
    fix, model = fixed(tmp_path / "model.xml", text, duration=0.3)
    (said,) = constants(fix)
    assert "of 'tied' in place of \"0.7 1 0 0 0\"" in said
    assert model.eq_data[0, 0] == pytest.approx(0.0, abs=CLOSED)
    assert model.key_qpos[0].tolist() == [0.1, 0.1]
    assert fix.reached, fix.reason
    assert drift(model, duration_s=0.3) <= 1e-4


def test_a_tendon_constant_that_is_a_whole_length_is_written_from_the_drawn_one(tmp_path):
    """The second is tied to a length of 0.6 m; MuJoCo counts from the 0.5831 m that are drawn."""
    drawn = math.hypot(0.5, 0.3)
    text = CABLES.format(offset=0.0).replace(' tendon2="two" polycoef="0.0 1 0 0 0"', f' polycoef="{drawn:.4f}"')
    text = text.replace('qpos="0.1 0.1"', 'qpos="0 0"')
    fix, model = fixed(tmp_path / "model.xml", text, duration=0.2)
    (said,) = constants(fix)
    assert "A2" in said
    assert "A2" in fix.mended
    assert abs(offs(model)[0]) <= 1e-4
    assert abs(model.eq_data[0, 0]) <= 1e-4


def test_degrees_become_radians(tmp_path):
    text = SERVOS.replace("0.3 1 0 0 0", "20 1 0 0 0").replace("0.2 0.25", f"0.2 {0.2 + math.radians(20):.7f}")
    fix, model = fixed(tmp_path / "model.xml", text, duration=0.3, target=1e-3)
    (said,) = constants(fix)
    assert "A2" in said
    assert model.eq_data[0, 0] == pytest.approx(math.radians(20), abs=1e-7)
    assert "A2" in fix.mended
    assert fix.reached, fix.reason


# The pose, and not the constant.

FINGERS = """
<mujoco>
  <option timestep="0.001"/>
  <default><joint axis="0 1 0" damping="0.05"/><geom type="capsule" size="0.01" mass="0.05" contype="0"
    conaffinity="0"/></default>
  <worldbody>
    {bodies}
  </worldbody>
  <equality>
    {couplings}
  </equality>
  <keyframe>
    <key name="home" qpos="{home}"/>
    {more}
  </keyframe>
</mujoco>
"""
TOLD = (0.1, 0.25, -0.1)
"""Keyframe: where the leading joints of the fingers stand."""


def follows(offsets, further=0.0) -> list[float]:
    """Where the second hinges stand for their couplings to be closed."""
    return [0.5 * (lead + further) + offset for lead, offset in zip(TOLD, offsets, strict=True)]


def key(follow, further=0.0) -> str:
    return " ".join(f"{lead + further} {place:.10g}" for lead, place in zip(TOLD, follow, strict=True))


def fingers(offsets, follow, more="") -> str:
    """Each finger has two hinges; the second is coupled to the first with polycoef="offset 0.5 0 0 0"."""
    bodies = "\n    ".join(
        f'<body pos="0 {n * 0.1} 0"><joint name="p{n}"/><geom fromto="0 0 0 0.1 0 0"/>'
        f'<body pos="0.1 0 0"><joint name="d{n}"/><geom fromto="0 0 0 0.1 0 0"/></body></body>'
        for n in range(len(offsets))
    )
    couplings = "\n    ".join(
        f'<joint name="c{n}" joint1="d{n}" joint2="p{n}" polycoef="{offset} 0.5 0 0 0"/>'
        for n, offset in enumerate(offsets)
    )
    return FINGERS.format(bodies=bodies, couplings=couplings, home=key(follow), more=more)


def test_a_keyframe_with_one_joint_off_is_closed_and_no_constant_is_touched(tmp_path):
    """Three fingers of one sort; one joint of one of them stands wrong."""
    follow = follows([0.2] * 3)
    follow[1] += 0.3
    fix, model = fixed(tmp_path / "model.xml", fingers([0.2] * 3, follow), duration=0.2, target=1e-3)
    assert constants(fix) == []
    (said,) = left_out(fix)
    assert "'c1'" in said
    assert "'c0', which has the same polycoef, holds at the start" in said
    np.testing.assert_array_equal(model.eq_data[:, 0], 0.2)
    assert np.abs(offs(model)).max() <= CLOSED
    assert fix.reached, fix.reason


def test_another_keyframe_that_holds_says_that_the_first_is_off(tmp_path):
    offsets = [0.2, 0.7, 0.1]
    follow = follows(offsets)
    follow[1] += 0.3
    text = fingers(offsets, follow, f'<key name="bent" qpos="{key(follows(offsets, 0.3), 0.3)}"/>')
    fix, model = fixed(tmp_path / "model.xml", text, duration=0.2, target=1e-3)
    assert constants(fix) == []
    (said,) = left_out(fix)
    assert "keyframe 'bent' meets it as it is written" in said
    assert model.eq_data[:, 0].tolist() == [0.2, 0.7, 0.1]


def test_keyframes_that_all_miss_by_the_same_say_that_the_constant_is_off(tmp_path):
    """The closed pose would do as well; in two poses the second joint stands 0.3 rad from where it is to be."""
    meant = [0.2, 0.4, 0.1]
    text = fingers([0.2, 0.7, 0.1], follows(meant), f'<key name="bent" qpos="{key(follows(meant, 0.3), 0.3)}"/>')
    fix, model = fixed(tmp_path / "model.xml", text, duration=0.2, target=1e-3)
    (said,) = constants(fix)
    assert "keyframes 'home' and 'bent'" in said
    assert model.eq_data[:, 0].tolist() == [0.2, 0.4, 0.1]
    assert max(np.abs(offs(model, key)).max() for key in (0, 1)) <= CLOSED
    assert fix.reached, fix.reason


def test_a_pose_that_holds_once_it_is_closed_is_what_is_changed(tmp_path):
    """One keyframe, one coupling of its sort: nothing speaks against what is written."""
    text = fingers([0.2, 0.7, 0.1], follows([0.2, 0.4, 0.1]))
    fix, model = fixed(tmp_path / "model.xml", text, duration=0.2, target=1e-3)
    assert constants(fix) == []
    assert model.eq_data[:, 0].tolist() == [0.2, 0.7, 0.1]
    (said,) = left_out(fix)
    assert "the closed pose holds" in said


def test_no_constant_hides_a_load(tmp_path):
    """A lever that sags under its weight stays open for good: an offset would hold under this load alone."""
    text = SERVOS.replace('polycoef="0.3 1 0 0 0" solref="0.05 1"', 'solref="0.2 1"')
    text = text.replace('<joint name="right"/>', '<joint name="right"/><geom fromto="0 0 0 0.4 0 0"/>')
    text = text.replace('<position joint="right"/>', "").replace('"0.2 0.25"', '"0 0.3"', 1).replace("0.2 0.25", "0")
    fix, model = fixed(tmp_path / "model.xml", text, duration=1.0, target=1e-3)
    assert constants(fix) == []
    assert model.eq_data[0, :5].tolist() == [0, 1, 0, 0, 0]


def test_a_coupling_that_is_a_copy_has_no_place_for_a_constant(tmp_path):
    text = JAWS.replace("<worldbody>", '<worldbody><replicate count="2" offset="1 0 0">')
    text = text.replace("</worldbody>", "</replicate></worldbody>").replace(
        'position joint="near"', 'position joint="near0"'
    )
    text = text.replace('qpos="0.02 0.05"', 'qpos="0.02 0.05 0.02 0.05"')
    fix, _ = fixed(tmp_path / "model.xml", text)
    assert constants(fix) == []
    assert any("is a copy of one in the file" in said for said in left_out(fix))
