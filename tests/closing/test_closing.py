"""Loops closed in an open tree: MJCF keeps its author's text, URDF becomes MJCF; the closed pose is closed."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mechanisms import four_bar
from oarlock.base.errors import InputError
from oarlock.closing.closing import close
from oarlock.closing.joining import REACH
from oarlock.diagnosis.loops.poses import nearest_closed
from oarlock.mechanics.load import load_model
from oarlock.stepping.closing import CLOSED
from places import FIXTURES
from scipy.spatial.transform import Rotation

URDF = FIXTURES / "closing" / "four_bar.urdf"
PIN = '<connect name="pin" site1="tip1" site2="tip2"/>'
OPEN = four_bar(pivot="0.73 0 0").replace(f"<equality>{PIN}</equality>", "")
TIPS = ("tip1", "tip2")


def written(folder, text=OPEN, name="open.xml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def in_keyframe(path, name="closed"):
    """The model, and its data in a keyframe."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(name).id)
    mujoco.mj_forward(model, data)
    return model, data


def gap(path, name="closed"):
    """By MuJoCo's own rows, m or rad."""
    _, data = in_keyframe(path, name)
    assert data.ne > 0
    return float(np.abs(data.efc_pos[: data.ne]).max())


def test_the_fixture_is_open():
    model = mujoco.MjModel.from_xml_string(OPEN)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert model.neq == 0
    assert np.linalg.norm(data.site("tip1").xpos - data.site("tip2").xpos) > 0.01


def test_sites_are_joined_and_the_text_is_kept(tmp_path):
    source, out = written(tmp_path), tmp_path / "out.xml"
    closing = close(source, out, [TIPS])
    assert closing.reached
    assert closing.files == (out,)
    assert gap(out) <= CLOSED
    text = out.read_text(encoding="utf-8")
    assert '<connect name="tip1_tip2" site1="tip1" site2="tip2"/>' in text
    added = re.sub(r"\s*<(equality|keyframe)>.*?</\1>", "", text, flags=re.DOTALL)
    assert added.split() == OPEN.split()


def test_the_pose_is_the_nearest(tmp_path):
    """That of the same model with the equality written by hand."""
    whole = written(tmp_path, four_bar(pivot="0.73 0 0"), "whole.xml")
    closing = close(written(tmp_path), tmp_path / "out.xml", [TIPS])
    np.testing.assert_allclose(closing.pose.qpos, nearest_closed(load_model(whole)).qpos, atol=1e-12)


def test_a_urdf_is_closed_where_its_frames_say(tmp_path):
    out = tmp_path / "closed.xml"
    closing = close(URDF, out)
    assert [(one.name, one.first.name, one.second.name) for one in closing.joinings] == [
        ("pin", "closing_pin_1", "closing_pin_2")
    ]
    assert gap(out) <= CLOSED
    model, data = in_keyframe(out)
    assert [model.body(index).name for index in range(1, model.nbody)] == [
        "base",
        "crank",
        "coupler",
        "closing_pin_1",
        "rocker",
        "closing_pin_2",
    ]
    assert np.linalg.norm(data.body("closing_pin_1").xpos - data.body("closing_pin_2").xpos) <= CLOSED


def turned(angle, tilt):
    """Roll, pitch and yaw of a rotation about z in a frame that is tilted, in all digits."""
    return " ".join(map(repr, (tilt * Rotation.from_euler("z", angle)).as_euler("xyz").tolist()))


