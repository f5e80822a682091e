"""Locks that a lint sees, and what is said of them."""

import mujoco
import numpy as np
import oarlock
import pytest
from oarlock.diagnosis.lint.locked import without
from oarlock.mechanics.load import load_model
from seen import CHECK, of_file, of_text, only, runs


@pytest.mark.parametrize(
    ("equalities", "frees", "said"),
    [
        (["a"], ["a"], ["it would move without 'a'"]),
        (["a"], [], []),
        (["a", "b"], ["b"], ["it would move without 'b'"]),
        (["a", "b", "c"], ["a", "c"], ["'a' and 'c' contradict each other: it would move without 'a' or 'c'"]),
        (["a", "b", "c"], ["a", "b", "c"], ["it would move without 'a', 'b' or 'c'"]),
        (["a", "b"], [], ["leaving out one of its equalities does not free it"]),
    ],
)
def test_what_would_have_to_go(equalities, frees, said):
    assert without(equalities, frees) == said


@pytest.mark.parametrize("name", ["tilted_hinge.xml", "locked_cranks.xml"])
def test_what_is_named_frees_it_and_what_is_not_does_not(name):
    """By the rank of plain MuJoCo's rows of one equality less, at the closed pose that the lint took."""
    one = only(of_file(name), "S3")
    assert one.severity is None
    named = one.line.partition("it would move without ")[2].replace("'", "").split(" or ")
    model = load_model(CHECK / name)
    pose = closed(model)

    def freedoms(dropped: int | None) -> int:
        data = mujoco.MjData(model)
        data.qpos[:] = pose
        if dropped is not None:
            data.eq_active[dropped] = 0
        mujoco.mj_forward(model, data)
        if not data.ne:
            return model.nv
        return model.nv - int(np.linalg.matrix_rank(data.efc_J.reshape(-1, model.nv)[: data.ne], tol=1e-6))

    assert freedoms(None) == 0
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_EQUALITY, index) for index in range(model.neq)]
    assert [each for index, each in enumerate(names) if freedoms(index) > 0] == named


def closed(model: mujoco.MjModel) -> np.ndarray:
    """A pose (nq) near the start at which plain MuJoCo's rows are closed, by Newton's method."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(50):
        mujoco.mj_forward(model, data)
        rows = data.efc_J.reshape(-1, model.nv)[: data.ne]
        mujoco.mj_integratePos(model, data.qpos, -np.linalg.pinv(rows, rcond=1e-10) @ data.efc_pos[: data.ne], 1.0)
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-9
    return data.qpos.copy()


# A slot that is closed as if it were a hole.

QUICK = """<mujoco><compiler angle="radian"/><option timestep="0.001" gravity="0 0 0"/>
  <default><geom contype="0" conaffinity="0"/><joint axis="0 1 0" damping="0.01"/></default><worldbody>
  <body name="crank" pos="0 0 0.3"><joint name="crank"/><geom type="capsule" fromto="0 0 0 0.08 0 0" size="0.01"/>
    <site name="pin" pos="0.08 0 0"/></body>
  <body name="lever" pos="0 0.02 0" euler="0 {turn} 0"><joint name="lever"/>
    <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.01"/>{end}</body></worldbody>
  <equality><connect name="pin" site1="pin" site2="place"/></equality>
  <actuator><motor joint="crank"/></actuator><keyframe><key name="go" ctrl="0.3"/></keyframe></mujoco>"""
"""A quick return: the crank's pin at (0.08, 0.3) slides along a lever about the origin."""

PLACE = '<site name="place" pos="{length} -0.02 0"/>'
BLOCK = """<body name="block" pos="{length} -0.02 0"><joint name="block" type="slide" axis="1 0 0" damping="0.1"/>
  <geom size="0.01"/><site name="place"/></body>"""


def quick(end: str) -> str:
    length, turn = float(np.hypot(0.08, 0.3)), -float(np.arctan2(0.3, 0.08))
    return QUICK.format(turn=turn, end=end.format(length=length))


def turned(text: str) -> float:
    """The most that the crank turns in a second of plain MuJoCo."""
    return max(abs(float(data.qpos[0])) for _, data in runs(text, 1.0))


