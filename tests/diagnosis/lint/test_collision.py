"""Bodies that an equality joins and that collide, and runs without their contacts."""

import itertools

import mujoco
import numpy as np
import pytest
from oarlock.diagnosis.lint.collision import find
from oarlock.diagnosis.runs.separation import CLASSES, separated
from seen import of_text, only, opens, text_of, view_of

EXCLUDE = '<contact><exclude body1="coupler" body2="slider"/></contact></mujoco>'


def test_a_collision_at_a_pin_is_what_opens_it():
    text = text_of("pin_collision.xml")
    given, excluded = opens(text, 0.5), opens(text.replace("</mujoco>", EXCLUDE), 0.5)
    assert given > 10 * excluded
    one = only(of_text(text, 0), "C4")
    assert one.element == "wrist"
    assert one.figures["depth"] == pytest.approx(0.032)  # half the box, across the axis, and the capsule's radius
    assert not [one for one in of_text(text.replace("</mujoco>", EXCLUDE), 0) if one.code == "C4"]


@pytest.mark.parametrize(
    "change",
    [
        ('size="0.03 0.02 0.02"', 'size="0.03 0.02 0.02" contype="0" conaffinity="0"'),
        ('size="0.03 0.02 0.02"', 'size="0.03 0.02 0.02" contype="2" conaffinity="4"'),
        ('<option timestep="0.001"/>', '<option timestep="0.001"><flag contact="disable"/></option>'),
    ],
)
def test_what_may_not_collide_does_not(change):
    assert "C4" not in {one.code for one in of_text(text_of("pin_collision.xml").replace(*change), 0)}


def test_what_is_welded_to_a_joined_body_collides_too():
    shell = '<body name="shell"><geom type="box" size="0.03 0.02 0.02"/></body></body>\n  </worldbody>'
    text = text_of("pin_collision.xml").replace(
        '<geom type="box" size="0.03 0.02 0.02"/>', '<geom size="0.001" type="sphere" contype="0" conaffinity="0"/>'
    )
    text = text.replace("</body>\n  </worldbody>", shell)
    one = only(of_text(text, 0), "C4")
    assert (one.figures["body1"], one.figures["body2"], one.element) == ("coupler", "shell", "wrist")


def test_a_box_that_rests_on_what_it_is_welded_to_does_not_collide():
    text = """<mujoco><worldbody><body name="below" pos="0 0 1"><freejoint/>
      <geom type="box" size="0.1 0.1 0.05"/></body>
      <body name="above" pos="0 0 1.0999"><freejoint/><geom type="box" size="0.1 0.1 0.05"/></body></worldbody>
      <equality><weld body1="below" body2="above"/></equality></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    assert view_of(model).data.ncon > 0
    assert find(view_of(model)) == ()


MASKS = list(itertools.product((0, 1, 2, 3, 1 << 30), repeat=2))


def crowd(seed: int, pairs: str = "") -> str:
    """Eight balls that fall on each other, with masks at random."""
    random = np.random.default_rng(seed)
    balls = ""
    for number in range(8):
        kind, affinity = MASKS[random.integers(len(MASKS))] if number > 2 else (1, 1)
        x, y = random.uniform(-0.05, 0.05, 2)
        balls += f"""<body name="b{number}" pos="{x} {y} {0.1 + 0.15 * number}"><freejoint/>
          <geom name="g{number}" size="0.1" contype="{kind}" conaffinity="{affinity}"/></body>"""
    return f"""<mujoco><worldbody><geom type="plane" size="1 1 1" contype="3" conaffinity="3"/>{balls}</worldbody>
      <equality><connect body1="b0" body2="b1" anchor="0 0 0.07"/></equality>{pairs}</mujoco>"""


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("pair", ["", '<pair geom1="g0" geom2="g1"/>'])
def test_pairs_are_separated_as_by_an_exclude(seed, pair):
    """The same motion, bit for bit, as with an exclude in the file, which MuJoCo's compiler takes."""
    given = mujoco.MjModel.from_xml_string(crowd(seed, f"<contact>{pair}</contact>" if pair else ""))
    excludes = '<contact><exclude body1="b0" body2="b1"/><exclude body1="b4" body2="b2"/></contact>'
    wanted = mujoco.MjModel.from_xml_string(crowd(seed, excludes))
    apart = separated(given, {(0 + 1, 1 + 1), (2 + 1, 4 + 1)})
    assert apart is not None
    states = []
    for model in (wanted, apart, given):
        data = mujoco.MjData(model)
        for _ in range(200):
            mujoco.mj_step(model, data)
        states.append(data.qpos.copy())
    assert (states[0] == states[1]).all()
    assert (states[0] != states[2]).any()


def test_too_many_kinds_of_geoms_are_not_separated():
    bodies = "".join(f'<body><freejoint/><geom size="0.1" contype="{n}"/></body>' for n in range(CLASSES + 1))
    assert (
        separated(mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>"), {(1, 2)}) is None
    )