def test_a_urdf_keeps_the_digits_of_its_axes(tmp_path):
    """MuJoCo's writer has six: axes that were parallel are tilted by them, and a planar loop does not close."""
    tilt = Rotation.from_euler("xyz", [0.618034, 0.271828, 0.1])
    pivot = tilt.apply([0.3 * np.cos(0.3), 0.3 * np.sin(0.3), 0.0]) + np.array([0.0, 0.0, 0.1])
    text = URDF.read_text(encoding="utf-8")
    for old, new in (
        ('rpy="0 0 0.3"', f'rpy="{turned(0.3, tilt)}"'),
        ('rpy="0 0 1.4"', f'rpy="{turned(1.4, tilt)}"'),
        ("0.28660094673768176 0.08865606199840188 0.1", " ".join(map(repr, pivot.tolist()))),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    out = tmp_path / "closed.xml"
    assert close(written(tmp_path, text, "tilted.urdf"), out).reached
    assert gap(out) <= CLOSED


@pytest.mark.parametrize(
    ("folder", "meshdir", "named"),
    [
        ("meshes", "", "meshes/part.obj"),
        ("meshes", "meshes", "part.obj"),
        ("meshes", "", "package://robot/meshes/part.obj"),
        ("../meshes", "", "package://meshes/part.obj"),
        (".", "", "part.obj"),
    ],
)
def test_meshes_of_a_urdf_are_found_from_the_copy(tmp_path, folder, meshdir, named):
    robot, other = tmp_path / "robot", tmp_path / "other"
    (robot / folder).mkdir(parents=True)
    other.mkdir()
    corners = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\n"
    (robot / folder / "part.obj").write_text(f"{corners}f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    text = URDF.read_text(encoding="utf-8").replace(
        '<geometry><box size="0.3 0.01 0.01"/></geometry>',
        f'<geometry><mesh filename="{named}"/></geometry>',
    )
    compiler = f'<robot name="four_bar"><mujoco><compiler meshdir="{meshdir}"/></mujoco>'
    source = written(robot, text.replace('<robot name="four_bar">', compiler), "robot.urdf")
    for out in (other / "closed.xml", robot / "closed.xml"):
        assert close(source, out).reached
        model, _ = in_keyframe(out)
        assert model.nmesh == 1
        assert sorted(path.name for path in other.iterdir()) == ["closed.xml"]


def test_a_point_is_for_bodies_alone(tmp_path):
    with pytest.raises(
        InputError, match=r"a point \(--at\) for 'tip1', which has a place of its own: expected two bodies"
    ):
        close(written(tmp_path), tmp_path / "out.xml", [("tip1", "tip2")], at=[1.0, 2.0, 3.0])
    assert not (tmp_path / "out.xml").exists()


def test_two_bodies_are_joined_as_they_are_drawn(tmp_path):
    out = tmp_path / "out.xml"
    closing = close(written(tmp_path), out, [("coupler", "rocker")], at=[0.5, 0.0, 0.5])
    assert closing.pose.moved == pytest.approx(0.0, abs=CLOSED)
    _, data = in_keyframe(out)
    for name in ("coupler", "rocker"):
        np.testing.assert_allclose(data.site(name).xpos, [0.5, 0.0, 0.5], atol=1e-12)
    closing = close(written(tmp_path), out, [("coupler", "rocker")])
    _, data = in_keyframe(out)
    np.testing.assert_allclose(data.site("coupler").xpos, data.body("rocker").xpos, atol=1e-12)


@pytest.mark.parametrize(("kind", "rows"), [("connect", 3), ("ball", 3), ("hinge", 6), ("weld", 6)])
def test_every_kind_holds_what_it_says(tmp_path, kind, rows):
    """Of two arms in space that can reach each other with any orientation: six joints of a ball, and a slide."""
    arms = """<mujoco><option gravity="0 0 0"/><worldbody>
      <body name="left"><joint type="free"/><geom size="0.1"/><site name="a" pos="0.3 0 0" euler="10 20 30"/></body>
      <body name="right" pos="1 0 0"><freejoint/><geom size="0.1"/><site name="b" pos="0 0.2 0" euler="40 0 5"/></body>
    </worldbody></mujoco>"""
    out = tmp_path / "out.xml"
    close(written(tmp_path, arms), out, [("a", "b")], kind=kind)
    model, data = in_keyframe(out)
    assert data.ne == rows
    assert gap(out) <= 10 * CLOSED  # of a weld MuJoCo's rows are sines of half the angle
    first, second = data.site("a"), data.site("b")
    assert np.linalg.norm(first.xpos - second.xpos) <= 10 * CLOSED
    axes = [site.xmat.reshape(3, 3) for site in (first, second)]
    apart = np.abs(axes[0] - axes[1])
    if kind == "hinge":
        assert apart[:, 2].max() <= 10 * CLOSED / REACH
        assert apart[:, 0].max() > 1e-3
        points = [data.site(f"{name}_axis").xpos for name in "ab"]
        assert np.linalg.norm(points[0] - first.xpos) == pytest.approx(REACH)
    assert (apart.max() <= 10 * CLOSED) == (kind == "weld")
    assert model.neq == (2 if kind == "hinge" else 1)


def test_frames_of_mjcf_are_ends(tmp_path):
    text = OPEN.replace(
        '<site name="tip2" pos="-0.2 0 0.5"/>',
        '<frame name="tip2" pos="-0.1 0 0.2"><frame pos="-0.1 0 0.3" name="end"/></frame>',
    )
    out = tmp_path / "out.xml"
    close(written(tmp_path, text), out, [("tip1", "end")])
    assert gap(out) <= CLOSED
    model, _ = in_keyframe(out)
    np.testing.assert_allclose(model.site("end").pos, [-0.2, 0.0, 0.5], atol=1e-15)


def test_an_end_in_an_included_file_gets_its_site_there(tmp_path):
    begin, end = OPEN.index('<body name="rocker"'), OPEN.rindex("</worldbody>")
    rocker = OPEN[begin:end].replace('<site name="tip2" pos="-0.2 0 0.5"/>', '<body name="mark" pos="-0.2 0 0.5"/>')
    written(tmp_path, f"<mujoco>{rocker}</mujoco>", "rocker.xml")
    source = written(tmp_path, OPEN[:begin] + '<include file="rocker.xml"/>' + OPEN[end:])
    out = tmp_path / "out.xml"
    closing = close(source, out, [("tip1", "mark")])
    assert closing.files == (tmp_path / "out-rocker.xml", out)
    assert gap(out) <= CLOSED
    assert "<site" not in (tmp_path / "rocker.xml").read_text(encoding="utf-8")


def test_the_world_is_an_end(tmp_path):
    out = tmp_path / "out.xml"
    close(written(tmp_path), out, [("world", "coupler")])
    assert gap(out) <= CLOSED


def test_a_keyframe_is_closed_with_its_controls(tmp_path):
    rest = """<actuator><motor name="drive" joint="crank"/></actuator>
      <keyframe><key name="home" qpos="0.2 0 0" ctrl="0.5"/></keyframe>"""
    source = written(tmp_path, OPEN.replace("</mujoco>", f"{rest}</mujoco>"))
    out = tmp_path / "out.xml"
    close(source, out, [TIPS])
    model, _ = in_keyframe(out)
    assert model.key("closed").ctrl.tolist() == [0.5]
    assert model.nkey == 2
    assert abs(model.key("closed").qpos[0] - 0.2) < 0.2  # near the keyframe


def test_marks_of_mjcf_that_are_joined_already_are_left(tmp_path):
    text = OPEN.replace("tip1", "closing_pin_1").replace("tip2", "closing_pin_2")
    out, again = tmp_path / "out.xml", tmp_path / "again.xml"
    close(written(tmp_path, text), out)
    with pytest.raises(InputError, match="are joined already, by 'pin', expected an open pair"):
        close(out, again)
    assert not again.exists()


def test_names_that_are_taken_are_numbered(tmp_path):
    text = OPEN.replace(
        "</mujoco>", '<equality><joint name="tip1_tip2" joint1="crank" joint2="rocker" active="false"/></equality>'
    )
    out = tmp_path / "out.xml"
    close(written(tmp_path, f"{text}</mujoco>"), out, [TIPS])
    model, _ = in_keyframe(out)
    assert [model.equality(index).name for index in range(model.neq)] == ["tip1_tip2", "tip1_tip22"]


# What cannot be done.


def test_what_cannot_be_reached_is_not_written(tmp_path):
    out = tmp_path / "out.xml"
    closing = close(written(tmp_path, OPEN.replace("0.73 0 0", "3 0 0")), out, [TIPS])
    assert not closing.reached
    assert not out.exists()
    lengths = 0.3 + np.hypot(0.5, 0.2) + np.hypot(0.2, 0.5)
    # Stretched, the two tips are as near as they can be: the rows are the axes of the world.
    assert 0.5 * (3.0 - lengths) < closing.gap <= 3.0 - lengths + 1e-6


@pytest.mark.parametrize(
    ("pairs", "said"),
    [
        ([("tip1", "tip3")], "no site, frame or body 'tip3', expected tip[12]"),
        ([("tip1", "zzz")], "no site, frame or body 'zzz', expected one of: tip1, tip2, "),
        ([("tip1", "coupler")], "'tip1' and 'coupler' are parts of one body, 'coupler', expected two that can move"),
        ([("tip1", "tip1")], "are parts of one body"),
        ([TIPS, TIPS[::-1]], "the pair 'tip2' 'tip1' is given twice"),
        ([], "no --pair, and no frames called closing_NAME_1 and closing_NAME_2"),
    ],
)
def test_mistakes_are_named(tmp_path, pairs, said):
    with pytest.raises(InputError, match=said):
        close(written(tmp_path), tmp_path / "out.xml", pairs)
    assert not (tmp_path / "out.xml").exists()


def test_a_mark_without_its_other_side_is_named(tmp_path):
    source = written(tmp_path, OPEN.replace("tip1", "closing_pin_1"))
    with pytest.raises(InputError, match="no frame 'closing_pin_2' beside 'closing_pin_1', expected both"):
        close(source, tmp_path / "out.xml")


@pytest.mark.parametrize("equality", [PIN, '<connect body1="rocker" body2="coupler" anchor="-0.23 0 0.5"/>'])
def test_an_equality_between_the_same_points_is_found(tmp_path, equality):
    text = OPEN.replace("0.73", "0.7").replace("</mujoco>", f"<equality>{equality}</equality></mujoco>")
    text = text.replace('"tip2" pos="-0.2 0 0.5"', '"tip2" pos="-0.23 0 0.5"').replace(
        'pos="0.5 0 0.2"/>', 'pos="0.47 0 0.2"/>'
    )
    with pytest.raises(InputError, match="are joined already"):
        close(written(tmp_path, text), tmp_path / "out.xml", [TIPS])


def test_a_file_that_is_no_model_is_named(tmp_path):
    for text, said in (
        ("<robot", "not well-formed"),
        ("<robot/>", "no joint"),
        ("<robot><link/></robot>", "refuses"),
        ("<mujoco/>", "no joint"),
    ):
        with pytest.raises(InputError, match=said) as raised:
            close(written(tmp_path, text, "bad.urdf"), tmp_path / "out.xml", [("a", "b")])
        assert str(tmp_path / "bad.urdf") in str(raised.value)
    assert [path.name for path in Path(tmp_path).iterdir()] == ["bad.urdf"]


@pytest.mark.parametrize("kind", ["connect", "hinge", "weld"])
def test_servos_hold_the_closed_pose(tmp_path, kind):
    """Of a file without a keyframe: at rest in the new one no servo pulls, within its range; a motor has no control."""
    servos = """<actuator><position name="s" joint="{joint}" kp="50"/><motor name="m" joint="{joint}"/>
      <position name="short" joint="{joint}" kp="9" gear="2" ctrlrange="-.001 .001"/></actuator>"""
    source = written(tmp_path)
    out = tmp_path / "out.xml"
    moved = close(source, out, [TIPS], kind=kind).pose.moved_joint
    (joint,) = (one.name for one in mujoco.MjSpec.from_file(str(source)).joints if one.name and one.name in moved)
    source.write_text(source.read_text().replace("</mujoco>", servos.format(joint=joint) + "</mujoco>"))
    close(source, out, [TIPS], kind=kind)
    model, data = in_keyframe(out)
    mujoco.mj_forward(model, data)
    assert data.joint(joint).qpos[0] != 0.0
    assert data.actuator("s").force[0] == pytest.approx(0.0, abs=1e-12)
    assert data.ctrl[0] == pytest.approx(data.joint(joint).qpos[0])
    assert data.ctrl[1] == 0.0
    assert abs(data.ctrl[2]) == pytest.approx(0.001)
