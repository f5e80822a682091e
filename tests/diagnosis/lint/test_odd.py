"""Couplings that contradict one another: which is named, against the rank of plain MuJoCo's rows."""

import mujoco
import numpy as np
import pytest
from oarlock.diagnosis.loops.odd import Ask, oddest
from seen import chain, of_text, only

HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)

PRESS = """<mujoco>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body><joint name="motor" axis="0 0 1"/><geom size=".02" mass=".2"/></body>
    <body name="beam_l" pos="-.2 0 0">
      <joint name="beam_l" type="slide" axis="0 0 1"/><geom type="box" size=".02 .02 .02" mass="1"/>
    </body>
    <body name="beam_r" pos=".2 0 0">
      <joint name="beam_r" type="slide" axis="0 0 1"/><geom type="box" size=".02 .02 .02" mass="1"/>
      <body name="float"><joint name="float" type="slide" axis="1 0 0"/><geom size=".02" mass=".1"/></body>
    </body>
  </worldbody>
  <equality>{left}{right}<connect name="yoke" body1="float" body2="beam_l" anchor="-.2 0 0"/></equality>
  <actuator><motor joint="motor"/></actuator>
</mujoco>"""
"""A motor that lifts both ends of a beam by a screw each; one end may slide."""


def couple(name: str, first: str, second: str, ratio: float) -> str:
    return f'<joint name="{name}" joint1="{first}" joint2="{second}" polycoef="0 {ratio!r} 0 0 0"/>'


def press(left: tuple[str, str, float], right: tuple[str, str, float]) -> str:
    return PRESS.format(left=couple("left", *left), right=couple("right", *right))


def moves(text: str, joint: str) -> bool:
    """Whether plain MuJoCo's rows admit a motion of a joint in its own pose."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rows = data.efc_J.reshape(-1, model.nv)[: data.ne]
    _, sizes, directions = np.linalg.svd(rows)
    free = directions[int((sizes > 1e-9 * sizes[0]).sum()) :]
    return bool(np.abs(free[:, model.joint(joint).dofadr[0]]).max(initial=0.0) > 1e-6)


@pytest.mark.parametrize("lead", [0.0016, 0.02])
@pytest.mark.parametrize("wrong", ["left", "right"])
def test_exchanged_joints_of_a_screw_are_named(lead, wrong):
    """Its inverse would be so many metres a radian; the other screw would agree with it once turned round as well."""
    ways = {side: (f"beam_{side[0]}", "motor", lead) for side in ("left", "right")}
    sound = press(ways["left"], ways["right"])
    assert moves(sound, "motor")
    assert not {"L9", "L10", "S3"} & {one.code for one in of_text(sound)}
    first, second, _ = ways[wrong]
    text = press(**(ways | {wrong: (second, first, lead)}))
    assert not moves(text, "motor")
    remarks = of_text(text)
    one = only(remarks, "L9")
    assert (one.element, {*one.figures["also"]}) == (wrong, {"left", "right", "yoke"} - {wrong})
    assert f'joint1="{first}" joint2="{second}"' in one.line
    assert one.figures["wanted"] == pytest.approx(1.0 / lead)
    assert "L10" not in {one.code for one in remarks}  # couplings weld no bodies


def test_a_screw_of_another_number_keeps_its_number():
    text = press(("beam_l", "motor", 0.002), ("beam_r", "motor", 0.003))
    one = only(of_text(text), "L9")
    assert one.figures["ratio"] / one.figures["wanted"] == pytest.approx({"left": 2 / 3, "right": 1.5}[one.element])
    given = f"0 {one.figures['ratio']!r} 0"
    assert moves(text.replace(given, f"0 {one.figures['wanted']!r} 0"), "motor")


@pytest.mark.parametrize(("ratios", "odd"), [((2, 2, -2), "c"), ((-0.5, 0.5, 0.5), "a"), ((3, -3, 3), "b")])
def test_the_sign_that_is_unlike_the_others_is_named(ratios, odd):
    """Three gears off one shaft, and a bar by which all turn alike: any one of the signs would mend a ring."""
    text = "".join(couple(name, name, "d", ratio) for name, ratio in zip("abc", ratios, strict=True))
    same = [name for name in "abc" if name != odd]
    text += couple("x", same[0], same[1], 1) + couple("y", same[0], odd, 1)
    one = only(of_text(chain(text, "abcd")), "L9")
    assert one.element == odd
    assert one.figures["wanted"] == pytest.approx(-ratios["abc".index(odd)])


@pytest.mark.parametrize(
    ("asks", "first"),
    [
        ([Ask((SLIDE, HINGE), 0.01, 100.0), Ask((HINGE, SLIDE), 0.01, 100.0)], 1),
        ([Ask((HINGE, HINGE), 3.0, 1 / 3), Ask((HINGE, HINGE), 1 / 3, 3.0), Ask((HINGE, HINGE), 1 / 3, 3.0)], 0),
        ([Ask((HINGE, HINGE), 3.0, 4.0), Ask((HINGE, HINGE), 2.0, -2.0)], 1),
        ([Ask((HINGE, HINGE), 3.0, 4.0), Ask((HINGE, HINGE), 2.0, 7.0)], 0),
    ],
)
def test_which_of_several_is_unlike_the_others(asks, first):
    assert oddest(asks)[0] == first


@pytest.mark.parametrize(("lead", "told", "said"), [(0.0016, 40, False), (0.0005, 90, False), (0.1, 40, True)])
def test_many_turns_of_a_screw_are_no_degrees(lead, told, said):
    """A slide of 0.2 m takes 40 rad of a screw of 1.6 mm a radian; of one of 100 mm it does not."""
    servo = '<position name="lift" joint="motor" kp="1"/>'
    text = press(("beam_l", "motor", lead), ("beam_r", "motor", lead))
    text = text.replace('<motor joint="motor"/>', servo)
    text = text.replace('type="slide" axis="0 0 1"', 'type="slide" axis="0 0 1" limited="true" range="0 .2"')
    text = text.replace("</mujoco>", f'<keyframe><key ctrl="{told}"/></keyframe></mujoco>')
    assert ("A2" in {one.code for one in of_text(text, 0)}) == said
