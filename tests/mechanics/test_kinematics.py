"""Bias accelerations are J̇v: what MuJoCo's own J̇ gives, and exactly nothing where nothing can be."""

import mujoco
import numpy as np
import pytest
from mechanisms import TANGLE, four_bar
from oarlock.mechanics.kinematics import Kinematics
from tolerances import SAME_BIAS

ZERO = (0.0, 0.0, 0.0)


def moving(xml, seed):
    """A model at a random state."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(seed)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(0, 1, model.nv), 1.0)
    data.qvel[:] = rng.normal(0, 2, model.nv)
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    return model, data


def of_all(model, data):
    kinematics = Kinematics(model, range(model.nbody))
    kinematics.read(data)
    return kinematics


@pytest.mark.parametrize("seed", range(8))
def test_motion_is_mujocos(seed):
    """Ball, hinges and a slide on a tree of three bodies; a free body; the world."""
    model, data = moving(TANGLE, seed)
    kinematics = of_all(model, data)
    linear, angular = np.zeros((2, 3, model.nv))
    scale = 1.0 + data.qvel @ data.qvel
    for body in range(model.nbody):
        place = data.xpos[body] + [0.1, -0.2, 0.3]
        there = place.tolist()
        mujoco.mj_jac(model, data, linear, angular, place, body)
        pairs = [(kinematics.velocity(body, there), linear @ data.qvel), (kinematics.spin(body), angular @ data.qvel)]
        mujoco.mj_jacDot(model, data, linear, angular, place, body)
        pairs.append((kinematics.bend(body, there), linear @ data.qvel))
        for found, expected in pairs:
            np.testing.assert_allclose(found, expected, rtol=0, atol=SAME_BIAS * scale)
            assert body or found == ZERO


def test_ancestors_are_enough():
    model, data = moving(TANGLE, 1)
    body = model.body("d").id
    alone = Kinematics(model, [body])
    alone.read(data)
    whole, place = of_all(model, data), data.xpos[body].tolist()
    assert alone.bend(body, place) == whole.bend(body, place)


@pytest.mark.parametrize("seed", range(4))
def test_what_moves_as_one_bends_as_one(seed):
    """A point and the same one of a body without joints on its body."""
    child = '<body name="hand"><geom type="sphere" size="0.01"/></body>'
    model, data = moving(four_bar(body=child), seed)
    kinematics = of_all(model, data)
    coupler, hand = model.body("coupler").id, model.body("hand").id
    place = data.xpos[hand].tolist()
    assert any(kinematics.bend(hand, place))
    assert kinematics.bend(hand, place) == kinematics.bend(coupler, place)
