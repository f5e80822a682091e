"""Welds where a pin was meant, and anchors apart from what is drawn."""

import mujoco
import numpy as np
import oarlock
import pytest
from seen import of_file, of_text, only, text_of
from tolerances import CLOSED

# Pins.


def freedoms(text: str) -> int:
    """Degrees of freedom at the model's own pose, by plain MuJoCo."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model.nv - int(np.linalg.matrix_rank(data.efc_J.reshape(-1, model.nv)[: data.ne], tol=1e-8))


PIN = '<weld name="knee" body1="coupler" body2="rocker" anchor="-0.02 0 0.15"/>'
CONNECT = '<connect name="knee" body1="rocker" body2="coupler" anchor="-0.02 0 0.15"/>'
BESIDE = '<connect name="hinge" body1="rocker" body2="coupler" anchor="-0.02 0 0.1"/>'


@pytest.mark.parametrize(
    ("closing", "dof", "named"),
    [
        (PIN, 0, "knee"),
        (PIN.replace('name="knee"', ""), 0, "weld of 'coupler' and 'rocker'"),
        (CONNECT, 1, None),
        (CONNECT + BESIDE, 0, "knee"),
        (BESIDE, 1, None),
    ],
)
def test_a_weld_where_a_pin_was_meant(closing, dof, named):
    text = text_of("welded_pin.xml").replace(PIN, closing)
    assert freedoms(text) == dof
    found = [one for one in of_text(text, 0) if one.code == "L10"]
    assert [one.element for one in found] == ([named] if named else [])


def test_a_weld_is_meant_where_a_pin_would_not_move_it_either():
    """Two links between the ground and themselves; and a link that a mocap body holds."""
    two = text_of("welded_pin.xml").replace('<joint name="crank"/>', "")
    assert "L10" not in {
        one.code
        for one in of_text(two.replace('joint="crank"', 'joint="coupler"').split("<keyframe>")[0] + "</mujoco>")
    }
    mocap = text_of("welded_pin.xml").replace(
        '<body name="rocker" pos="0.3 0 0.4">\n      <joint name="rocker"/>',
        '<body name="rocker" mocap="true" pos="0.3 0 0.4">',
    )
    assert "L10" not in {one.code for one in of_text(mocap, 0)}


# Drawings.


def test_an_anchor_in_the_air_and_the_end_that_was_meant():
    """Both anchors coincide in the model's own pose: with sites at the drawn ends the loop is open by the gap."""
    one = only(of_file("drawn_apart.xml"), "S5")
    text = text_of("drawn_apart.xml")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    tip = data.body("strut").xpos + np.array([0.03, 0, 0.26])
    lug = data.body("lid").xpos + np.array([0.4, 0, 0])
    assert one.figures["gap"] == pytest.approx(float(np.linalg.norm(tip - lug)), abs=CLOSED)
    assert one.figures["anchors"] == [pytest.approx([0.4, 0, 0]), pytest.approx([0.15, 0, 0.4])]


def test_an_overhang_beside_a_pin_is_no_mistake():
    """The lever is drawn beyond the pin, in a plane beside it: the line of the pin goes through it."""
    seen = of_text(LINKS.format(axis="0 0 1", tilt=0.0, connects=BESIDE), 0)
    longer = LINKS.format(axis="0 0 1", tilt=0.0, connects=BESIDE).replace(
        '<geom fromto="0 0 0 -0.1 0.2 0"/>', '<geom fromto="0 0 0.05 -0.15 0.3 0.05"/>'
    )
    assert "S5" not in {one.code for one in seen}
    assert "S5" not in {one.code for one in of_text(longer, 0)}


def test_sites_at_the_drawn_ends_are_told_and_meet_where_the_keyframe_has_them(tmp_path):
    text = """<mujoco><compiler angle="radian"/><option timestep="0.001"/>
      <default><geom type="capsule" size="0.008" contype="0" conaffinity="0"/><joint axis="1 0 0" damping="0.02"/>
      </default><worldbody>
      <body pos="0 -0.1 0"><joint name="l"/><geom fromto="0 0 0 0 0 0.15"/>
        <body name="a" pos="0 0 0.15"><joint name="m"/><geom fromto="0 0 0 0 0 0.15"/>{a}</body></body>
      <body pos="0 0.1 0"><joint name="r"/><geom fromto="0 0 0 0 0 0.15"/>
        <body name="b" pos="0 0 0.15"><joint name="s"/><geom fromto="0 0 0 0 0 0.15"/>{b}</body></body></worldbody>
      <equality>{pin}</equality><actuator><position joint="l" kp="20" kv="0.5"/><position joint="r" kp="20" kv="0.5"/>
      </actuator><keyframe><key name="met" qpos="0 -0.72972766 0 0.72972766"/></keyframe></mujoco>"""
    file = tmp_path / "m.xml"
    file.write_text(text.format(a="", b="", pin='<connect name="pin" body1="a" body2="b" anchor="0 0 0.15"/>'))
    checked = oarlock.check(file, budget=0, duration=0.5)
    one = only(checked.verdict, "S5")
    assert not {"S1", "S6"} & {each.code for each in checked.verdict}  # which say the same, only less of it
    assert "which meet at the start to " in checked.answer
    assert checked.answer.endswith("; or turn the links so that they are drawn together")
    first, second = (" ".join(map(str, place)) for place in one.figures["sites"])
    sites = [f'<site name="{name}" pos="{place}"/>' for name, place in (("p", first), ("q", second))]
    joined = text.format(a=sites[0], b=sites[1], pin='<connect site1="p" site2="q"/>')
    model = mujoco.MjModel.from_xml_string(joined)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert np.linalg.norm(data.efc_pos[:3]) < 1e-6
    fixed = checked.fix(tmp_path / "fixed.xml")
    assert not fixed.mended
    assert {each.code for each in fixed.left} >= {"S5"}


