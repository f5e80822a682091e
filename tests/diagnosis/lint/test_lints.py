"""What is seen without a run, and that nothing is seen where there is nothing; units, rows, doubled equalities."""

import math
from pathlib import Path

import mujoco
import numpy as np
import oarlock
import pytest
from gallery import piece
from oarlock import model_names
from oarlock.diagnosis.lint.lints import LINTS, look
from oarlock.diagnosis.lint.unit import degrees, radians
from oarlock.diagnosis.lint.view import View
from oarlock.diagnosis.loops.poses import nearest_closed
from oarlock.mechanics.load import load_model
from seen import CHECK, chain, of_file, of_text, only, text_of

# What each fixture is there for, and nothing else is found anywhere.

SEEN = {
    "pin_collision.xml": {"C4"},
    "mimic_ring.xml": {"L9", "S3"},
    "welded_pin.xml": {"L10", "S3"},
    "drawn_apart.xml": {"S5", "S6", "S1"},
    "stiff_servo.xml": {"A1"},
    "stiff_damping.xml": {"A4"},
    "wrong_units.xml": {"A2", "S1"},
    "degrees.xml": {"A2", "S1"},
    "wrong_sign.xml": {"L9", "S3"},
    "all_redundant.xml": {"S1"},
    "carried_tray.xml": {"S1", "S3"},
    "locked_cranks.xml": {"S1", "S3"},
    "short_arm.xml": {"S1"},
    "starved_rods.xml": {"A1"},
    "thirty_equalities.xml": {"S3"},
    "tilted_hinge.xml": {"S3"},
    "two_walls.xml": {"S1"},
    "unreachable.xml": {"S1"},
    "turned_weld.xml": {"S7", "S1"},
    "ringing.xml": {"T6", "L11", "L12"},
}
PARTS = {"defaults.xml", "common.xml", "none.xml"}
WHOLE = [path.relative_to(CHECK).as_posix() for path in sorted(CHECK.rglob("*.xml")) if path.name not in PARTS]


@pytest.mark.parametrize("name", WHOLE)
def test_fixtures(name):
    assert {one.code for one in of_file(name)} == SEEN.get(name, set())


@pytest.mark.parametrize("name", model_names())
def test_nothing_is_found_in_the_gallery(name):
    one = piece(name)
    data = mujoco.MjData(one.model)
    data.qpos[:], data.qvel[:] = one.qpos, one.qvel
    assert [str(remark) for remarks in look(View(one.model, data)).values() for remark in remarks] == []


def test_every_file_of_the_room_is_in_the_list():
    folder = Path(str(__import__("oarlock.diagnosis.lint", fromlist=["x"]).__file__)).parent
    assert {path.stem for path in folder.glob("*.py")} == {*LINTS, "__init__", "lints", "view"}


# Units.


@pytest.mark.parametrize("value", [90, -45, 30, 180, 360, 120, 10])
def test_what_looks_like_degrees(value):
    assert degrees(float(value))
    assert not degrees(math.radians(value))


@pytest.mark.parametrize("value", [6.283185307179586, 12.566370614359172, 3.14, 9.9, 400, 1000, 12.34, 25.132741, 0.0])
def test_what_does_not(value):
    assert not degrees(float(value))


@pytest.mark.parametrize("value", ["1.57", "3.14", "0.785", "1.5708", "2.0944", "-1.047"])
def test_what_looks_like_radians(value):
    assert radians(math.radians(float(value)))


@pytest.mark.parametrize("value", [1.0, 1.5, 2.0, 2.5, 3.0, 0.5, 5.0, 6.0, 0.0])
def test_what_does_not_either(value):
    assert not radians(math.radians(value))


UNITS = """<mujoco><compiler angle="{angle}"/><worldbody>
  <body name="a"><joint name="a" axis="0 1 0" {a}/><geom size="0.1"/></body>
  <body name="b" pos="1 0 0"><joint name="b" axis="0 1 0" {b}/><geom size="0.1"/></body></worldbody>
  <equality><joint name="gear" joint1="a" joint2="b" polycoef="{offset} 1 0 0 0"/></equality>
  <actuator><position name="servo" joint="b" kp="1" kv="1" ctrlrange="{control}"/></actuator>{rest}</mujoco>"""


