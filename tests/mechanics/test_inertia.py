"""Rows in the metric of M, held against a dense factorisation."""

import mujoco
import numpy as np
import pytest
from mechanisms import TANGLE
from oarlock.mechanics.inertia import whiten
from oarlock.mechanics.rows import jacobian
from tolerances import SAME_ACCELERATION


@pytest.fixture
def tangled():
    model = mujoco.MjModel.from_xml_string(TANGLE)
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, np.random.default_rng(3).normal(0, 1, model.nv), 1.0)
    mujoco.mj_fwdPosition(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return model, data, mass


def test_products_of_whitened_rows_are_those_in_the_inverse_of_m(tangled):
    model, data, mass = tangled
    rows = np.ascontiguousarray(jacobian(model, data))
    found, wanted = whiten(model, data, rows), rows @ np.linalg.solve(mass, rows.T)
    np.testing.assert_allclose(found @ found.T, wanted, rtol=0, atol=SAME_ACCELERATION * np.abs(wanted).max())
    assert whiten(model, data, rows[:0]).shape == (0, model.nv)


def test_the_identity_gives_the_factor_itself(tangled):
    model, data, mass = tangled
    half = whiten(model, data, np.eye(model.nv))
    np.testing.assert_allclose(half.T @ mass @ half, np.eye(model.nv), rtol=0, atol=SAME_ACCELERATION)