@pytest.mark.parametrize(
    "change",
    [
        ("0.03 0 0.26", "0.15 0 0.4"),  # drawn to where it is held
        (
            '<geom fromto="0 0 0 0.03 0 0.26"/>',
            '<geom fromto="0 0 0 0.03 0 0.26"/><geom fromto="0.03 0 0.26 0.15 0 0.4"/>',
        ),
        ('<geom fromto="0 0 0 0.03 0 0.26"/>', '<inertial pos="0 0 0.1" mass="1" diaginertia="0.1 0.1 0.1"/>'),
        ('<geom fromto="0 0 0 0.03 0 0.26"/>', '<geom type="box" size="0.1 0.1 0.1"/>'),
        ('<geom fromto="0 0 0 0.03 0 0.26"/>', '<geom type="sphere" size="0.05"/>'),
        ("0 0 0 0.03 0 0.26", "0 0 0 -0.6 0 -0.8"),  # the free end of a lever that goes the other way
    ],
)
def test_an_anchor_in_the_air_alone_is_no_mistake(change):
    text = text_of("drawn_apart.xml")
    assert change[0] in text
    assert "S5" not in {one.code for one in of_text(text.replace(*change), 0)}


BESIDE = '<connect body1="rod" body2="lever" anchor="0.1 0.2 0.06"/>'
LINKS = """<mujoco><default><geom type="capsule" size="0.008" contype="0" conaffinity="0"/><joint axis="{axis}"/>
  </default><worldbody><body name="arm"><joint name="arm"/><geom fromto="0 0 0 0.3 0 0"/>
    <body name="rod" pos="0.3 0 0"><joint name="rod"/><geom fromto="0 0 0 0.1 0.2 0"/></body></body>
  <body name="lever" pos="0.5 0 0"><joint name="lever" axis="0 {tilt} 1"/><geom fromto="0 0 0 -0.1 0.2 0"/></body>
  </worldbody><equality>{connects}</equality></mujoco>"""
"""Three links in a plane, drawn closed: rod and lever end at (0.4 0.2 0)."""


@pytest.mark.parametrize(
    ("anchors", "found"),
    [
        (["0.1 0.2 0.06"], False),  # off along the axis of the hinge
        (["0.1 0.2 -0.3"], False),
        (["0.1 0.2 0.04", "0.1 0.2 -0.04"], False),  # the two ends of a pin
        (["0.1 0.2 0.04", "0.1 0.2 0.1"], False),  # a pin that is held on one side
        (["0.16 0.2 0.06"], True),  # off sideways, too
        (["0.16 0.2 0.04", "0.16 0.2 -0.04"], True),
        (["0.16 0.2 0"], True),
    ],
)
@pytest.mark.parametrize("tilt", [0.0, 0.03])
def test_an_anchor_that_is_off_along_its_hinge_is_no_mistake(anchors, found, tilt):
    connects = "".join(f'<connect body1="rod" body2="lever" anchor="{anchor}"/>' for anchor in anchors)
    seen = of_text(LINKS.format(axis="0 0 1", tilt=tilt, connects=connects))
    assert bool([one for one in seen if one.code == "S5"]) == found


def test_two_connects_across_a_pin_of_hinges_that_are_not_parallel():
    connects = "".join(f'<connect body1="rod" body2="lever" anchor="{at}"/>' for at in ("0.14 0.2 0", "0.06 0.2 0"))
    assert "S5" not in {one.code for one in of_text(LINKS.format(axis="0 1 0", tilt=1, connects=connects))}


