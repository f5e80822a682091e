"""Lints that say what was meant: anchors in another frame, weld for pin, swapped joints, a solid axle, mm, relpose."""

import mujoco
import numpy as np
import oarlock
import pytest

HEAD = """<mujoco><compiler angle="radian"/><option timestep="0.001"/>
  <default><geom type="capsule" size="0.01" contype="0" conaffinity="0" density="900"/>
    <joint axis="0 1 0" damping="0.02"/></default>"""

BARS = (
    HEAD
    + """<worldbody>
  <body name="crank" pos="0.1 0 0.4"><joint name="crank"/><geom fromto="0 0 0 0 0 0.1"/>
    <body name="rod" pos="0 0 0.1"><joint name="rod"/><geom fromto="0 0 0 0.3 0 0.05"/></body></body>
  <body name="rocker" pos="0.4 0 0.4"><joint name="rocker"/><geom fromto="0 0 0 0 0 0.15"/></body></worldbody>
  <equality><connect name="pin" body1="rod" body2="rocker" anchor="{anchor}"/></equality></mujoco>"""
)

LEG = (
    HEAD
    + """<worldbody>
  <body name="hip_f" pos="0.03 0 0.4"><joint name="f"/><geom fromto="0 0 0 0.07 0 -0.05"/>
    <body name="shin_f" pos="0.07 0 -0.05"><joint name="knee_f"/><geom fromto="0 0 0 -0.1 0 -0.15"/></body></body>
  <body name="hip_b" pos="-0.03 0 0.4"><joint name="b"/><geom fromto="0 0 0 -0.07 0 -0.05"/>
    <body name="shin_b" pos="-0.07 0 -0.05"><joint name="knee_b"/><geom fromto="0 0 0 0.1 0 -0.15"/></body></body>
  </worldbody><equality>{paw}</equality>
  <actuator><position name="f" joint="f" kp="30" kv="1"/>{second}</actuator></mujoco>"""
)
WELDED = '<weld name="paw" body1="shin_f" body2="shin_b" anchor="0.1 0 -0.15"/>'
SECOND = '<position name="b" joint="b" kp="30" kv="1"/>'

FINGER = (
    HEAD
    + """<worldbody>
  <body name="near" pos="0 0 0.3"><joint name="near"/><geom fromto="0 0 0 0.04 0 0"/>
    <body name="mid" pos="0.04 0 0"><joint name="mid"/><geom fromto="0 0 0 0.03 0 0"/>
      <body name="far" pos="0.03 0 0"><joint name="far"/><geom fromto="0 0 0 0.02 0 0"/></body>
    </body></body></worldbody>
  <equality><joint name="m" joint1="{a}" joint2="{b}" polycoef="0 {ratio} 0 0 0"/></equality>
  <actuator><position name="servo" joint="near" kp="3"/></actuator></mujoco>"""
)

AXLE = (
    HEAD
    + """<worldbody>
  <body name="shaft"><joint name="shaft"/><geom fromto="0 -0.1 0 0 0.1 0"/></body>
  <body name="l" pos="0 0.5 0"><joint name="l"/><geom fromto="0 -0.1 0 0 0.1 0" size="0.2"/></body>
  <body name="r" pos="0 -0.5 0"><joint name="r"/><geom fromto="0 -0.1 0 0 0.1 0" size="0.2"/></body></worldbody>
  <tendon><fixed name="mean"><joint joint="l" coef="0.5"/>
    <joint joint="r" coef="0.5"/>
    <joint joint="shaft" coef="-1"/></fixed></tendon><equality>{held}</equality>
  <actuator><motor name="m" joint="shaft"/></actuator></mujoco>"""
)
SOLID = '<joint name="to_l" joint1="l" joint2="shaft"/><joint name="to_r" joint1="r" joint2="shaft"/>'

HELD = """<mujoco><worldbody>
  <body name="goal" mocap="true" pos="0.2 0 0.5"/>
  <body name="tool" pos="0.2 0 0.5"><freejoint/><geom type="box" size="0.03 0.03 0.03" mass="0.5"/>
    <body name="jaw" pos="0.04 0 0"><joint name="jaw" axis="0 0 1"/>
      <geom type="box" size="0.02 0.01 0.01" mass="0.1"/></body>
  </body></worldbody><equality><weld name="hold" body1="goal" body2="tool" {relpose}/></equality></mujoco>"""


def remarks(text: str, code: str, tmp_path, lint: bool = True):
    file = tmp_path / "m.xml"
    file.write_text(text)
    checked = oarlock.check(file, lint=True) if lint else oarlock.check(file, budget=0, duration=0.5)
    return [one for one in checked.verdict if one.code == code]


@pytest.mark.parametrize("anchor", ["0.4 0 0.55", "0 0 0.15"])
def test_an_anchor_in_the_frame_of_the_world_or_of_the_second_body(anchor, tmp_path):
    (one,) = remarks(BARS.format(anchor=anchor), "S5", tmp_path)
    assert one.figures["wanted"] == pytest.approx([0.3, 0.0, 0.05], abs=1e-9)
    assert 'anchor="0.3 0 0.05"' in one.line
    model = mujoco.MjModel.from_xml_string(BARS.format(anchor="0.3 0 0.05"))
    assert model.eq_data[0, 3:6] == pytest.approx([0.0, 0.0, 0.15], abs=1e-9)