@pytest.mark.parametrize(
    ("given", "elements"),
    [
        ({}, []),
        ({"a": 'range="-90 90"'}, ["a"]),
        ({"a": 'range="0 120"', "b": 'range="-45 45"'}, ["a"]),
        ({"angle": "degree", "a": 'range="-90 90"', "b": 'range="-1 5"'}, []),
        ({"angle": "degree", "a": 'range="-1.57 1.57"', "b": 'range="0 3.14"'}, ["a"]),
        ({"a": 'range="-1.57 1.57"', "b": 'range="-6.28 6.28"'}, []),
        ({"a": 'range="-31.4159265 31.4159265"'}, []),
        ({"b": 'ref="30"'}, ["b"]),
        ({"angle": "degree", "b": 'ref="30"'}, []),
        ({"b": 'springref="-45" stiffness="1"'}, ["b"]),
        ({"offset": "45"}, ["gear"]),
        ({"offset": "0.5"}, []),
        ({"control": "-60 60"}, ["servo"]),
        ({"control": "0 90", "b": 'range="0 1.57"'}, ["servo"]),
        ({"control": "-3.14 3.14"}, []),
        ({"rest": '<keyframe><key name="k" qpos="90 90"/></keyframe>'}, ["k"]),
        ({"rest": '<keyframe><key name="k" qpos="1.2 1.2"/></keyframe>'}, []),
    ],
)
def test_units(given, elements):
    values = {"angle": "radian", "a": "", "b": "", "offset": "0", "control": "-1 1", "rest": "", **given}
    assert [one.element for one in of_text(UNITS.format(**values)) if one.code == "A2"] == elements


def test_a_motor_has_no_unit_to_be_wrong():
    text = UNITS.format(angle="radian", a="", b="", offset="0", control="-60 60", rest="")
    text = text.replace('<position name="servo" joint="b" kp="1" kv="1"', '<motor name="servo" joint="b"')
    assert "A2" not in {one.code for one in of_text(text)}


# Rows that ring.


def test_a_row_rings_at_the_frequency_that_is_named():
    """A bead on a soft connect, with nothing else around: the peak of its spectrum, and how long a hundredth takes."""
    text = """<mujoco><option timestep="0.0005" gravity="0 0 0" integrator="RK4"/><worldbody><body name="bead">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
      <geom size="0.1" mass="1"/></body></worldbody>
      <equality><connect name="string" body1="bead" anchor="0 0 0" solref="0.2 0.05"
      solimp="0.9999 0.9999 0.001 0.5 2"/></equality></mujoco>"""
    one = only(of_text(text), "T6")
    assert one.figures["zeta"] == pytest.approx(0.05, rel=1e-3)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    path = []
    for _ in range(4000):
        mujoco.mj_step(model, data)
        path.append(data.qpos[0])
    path = np.array(path)
    crossings = np.flatnonzero((path[:-1] < 0) & (path[1:] >= 0))
    hertz = (len(crossings) - 1) / ((crossings[-1] - crossings[0]) * model.opt.timestep)
    assert hertz == pytest.approx(one.figures["hertz"], rel=2e-3)
    late = np.abs(path[round(one.figures["rings_s"] / model.opt.timestep) :]).max()
    assert late == pytest.approx(0.01 * np.abs(path).max(), rel=0.2)


@pytest.mark.parametrize("solref", ["0.02 1", "0.004 0.5", "0.02 0.4", "-1000 -60"])
def test_rows_that_come_to_rest(solref):
    text = text_of("ringing.xml").replace('solref="-40000 -20"', f'solref="{solref}"')
    assert "T6" not in {one.code for one in of_text(text, 0)}


# Doubled and idle ones.


