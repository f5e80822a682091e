"""The start: closed from anywhere near, or what stands in the way; locked or free; written out as a keyframe."""

import shutil
import struct
import zlib

import mujoco
import numpy as np
import pytest
from mechanisms import four_bar, parallelogram, write_model
from oarlock import InputError, load_case, model_names
from oarlock.diagnosis.edit.keyframe import write_keyframe
from oarlock.diagnosis.loops.poses import nearest_closed
from oarlock.mechanics.load import load_model
from oarlock.mechanics.mjcf import differences
from oarlock.stepping.start import consistent_start
from places import FIXTURES

SEEDS = 20
DISTURBED = 0.5
"""rad, and m on slides: the largest change of a coordinate."""

LEFT = 1e-10
"""m or rad. What closing leaves at most: 100 times its own bound, where long mechanisms cannot do better."""

RATES = 1e-10
"""m/s and rad/s, of velocities around 1: rounding over the smallest singular value, twice corrected."""

NEAREST = 1e-9
"""J. A change of velocity against every admitted one: rounding of energies of some joules (10 in the boat)."""

SHORT = 1e-6
"""m. A gap at its least is flat: an error of 1e-7 rad in the pose makes 1e-14 of it, and the minimiser stops there."""

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def compiled(xml):
    return mujoco.MjModel.from_xml_string(xml)


def fixture(name):
    return load_model(FIXTURES / "check" / f"{name}.xml")


def started(name):
    case = load_case(name)
    model = load_model(case.model_path, case.parameters)
    dense = load_model(case.model_path, case.parameters)
    dense.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    return model, consistent_start(dense, case)


def disturbed(model, qpos, seed):
    pose = qpos.copy()
    change = np.random.default_rng(seed).uniform(-DISTURBED, DISTURBED, model.nv)
    mujoco.mj_integratePos(model, pose, change, 1.0)
    return pose


# Closed.


@pytest.mark.parametrize("name", model_names())
def test_every_model_is_closed_from_disturbed_poses(name):
    model, start = started(name)
    dof = load_case(name).expected()["dof"]
    data = mujoco.MjData(model)
    for seed in range(SEEDS):
        given = disturbed(model, start.qpos, seed)
        speed = np.random.default_rng(seed).normal(size=model.nv)
        pose = nearest_closed(model, given, speed)
        assert pose.status == "closed"
        least = 5e-5 if name == "cable_finger" else 1e-3  # it has pulleys of 10 mm
        assert max(opening.largest for opening in pose.openings) > least
        assert max(opening.largest for opening in pose.left) <= LEFT
        assert pose.culprits == ()
        assert pose.loops.dof == dof
        assert not any(one.locked or one.singular for one in pose.mobility)
        # As MuJoCo sees it, without anything of ours.
        data.qpos[:], data.qvel[:] = pose.qpos, pose.qvel
        mujoco.mj_forward(model, data)
        assert np.abs(data.efc_pos[: data.ne]).max() <= LEFT
        assert np.abs(data.efc_vel[: data.ne]).max() <= RATES * (1 + np.abs(pose.qvel).max())
        assert np.abs(pose.qvel).max() > 1e-3


@pytest.mark.parametrize("name", ["boat", "floating_four_bar", "ring", "n_four_bar"])
def test_a_consistent_start_stays(name):
    model, start = started(name)
    pose = nearest_closed(model, start.qpos, start.qvel)
    assert pose.status == "consistent"
    assert (pose.moved, pose.moved_joint) == (0.0, "")
    assert pose.moved_speed <= 1e-12
    again = nearest_closed(model, pose.qpos, pose.qvel)
    np.testing.assert_array_equal(again.qpos, pose.qpos)