def test_a_keyframe_that_closes_is_not_named():
    text = text_of("drawn_apart.xml").replace('qpos="0.4 0 0.1"', 'qpos="0 0 0"')
    assert "S6" not in {one.code for one in of_text(text, 0)}
    assert only(of_file("drawn_apart.xml"), "S6").figures["gap"] == pytest.approx(0.156, abs=5e-4)


CARRIED = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="arm" pos="0 0 1" quat="0.9 0.1 -0.3 0.2"><joint name="arm" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02"/>
    <body name="hand" pos="0.3 0 0"><joint name="hand" axis="0 0 1"/><geom size="0.04"/></body></body>
  <body name="crate" pos="0.8 0.2 0.9"><freejoint name="crate"/><geom type="box" size="0.05 0.06 0.07"/></body>
  </worldbody>
  <equality><weld name="hold" body1="{first}" body2="{second}" {attributes}/></equality>
  <keyframe><key name="else" qpos="0 0 0.8 0.2 0.9 1 0 0 0"/>
    <key name="held" qpos="0.4 -0.7 0.5 0.3 0.6 0.8 0.1 0.5 -0.2"/></keyframe></mujoco>"""


@pytest.mark.parametrize(("first", "second"), [("hand", "crate"), ("crate", "hand")])
@pytest.mark.parametrize("attributes", ["", 'anchor="0.05 0.02 -0.1"'])
def test_the_relpose_that_holds_what_a_keyframe_has(first, second, attributes):
    """With it the keyframe is closed in plain MuJoCo to the digits of a file."""

    def open_by(given: str) -> float:
        model = mujoco.MjModel.from_xml_string(CARRIED.format(first=first, second=second, attributes=given))
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 1)
        mujoco.mj_forward(model, data)
        return float(np.abs(data.efc_pos).max())

    one = only(of_text(CARRIED.format(first=first, second=second, attributes=attributes), 1), "S6")
    assert one.figures["keyframe"] == "held"
    assert open_by(attributes) > 0.1
    assert open_by(f'{attributes} relpose="{one.figures["wanted"]}"') < 1e-5


def test_a_start_that_a_weld_does_not_hold_is_told_with_its_relpose(tmp_path):
    path = tmp_path / "carried.xml"
    path.write_text(CARRIED.format(first="hand", second="crate", attributes=""))
    wanted = only(of_text(path.read_text(), 1), "S6").figures["wanted"]
    one = only(oarlock.check(path, keyframe="held", budget=0, duration=0.1).verdict, "S1")
    assert f'relpose="{wanted}" holds it as it starts' in one.line
    assert "S1" not in {one.code for one in oarlock.check(path, keyframe="else", budget=0, duration=0.1).verdict}


# Orientations.


def angle(text: str) -> float:
    """Of the first weld in the model's own pose, rad, by MuJoCo's rows sin(θ/2) n with a torquescale of 1."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return 2.0 * float(np.arcsin(min(1.0, np.linalg.norm(data.efc_pos[3:6]))))


GRASP = 'relpose="0 0 0 0 0 -0.4226 0.9063"'


def test_a_quaternion_in_the_other_order():
    """MuJoCo's own rows are open by the angle that is told, and closed with the quaternion that is named."""
    one, text = only(of_file("turned_weld.xml"), "S7"), text_of("turned_weld.xml")
    assert one.element == "grasp"
    assert one.figures["opening"] == pytest.approx(angle(text), abs=1e-6)
    wanted = " ".join(f"{value:.6g}" for value in one.figures["wanted"])
    assert f'"{wanted}"' in one.line
    mended = text.replace(GRASP, f'relpose="0 0 0 {wanted}"')
    assert angle(mended) == pytest.approx(0.0, abs=1e-4)
    assert "S7" not in {one.code for one in of_text(mended)}


def test_a_turn_that_a_keyframe_has_is_meant():
    """The hand stands half a turn away from how it is drawn, as the weld wants it."""
    text = text_of("turned_weld.xml").replace(' euler="0 0 50"', "").replace(GRASP, 'relpose="0 0 0 0 0 0 1"')
    assert only(of_text(text), "S7").figures["opening"] == pytest.approx(np.pi)
    turned = text.replace("</mujoco>", '<keyframe><key name="k" qpos="0 0 0 3.14159265"/></keyframe></mujoco>')
    assert "S7" not in {one.code for one in of_text(turned, 0)}


@pytest.mark.parametrize(
    "relpose",
    [
        "",  # as it is drawn
        'relpose="0 0 0 0.9 0 0 -0.4"',  # off by a little
        'relpose="0 0 0 0 1 0 0"',  # turned over, and no order of it closes
        'relpose="0 0 0 0.5 0.5 0.5 0.5"',
    ],
)
def test_other_orientations(relpose):
    assert "S7" not in {one.code for one in of_text(text_of("turned_weld.xml").replace(GRASP, relpose))}
