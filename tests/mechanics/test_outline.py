"""Where a mechanism is drawn: joints, rails, and anchors that are in the air."""

import mujoco
import numpy as np
import pytest
from oarlock.mechanics.names import equalities
from oarlock.mechanics.outline import distinct_joints, drawn_end, rails_of, stands

XML = """<mujoco><worldbody>
  <body name="base"><joint/><geom type="box" size="0.1 0.1 0.1"/>
    <body name="link" pos="0 0 0.1"><joint name="a"/><joint name="b" axis="1 0 0"/><joint name="c" pos="0 0 0.2"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.01"/></body></body>
  <body name="cart" pos="1 0 0"><joint type="slide" axis="1 0 0"/><joint/><geom type="sphere" size="0.1"/></body>
  <body name="bare" pos="2 0 0"><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
  <body name="free" pos="3 0 0"><freejoint/><geom type="sphere" size="0.1"/></body></worldbody>
  <equality>{}</equality></mujoco>"""


def model_of(equality='<joint joint1="a"/>'):
    return mujoco.MjModel.from_xml_string(XML.format(equality))


def test_joints_and_rails():
    model = model_of()
    link, cart = model.body("link").id, model.body("cart").id
    assert [model.joint(joint).name for joint in distinct_joints(model, link)] == ["a", "c"]
    assert rails_of(model, link) == []
    assert rails_of(model, cart) == [int(model.body_jntadr[cart])]
    standing = [model.body(body).name for body in range(1, model.nbody) if stands(model, body)]
    assert standing == ["base", "bare"]


@pytest.mark.parametrize(
    ("body", "anchor", "end"),
    [
        ("link", "0 0 0.2", None),
        ("link", "0 0 0.24", None),  # a little over its end: within a fiftieth of the model
        ("link", "0 0 0.5", [0, 0, 0.21]),
        ("base", "0.1 0.05 0.5", [0.1, 0.05, 0.1]),
        ("bare", "0 0 0.5", None),  # nothing is drawn of it
    ],
)
def test_an_anchor_is_in_the_air_where_its_body_has_nothing(body, anchor, end):
    model = model_of(f'<connect body1="{body}" anchor="{anchor}"/>')
    (equality,) = equalities(model)
    found = drawn_end(model, equality, 0)
    assert (found is None) == (end is None)
    if end is not None:
        np.testing.assert_allclose(found, end, atol=1e-9)
    assert drawn_end(model, equality, 1) is None  # the world is everywhere