def test_an_anchor_that_is_right_is_not_named(tmp_path):
    assert not remarks(BARS.format(anchor="0.3 0 0.05"), "S5", tmp_path)


def test_a_weld_that_takes_a_freedom_from_two_drives(tmp_path):
    (one,) = remarks(LEG.format(paw=WELDED, second=SECOND), "L10", tmp_path)
    assert (one.figures["dof"], one.figures["dof_with_pin"]) == (1, 2)
    written = one.line[one.line.index("<connect") :]
    model = mujoco.MjModel.from_xml_string(LEG.format(paw=written, second=SECOND))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-6
    rows = np.zeros((data.nefc, model.nv))
    if mujoco.mj_isSparse(model):
        mujoco.mju_sparse2dense(rows, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
    else:
        rows[:] = data.efc_J[: data.nefc * model.nv].reshape(data.nefc, model.nv)
    assert model.nv - np.linalg.matrix_rank(rows[: data.ne], tol=1e-6) == 2


def test_a_weld_that_leaves_what_is_driven_is_not_named(tmp_path):
    assert not remarks(LEG.format(paw=WELDED, second=""), "L10", tmp_path)
    connect = '<connect name="paw" body1="shin_f" body2="shin_b" anchor="-0.1 0 -0.15"/>'
    assert not remarks(LEG.format(paw=connect, second=SECOND), "L10", tmp_path)


def test_a_driven_joint_that_is_said_to_follow_what_it_carries(tmp_path):
    (one,) = remarks(FINGER.format(a="near", b="mid", ratio="1.4"), "L13", tmp_path)
    assert one.element == "m"
    assert 'joint1="mid" joint2="near"' in one.line


@pytest.mark.parametrize(("a", "b", "ratio"), [("mid", "near", "1.4"), ("near", "mid", "1"), ("far", "mid", "0.7")])
def test_couplings_the_usual_way_round_are_not_named(a, b, ratio, tmp_path):
    assert not remarks(FINGER.format(a=a, b=b, ratio=ratio), "L13", tmp_path)


def test_a_differential_that_is_a_solid_axle(tmp_path):
    (one,) = remarks(AXLE.format(held=SOLID), "L15", tmp_path)
    assert one.element == "mean"
    assert one.figures["also"] == ["to_l", "to_r"]
    kept = '<tendon name="d" tendon1="mean"/>'
    assert not remarks(AXLE.format(held=kept), "L15", tmp_path)
    assert not remarks(AXLE.format(held=SOLID + kept), "L15", tmp_path)


def test_links_of_hundreds_of_metres(tmp_path):
    text = BARS.format(anchor="300 0 50").replace('size="0.01"', 'size="10" mass="1"').replace(' density="900"', "")
    for given, wanted in (("0.1 0 0.4", "100 0 400"), ("0.4 0 0.4", "400 0 400"), ("0 0 0.1", "0 0 100")):
        text = text.replace(f'pos="{given}"', f'pos="{wanted}"')
    for given, wanted in (("0 0 0 0 0 0.1", "0 0 0 0 0 100"), ("0 0 0 0.3 0 0.05", "0 0 0 300 0 50")):
        text = text.replace(f'fromto="{given}"', f'fromto="{wanted}"')
    text = text.replace('fromto="0 0 0 0 0 0.15"', 'fromto="0 0 0 0 0 150"')
    (one,) = remarks(text, "A2", tmp_path)
    assert one.severity == "error"
    assert "mm were meant" in one.line


def test_a_relpose_that_holds_what_is_drawn_together_apart(tmp_path):
    (one,) = remarks(HELD.format(relpose='relpose="0 0 0.6 1 0 0 0"'), "S7", tmp_path, lint=False)
    assert one.figures["opening"] == pytest.approx(0.6, rel=1e-6)
    assert "without relpose it is closed as drawn" in one.line
    assert not remarks(HELD.format(relpose=""), "S7", tmp_path, lint=False)


def test_a_rope_that_is_asked_for_what_it_cannot_have(tmp_path):
    text = """<mujoco><worldbody><site name="hook" pos="0 0 1"/>
      <body name="arm" pos="0.15 0 0.5"><joint name="arm" axis="0 1 0" damping="1"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.01" mass="0.3" contype="0" conaffinity="0"/>
        <site name="end" pos="0.3 0 0"/></body></worldbody>
      <tendon><spatial name="rope"><site site="hook"/><site site="end"/></spatial></tendon>
      <equality><tendon name="length" tendon1="rope" polycoef="{offset} 0 0 0 0"/></equality></mujoco>"""
    (one,) = remarks(text.format(offset="0.25"), "S2", tmp_path, lint=False)
    told = float(one.line.split('polycoef="')[1].split()[0])
    longest = np.hypot(0.15, 0.5) + 0.3
    assert told == pytest.approx(longest - np.hypot(0.45, 0.5), abs=1e-5)
    model = mujoco.MjModel.from_xml_string(text.format(offset=told))
    data = mujoco.MjData(model)
    for _ in range(3000):
        mujoco.mj_step(model, data)
    assert abs(data.ten_length[0] - longest) < 2e-3