def test_the_directions_along_which_a_pin_has_to_slide():
    """With a block that slides so the crank turns in plain MuJoCo, further than a pin's softness lets it."""
    one = only(of_text(quick(PLACE)), "S3")
    assert one.severity == "warning"
    slots = one.line.partition("it would move without 'pin', or if its pin slid ")[2]
    assert "along x of 'crank' or 'lever'" in slots
    assert "along y" not in slots
    assert slots.endswith(", as in a slot")
    assert turned(quick(PLACE)) < 0.1
    assert turned(quick(BLOCK)) > 1.0


def test_a_check_says_it_too(tmp_path):
    path = tmp_path / "quick.xml"
    path.write_text(quick(PLACE))
    (one,) = [one for one in oarlock.check(path, budget=0, duration=0.1).verdict if one.code == "S3"]
    assert "along x of 'crank' or 'lever'" in one.line


CHAIN = """<mujoco>
  <default><geom type="capsule" size=".01" mass=".2" contype="0" conaffinity="0"/><joint axis="0 1 0"/></default>
  <worldbody>
    <body><joint name="motor"/><geom fromto="0 0 0 .2 0 0"/>
      <body name="second" pos=".2 0 0"><joint name="elbow"/><geom fromto="0 0 0 .2 0 .1"/>
        <body pos=".2 0 .1"><joint name="tip"/><geom fromto="0 0 0 .1 0 -.1"/>
          <body pos=".1 0 -.1"><joint name="rod"/><geom fromto="0 0 0 .1 0 -.2"/>
            <body name="tail" pos=".1 0 -.2"><joint name="tail"/><geom fromto="0 0 0 .1 0 .1"/></body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality>
    {pin}<connect name="ground" body1="tail" anchor=".1 0 .1"/>
  </equality>
  <actuator><motor joint="{driven}"/></actuator>
</mujoco>"""
"""Five links whose last one is pinned to the ground, and of which a pin may take the first two out."""


@pytest.mark.parametrize(
    ("pinned", "driven", "held"), [(True, "motor", True), (True, "rod", False), (False, "motor", False)]
)
def test_what_is_driven_and_held_in_a_group_that_moves(pinned, driven, held):
    pin = '<connect name="pin" body1="second" anchor=".2 0 .1"/>' if pinned else ""
    text = CHAIN.format(pin=pin, driven=driven)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rows = data.efc_J.reshape(-1, model.nv)[: data.ne]
    rank = np.linalg.matrix_rank(rows, tol=1e-9)
    free = np.linalg.svd(rows)[2][rank:]
    assert len(free)
    assert (np.abs(free[:, model.joint(driven).dofadr[0]]).max() < 1e-9) == held
    found = [one for one in of_text(text) if one.code == "S3"]
    assert [(one.element, one.figures["held"]) for one in found] == ([("pin", ["motor"])] if held else [])


def test_a_coupling_to_a_constant_holds_on_purpose():
    text = CHAIN.format(pin='<joint name="brake" joint1="motor" polycoef="0 0 0 0 0"/>', driven="motor")
    assert "S3" not in {one.code for one in of_text(text)}


# Structures: rigid on purpose, and not by a small error.

TRUSS = """<mujoco><compiler angle="radian"/><option timestep="{h}" integrator="implicitfast"/>
  <default><geom type="capsule" size="0.02" contype="0" conaffinity="0"/><joint axis="0 1 0" damping="0.2"/></default>
  <worldbody>
  <body name="left"><joint name="left"/><geom fromto="0 0 0 0.4 0 0.3" mass="0.5"/>
    <geom type="sphere" pos="0.4 0 0.3" size="0.08" mass="60"/><site name="apex" pos="0.4 0 0.3"/></body>
  <body name="right" pos="{foot} 0 0"><joint name="right"/><geom fromto="0 0 0 {back} 0 0.3" mass="0.5"/>
    <site name="top" pos="{back} 0 0.3"/></body></worldbody>
  <equality><connect name="peak" site1="apex" site2="top" {given}/></equality>{drive}</mujoco>"""


def truss(foot=0.9, h=0.004, given="", drive="") -> str:
    return TRUSS.format(foot=foot, back=0.4 - foot, h=h, given=given, drive=drive)