@pytest.mark.parametrize(
    ("closing", "codes"),
    [
        ('<weld body1="a" body2="b"/><connect body1="b" body2="a" anchor="0.3 0 0"/>', {"L11"}),
        ('<connect body1="a" body2="b" anchor="0 0 0"/><weld body1="a" body2="b"/>', set()),
        ('<connect body1="a" body2="b" anchor="0 0 0"/><connect body1="a" body2="b" anchor="0 0.1 0"/>', set()),
        ('<connect body1="a" body2="b" anchor="0.5 0 0"/><connect site1="s" site2="t"/>', {"L11"}),
        (
            '<connect body1="a" body2="b" anchor="0 0 0"/><connect body1="a" body2="b" anchor="0 0 0" active="false"/>',
            set(),
        ),
        ('<joint joint1="a" joint2="b"/><joint joint1="a" joint2="b"/>', {"L11"}),
        ('<joint joint1="a" joint2="b"/><joint joint1="a" joint2="c"/>', set()),
        ('<connect body1="a" anchor="0 0 0"/><connect body1="rail" anchor="0 0 0"/>', {"L12"}),
        ('<connect body1="a" body2="b" anchor="0 0 0"/><connect site1="t" site2="u"/>', {"L12"}),
        ('<connect body1="a" body2="b" anchor="0 0 0"/><weld body1="hand" body2="world"/>', set()),
    ],
)
def test_doubled_and_idle(closing, codes):
    text = f"""<mujoco><default><geom contype="0" conaffinity="0"/></default><worldbody>
      <body name="hand" mocap="true"/>
      <body name="a"><freejoint/><geom size="0.1"/><site name="s" pos="0.5 0 0"/></body>
      <body name="b" pos="1 0 0"><freejoint/><geom size="0.1"/><site name="t" pos="-0.5 0 0"/><site name="u"/></body>
      <body name="rail" pos="0 5 0"><geom size="0.1"/></body>
      </worldbody><equality>{closing}</equality></mujoco>"""
    if "<joint" in closing:
        text = chain(closing)
    assert {one.code for one in of_text(text) if one.code in ("L11", "L12")} == codes


JOINED = """<mujoco><default><geom contype="0" conaffinity="0" size="0.1"/></default><worldbody>
  <body name="hand" mocap="true"/>
  <body name="a"><freejoint/><geom/><body name="lid" pos="0 0 0.3"><geom/></body></body>
  <body name="b" pos="1 0 0"><freejoint/><geom/></body><body name="c" pos="2 0 0"><freejoint/><geom/></body>
  <body name="post" pos="0 5 0"><geom/><body name="cap" pos="0 0 0.3"><geom/></body></body>
  </worldbody><equality>{equalities}</equality></mujoco>"""


@pytest.mark.parametrize(
    ("equalities", "named", "by"),
    [
        ('<weld name="ab" body1="a" body2="b"/><weld name="lid" body1="lid" body2="b"/>', "lid", ["ab"]),
        ('<weld name="ab" body1="a" body2="b"/><connect name="p" body1="b" body2="lid" anchor="1 0 0"/>', "p", ["ab"]),
        (
            '<weld name="ab" body1="a" body2="b"/><weld name="bc" body1="b" body2="c"/>'
            '<connect name="ac" body1="lid" body2="c" anchor="1 0 0"/>',
            "ac",
            ["ab", "bc"],
        ),
        (
            '<weld name="a" body1="a" body2="post"/><weld name="b" body1="b"/><weld name="ba" body1="b" body2="a"/>',
            "ba",
            ["b", "a"],
        ),
    ],
)
def test_bodies_that_welds_hold_together_already(equalities, named, by):
    """Without a run; without the equality that is named the rank of the rows is the same, in plain MuJoCo."""
    text = JOINED.format(equalities=equalities)
    one = only(of_text(text), "L11")
    assert (one.element, one.figures["also"]) == (named, by)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    ranks = []
    for active in (1, 0):
        data.eq_active[model.equality(named).id] = active
        mujoco.mj_forward(model, data)
        ranks.append(np.linalg.matrix_rank(data.efc_J.reshape(-1, model.nv)[: data.ne], tol=1e-9))
    assert ranks[0] == ranks[1]


@pytest.mark.parametrize(
    "equalities",
    [
        '<weld body1="a" body2="b"/><weld body1="b" body2="c"/>',
        '<weld body1="a" body2="hand"/><weld body1="a" body2="post"/>',  # the hand is moved
        '<weld body1="a" body2="b"/><connect body1="b" body2="c" anchor="0 0 0"/><weld body1="a" body2="c"/>',
    ],
)
def test_bodies_that_welds_do_not_hold_together(equalities):
    assert "L11" not in {one.code for one in of_text(JOINED.format(equalities=equalities))}