@pytest.mark.parametrize("name", ["boat", "delta", "floating_four_bar"])
def test_the_velocities_are_the_nearest_in_kinetic_energy(name):
    model, start = started(name)
    given = np.random.default_rng(3).normal(size=model.nv)
    pose = nearest_closed(model, start.qpos, given)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    data.qpos[:] = pose.qpos
    mujoco.mj_fwdPosition(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    rows = data.efc_J[: data.ne * model.nv].reshape(data.ne, model.nv)
    admitted = np.linalg.svd(rows)[2][pose.loops.rank :]
    assert np.abs(admitted @ mass @ (pose.qvel - given)).max() <= NEAREST
    assert pose.moved_speed > 0.1


def test_a_dead_end_is_left():
    """An arm that is stretched and too long: no row can pull it to the wall, but from bent poses it gets there."""
    pose = nearest_closed(compiled(STRETCHED.replace('pos="1 0 0"', 'pos="0.9 0 0"')))
    assert pose.detour
    assert pose.closed
    # Two sides of 0.5 m over a base of 0.9 m, folded either way.
    assert np.abs(pose.qpos) == pytest.approx([np.arccos(0.9), 2 * np.arccos(0.9)])


# How far open.


def test_openings_are_distances_and_angles():
    half = 0.15
    xml = f"""<mujoco><worldbody><body name="a" pos="0.3 0.4 0" quat="{np.cos(half)} 0 0 {np.sin(half)}"><freejoint/>
      <geom size="0.1"/></body><body name="c" pos="2 0 0"><joint name="slide" type="slide"/><geom size="0.1"/></body>
      </worldbody><equality><weld name="seam" body1="a" relpose="0 0 0 1 0 0 0" torquescale="0.25"/>
      <joint name="held" joint1="slide" polycoef="0.2 0 0 0 0"/></equality></mujoco>"""
    pose = nearest_closed(compiled(xml))
    seam, held = pose.openings
    assert (seam.equality, seam.metres) == ("seam", pytest.approx(0.5))
    assert seam.radians == pytest.approx(2 * half)
    assert (held.metres, held.radians) == (pytest.approx(0.2), None)
    assert pose.moved_joint != ""
    assert not pose.consistent


def test_speeds_are_those_of_the_points():
    model = compiled(four_bar())
    pose = nearest_closed(model, qvel=np.array([1.0, 0.0, 0.0]))
    # The crank and what it carries turn at 1 rad/s: the pin is √(0.5² + 0.5²) m away.
    assert pose.speeds[0].metres == pytest.approx(np.hypot(0.5, 0.5))
    assert pose.status == "closed"  # open in velocity only
    assert pose.moved == 0.0
    assert pose.moved_speed > 0.1


# What stands in the way.


@pytest.mark.parametrize("seed", range(4))
def test_lengths_that_do_not_reach_are_measured(seed):
    model = fixture("short_arm")
    pose = nearest_closed(model, disturbed(model, model.qpos0, seed))
    assert pose.status == "cannot-close"
    (culprits,) = pose.culprits
    assert (culprits.alone, culprits.equalities) == (True, ("pin",))
    assert culprits.openings[0].metres == pytest.approx(0.1, abs=SHORT)
    assert pose.left[0].metres == pytest.approx(0.1, abs=SHORT)
    assert str(culprits) == "'pin' is short by 0.1000 m"


@pytest.mark.parametrize("seed", range(3))
def test_equalities_that_contradict_one_another_are_named(seed):
    """The third is sound and not blamed, nor disturbed."""
    model = fixture("two_walls")
    pose = nearest_closed(model, disturbed(model, model.qpos0, seed))
    assert pose.status == "cannot-close"
    (culprits,) = pose.culprits
    assert (culprits.alone, culprits.equalities) == (False, ("left", "right"))
    assert sum(opening.largest for opening in culprits.openings) == pytest.approx(0.1, abs=SHORT)
    assert str(culprits) == "'left' and 'right' cannot hold together: short by 0.1000 m"
    assert pose.left[2].largest <= LEFT


def test_of_many_the_fewest_are_blamed():
    """A plate on four pins, one of them 0.3 m off: it contradicts each of the others, and they hold together."""
    pins = {"a": (0, 0), "b": (1, 0), "c": (0, 1), "d": (1, 1)}
    sites = "".join(f'<site name="{name}" pos="{x} {y} 0"/>' for name, (x, y) in pins.items())
    walls = "".join(f'<site name="wall_{n}" pos="{x} {y} {0.3 * (n == "d")}"/>' for n, (x, y) in pins.items())
    connects = "".join(f'<connect name="{name}" site1="{name}" site2="wall_{name}"/>' for name in pins)
    xml = f"""<mujoco><worldbody><body><freejoint/><geom size="0.1"/>{sites}</body>{walls}</worldbody>
      <equality>{connects}</equality></mujoco>"""
    (culprits,) = nearest_closed(compiled(xml)).culprits
    assert not culprits.alone
    assert len(culprits.equalities) == 2
    assert "d" in culprits.equalities


def test_two_points_that_nothing_moves():
    """MuJoCo leaves such rows out."""
    xml = """<mujoco><worldbody><site name="a"/><site name="b" pos="0 0 {}"/><body><joint/><geom size="0.1"/></body>
      </worldbody><equality><connect name="wrong" site1="a" site2="b"/></equality></mujoco>"""
    pose = nearest_closed(compiled(xml.format(0.1)))
    assert pose.status == "cannot-close"
    assert str(pose.culprits[0]) == "'wrong' is short by 0.1000 m"
    assert nearest_closed(compiled(xml.format(0))).status == "consistent"


def test_six_digits_neither_lock_nor_open_an_over_constrained_ring():
    """Bricard's ring with a length off by a part in ten million closes to that, and goes on moving."""
    xml = load_case("bricard").model_path.read_text(encoding="utf-8")
    pose = nearest_closed(compiled(xml.replace('pos="0 -1 0">', 'pos="0 -1.0000001 0.0000001">')))
    assert pose.closed
    assert pose.status == "consistent"
    assert pose.loops.dof == 1
    assert [(one.dof, one.moves) for one in pose.mobility] == [(1, True)]
    assert pose.loops.groups[0].spectrum.dropped > LEFT  # strictly it is locked


def test_a_tilted_hinge_is_named():
    model = fixture("tilted_hinge")
    for pose in (nearest_closed(model), nearest_closed(model, disturbed(model, model.qpos0, 1))):
        assert pose.closed
        assert pose.status == "locked"
        (tilt,) = pose.tilts
        assert (tilt.joint, tilt.equality) == ("rocker", "pin")
        assert np.degrees(tilt.radians) == pytest.approx(2.0, abs=1e-6)
    straight = compiled(
        (FIXTURES / "check/tilted_hinge.xml").read_text().replace("0 0.999390827 0.0348994967", "0 1 0")
    )
    pose = nearest_closed(straight)
    assert (pose.status, pose.tilts) == ("consistent", ())


def test_a_tilted_crank_is_named_too():
    """It turns the axis of the coupler with it: in another pose no two axes are parallel."""
    xml = four_bar().replace('<joint name="crank"/>', '<joint name="crank" axis="0 0.99 0.141"/>')
    model = compiled(xml)
    pose = nearest_closed(model, np.array([0.4, 0.1, 0.0]))
    assert pose.status in ("locked", "cannot-close")
    assert [tilt.joint for tilt in pose.tilts] == ["crank"]


@pytest.mark.parametrize("seed", range(3))
def test_closed_but_locked(seed):
    model = fixture("locked_cranks")
    pose = nearest_closed(model, disturbed(model, model.qpos0, seed))
    assert pose.closed
    assert pose.status == "locked"
    (mobility,) = pose.mobility
    assert (mobility.dof, mobility.moves) == (0, False)
    assert mobility.frees == ("pin2", "pin3")
    assert mobility.kept < 0.02  # a small error locks it
    assert pose.tilts == ()
    # With the pivot where it belongs it turns.
    xml = (FIXTURES / "check/locked_cranks.xml").read_text().replace("0.41 0 0.3", "0.4 0 0.3")
    free = nearest_closed(compiled(xml))
    assert (free.status, free.mobility[0].dof) == ("consistent", 1)


STRETCHED = """<mujoco><worldbody><site name="wall" pos="1 0 0"/>
  <body><joint axis="0 1 0"/><geom size="0.1"/><body pos="0.5 0 0"><joint axis="0 1 0"/><geom size="0.1"/>
  <site name="tip" pos="0.5 0 0"/></body></body></worldbody>
  <equality><connect site1="tip" site2="wall"/></equality></mujoco>"""


def test_what_the_rows_admit_need_not_be_a_motion():
    """An arm stretched to its wall: its rows admit one motion, to first order only."""
    pose = nearest_closed(compiled(STRETCHED))
    assert pose.loops.dof == 1
    assert pose.status == "locked"
    bent = nearest_closed(compiled(STRETCHED.replace('pos="1 0 0"', 'pos="0.9 0 0"')))
    assert (bent.status, bent.loops.dof) == ("locked", 0)


def test_a_singular_pose_is_not_taken_for_its_mechanism():
    pose = nearest_closed(compiled(parallelogram()), np.array([np.pi / 2, -np.pi / 2, np.pi / 2]))
    (mobility,) = pose.mobility
    assert (mobility.dof, mobility.near) == (2, 1)
    assert mobility.singular
    assert pose.status == "consistent"


def test_no_equality_that_is_active():
    pose = nearest_closed(
        compiled(four_bar().replace('name="pin"', 'name="pin" active="false"')), np.array([1.0, 2, 3])
    )
    assert (pose.status, pose.moved, pose.openings, pose.mobility) == ("consistent", 0.0, (), ())


@pytest.mark.parametrize("given", [np.zeros(2), np.array([0.0, np.nan, 0.0])])
def test_a_start_that_is_none_is_refused(given):
    with pytest.raises(InputError, match=r"qpos of the start has the shape .*, expected 3 finite numbers"):
        nearest_closed(compiled(four_bar()), given)


# Written out.


def png():
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", 1, 1, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"\0abc")) + chunk(b"IEND", b"")


@pytest.fixture
def strange(tmp_path):
    """The fixtures that refer to other files, with their meshes and textures made."""
    folder = tmp_path / "robots"
    for name in ("gripper", "hanger", "attached"):
        shutil.copytree(FIXTURES / name, folder / name)
    for meshes in ("gripper/meshes", "hanger/shapes"):
        (folder / meshes).mkdir()
        (folder / meshes / "link.obj").write_text(TETRAHEDRON)
    (folder / "gripper" / "meshes" / "plate.png").write_bytes(png())
    return folder


@pytest.mark.parametrize("file", ["gripper/gripper.xml", "attached/pair.xml"])
@pytest.mark.parametrize("place", ["elsewhere/deep", "robots", "robots/gripper"])
def test_includes_and_assets_are_found_from_another_place(strange, tmp_path, file, place):
    source, target = strange / file, tmp_path / place / "closed copy.xml"
    target.parent.mkdir(parents=True, exist_ok=True)
    before = list(tmp_path.rglob("*.*"))
    model = load_model(source)
    pose = nearest_closed(model, disturbed(model, model.qpos0, 0))
    name = write_keyframe(source, target, pose.qpos, pose.qvel)
    copy = load_model(target)
    assert [field for field in differences(model, copy) if not field.startswith(("key_", "nkey"))] == []
    key = copy.key(name)
    assert copy.nkey == model.nkey + 1
    data = mujoco.MjData(copy)
    mujoco.mj_resetDataKeyframe(copy, data, key.id)
    mujoco.mj_forward(copy, data)
    assert np.abs(data.efc_pos[: data.ne]).max() <= LEFT
    np.testing.assert_array_equal(copy.key_qvel[key.id], pose.qvel)
    assert sorted(tmp_path.rglob("*.*")) == sorted([*before, target])  # nothing was copied


def test_keyframes_of_the_author_stay(tmp_path):
    source, first, second = FIXTURES / "hopper.xml", tmp_path / "one.xml", tmp_path / "two.xml"
    model = load_model(source)
    pose = nearest_closed(model, model.key_qpos[0])
    assert write_keyframe(source, first, pose.qpos, pose.qvel, model.key_ctrl[0]) == "closed"
    assert write_keyframe(first, second, pose.qpos) == "closed2"
    copy = load_model(second)
    np.testing.assert_array_equal(copy.key_qpos[0], model.key_qpos[0])
    np.testing.assert_array_equal(copy.key_ctrl, [[0.5], [0.5], [0.0]])
    assert "a floating base on a floor" in second.read_text(encoding="utf-8")


def test_what_cannot_be_written_is_refused_in_a_line(tmp_path):
    source = write_model(tmp_path, four_bar())
    pose = np.zeros(3)
    (tmp_path / "folder.xml").mkdir()
    for target, message in [
        (source, "is the model itself, expected another file"),
        (tmp_path / "none" / "out.xml", r"cannot be written: no folder '.*none'"),
        (tmp_path / "folder.xml", "cannot be written: Is a directory"),
    ]:
        with pytest.raises(InputError, match=message) as raised:
            write_keyframe(source, target, pose)
        assert "\n" not in str(raised.value)
    script = load_case("n_four_bar").model_path
    with pytest.raises(InputError, match=r"is not an MJCF file"):
        write_keyframe(script, tmp_path / "out.xml", np.zeros(5))
    assert load_model(source).nkey == 0


def test_a_target_that_takes_nothing(tmp_path):
    source = write_model(tmp_path / "model", four_bar())
    for target, said in ((tmp_path, "Is a directory"), (tmp_path / ("x" * 300), "File name too long")):
        with pytest.raises(InputError, match=f"cannot be written: {said}"):
            write_keyframe(source, target, np.zeros(3))