def test_a_structure_that_nothing_drives_is_a_note_however_heavy_it_is():
    one = only(of_text(truss()), "S3")
    assert one.severity == "note"
    assert one.figures["kept"] < 0.05  # in the metric of the masses


def test_what_is_driven_is_to_move_and_is_a_warning():
    one = only(of_text(truss(drive='<actuator><motor joint="left"/></actuator>')), "S3")
    assert one.severity == "warning"


def test_a_truss_that_is_nearly_flat_may_be_locked_by_a_small_error():
    flat = truss().replace('0.3"', '0.003"')
    assert only(of_text(flat), "S3").severity is None


def test_the_floor_of_a_solref_comes_before_the_lock_where_it_opens_the_structure(tmp_path):
    """In plain MuJoCo a shorter timestep alone takes nearly all of it away, the solref as it was."""
    path = tmp_path / "truss.xml"
    path.write_text(truss(given='solref="0.0002 1"'))
    checked = oarlock.check(path, duration=1.0)
    assert checked.verdict[0].code == "T4"
    assert "is taken as 0.008" in checked.answer
    assert only(checked.verdict, "S3").severity == "note"
    fine = truss(h=0.0001, given='solref="0.0002 1"')
    assert gap(fine, 1.0) < 0.01 * gap(path.read_text(), 1.0)
    fix = checked.fix(tmp_path / "fixed.xml")
    assert fix.reached
    assert gap((tmp_path / "fixed.xml").read_text(), 1.0) < 0.01 * gap(path.read_text(), 1.0)


def gap(text: str, duration_s: float) -> float:
    """How far the sites of the first equality stand apart at the most in plain MuJoCo."""
    most = 0.0
    for _, data in runs(text, duration_s):
        most = max(most, float(np.linalg.norm(data.site_xpos[0] - data.site_xpos[1])))
    return most


FRAME = """<mujoco><option timestep="0.001" integrator="implicitfast"/>
  <default><geom type="box" density="1500" contype="0" conaffinity="0"/><joint axis="1 0 0" damping="0.3"/></default>
  <worldbody>
  <body name="near" pos="0 -0.3 0"><joint name="near"/><geom size="0.02 0.02 0.3" pos="0 0 0.3"/>
    <site name="near" pos="0 0 0.6"/></body>
  <body name="far" pos="0 0.3 0"><joint name="far"/><geom size="0.02 0.02 0.3" pos="0 0 0.3"/>
    <site name="far" pos="0 0 0.6"/></body>
  <body name="beam" pos="0 0 0.6"><freejoint/><geom size="0.02 0.3 0.02" mass="5"/>
    <site name="one" pos="0 -0.3 0"/><site name="two" pos="0 0.3 0"/></body></worldbody>
  <equality><weld name="first" site1="near" site2="one" torquescale="{scale}" solref="0.005 1"/>
    <weld name="second" site1="far" site2="two" torquescale="{scale}" solref="0.005 1"/></equality>
  <keyframe><key qpos="0 0 0 0 0.6 1 0 0 0" qvel="0.4 0.4 0 -0.24 0 0 0 0"/></keyframe></mujoco>"""


def test_a_frame_whose_corners_give_way_is_laid_to_its_torquescale(tmp_path):
    """And the push that shows it stays in the keyframe."""
    path = tmp_path / "frame.xml"
    path.write_text(FRAME.format(scale=0.001))
    checked = oarlock.check(path, duration=1.0)
    lock = only(checked.verdict, "S3")
    assert lock.severity == "note"
    assert "contradict" not in lock.line
    assert 'torquescale="0.001"' in checked.answer
    leans = [
        max(abs(float(data.qpos[0])) for _, data in runs(FRAME.format(scale=scale), 1.0, 0)) for scale in (1e-3, 1)
    ]
    assert leans[1] < 0.05 * leans[0]
    checked.fix(tmp_path / "fixed.xml")
    fixed = mujoco.MjModel.from_xml_path(str(tmp_path / "fixed.xml"))
    np.testing.assert_allclose(fixed.key_qvel[0, :2], [0.4, 0.4])