@pytest.mark.parametrize("equality", ['<weld body1="a" body2="lid"/>', '<connect body1="cap" anchor="0 0 0"/>'])
def test_that_nothing_holds_anything_is_seen_without_a_run(tmp_path, equality):
    (tmp_path / "model.xml").write_text(JOINED.format(equalities=equality))
    found = {one.code: one.severity for one in oarlock.check(tmp_path / "model.xml", lint=True).verdict}
    assert found == {"L1": "error", "L12": "warning"}


# Constants in degrees.


def start_of(text: str) -> float:
    """How far the first row of plain MuJoCo is off at the first keyframe."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return abs(float(data.efc_pos[0]))


def test_a_constant_in_degrees_is_one_that_closes_and_that_the_ranges_admit():
    text, one = text_of("degrees.xml"), only(of_file("degrees.xml"), "A2")
    assert one.severity == "error"
    assert "which the ranges of its joints do not admit" in one.line
    assert "24° are 0.418879 rad, with which it is closed at the start" in one.line
    assert start_of(text) > 20.0
    mended = text.replace('"24 1', f'"{one.figures["wanted"]!r} 1')
    assert start_of(mended) < 1e-4
    assert {one.code for one in of_text(mended, 0)} <= {"S1"}


@pytest.mark.parametrize(
    ("changes", "severity"),
    [
        ([('range="-60 60"', "")], None),  # only the start tells
        ([('qpos="-0.1 0.31888"', 'qpos="0 0"')], "error"),  # only the ranges tell
        ([('"24 1', '"1.2 1')], "none"),  # an angle in radians
        ([('"24 1', '"0.418879 1')], "none"),
        ([('range="-60 60"', ""), ('qpos="-0.1 0.31888"', 'qpos="0 0"')], "none"),  # 24 rad, and nothing says why not
        ([("-60 60", "-9000 9000"), ('qpos="-0.1 0.31888"', 'qpos="-12 12"')], "none"),  # a winch
        ([('joint2="inner" polycoef="24 1', 'polycoef="24 0')], "error"),  # held at an angle
    ],
)
def test_constants_of_couplings(changes, severity):
    text = text_of("degrees.xml")
    for change in changes:
        assert change[0] in text
        text = text.replace(*change)
    assert [one.severity for one in of_text(text, 0) if one.code == "A2"] == ([] if severity == "none" else [severity])


# The start.


@pytest.mark.parametrize("name", ["two_walls.xml", "carried_tray.xml", "drawn_apart.xml", "degrees.xml"])
def test_an_open_start_is_open_by_the_rows_of_plain_mujoco(name):
    one = only(of_file(name), "S1")
    model = load_model(CHECK / name)
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_EQUALITY, one.element)
    rows = data.efc_pos[: data.ne][data.efc_id[: data.ne] == index]
    metres, turn = float(np.linalg.norm(rows[:3])), 2.0 * math.asin(min(1.0, float(np.linalg.norm(rows[3:]))))
    assert one.figures["opening"] == pytest.approx(max(metres, turn), rel=1e-6)


def test_a_start_that_comes_apart_is_told_with_its_speed():
    text = chain('<joint name="gear" joint1="a" joint2="b"/>', "ab").replace(
        "</mujoco>", '<keyframe><key name="k" qpos="0 0" qvel="0.5 -1"/></keyframe></mujoco>'
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    (one,) = [one for remarks in look(View(model, data)).values() for one in remarks]
    assert (one.code, one.figures["speed"]) == ("S1", pytest.approx(1.5))
    assert "comes apart at 1.500 rad/s" in one.line


def test_a_check_tells_more_of_a_start_and_tells_it_once():
    """With a closed pose at hand a lint leaves the start and the locks to it."""
    model = load_model(CHECK / "locked_cranks.xml")
    pose = nearest_closed(model)
    view = View(model, mujoco.MjData(model), pose)
    assert not {"S1", "S3"} & {one.code for remarks in look(view).values() for one in remarks}
