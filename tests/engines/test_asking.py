"""What is asked: the model whole, every array of it, and states that come back as they went."""

import io

import mujoco
import numpy as np
import pytest
from oarlock.cases.case import load_case
from oarlock.engines import asking
from oarlock.experiments.opening import open_case


@pytest.mark.parametrize("name", ["four_bar", "gripper", "n_four_bar"])
def test_the_text_and_the_arrays_are_the_model(name, tmp_path):
    case = open_case(name)
    text = asking.text_of(case)
    model = asking.compiled(case, text)
    path = asking.write(tmp_path / "ask", text) / "model.xml"
    own = mujoco.MjModel.from_xml_path(str(path))
    assert (own.nq, own.nv, own.neq) == (model.nq, model.nv, model.neq)
    with np.load(io.BytesIO(asking.arrays_of(model)), allow_pickle=False) as arrays:
        for array in ("body_mass", "body_pos", "eq_data", "dof_armature"):
            np.testing.assert_array_equal(arrays[array], getattr(model, array))
        assert arrays["opt_timestep"] == model.opt.timestep
        np.testing.assert_array_equal(arrays["opt_gravity"], model.opt.gravity)
        assert int(arrays["nv"]) == model.nv
        assert len(arrays["body_names"]) == model.nbody
        assert len(arrays["equality_names"]) == model.neq > 0


def test_states_come_back(tmp_path):
    model = mujoco.MjModel.from_xml_path(str(load_case("boat").model_path))
    rng = np.random.default_rng(3)
    qpos, qvel, ctrl = (rng.normal(size=(4, size)) for size in (model.nq, model.nv, model.nu))
    states = asking.states_of(model, qpos, qvel, ctrl)
    back = asking.States.read(states.table())
    for name in ("qpos", "qvel", "ctrl", "act", "applied", "time"):
        np.testing.assert_array_equal(getattr(back, name), getattr(states, name))
    assert np.abs(states.applied).max() > 0.0


def test_forces_that_an_engine_is_given_are_mujocos(tmp_path):
    """M q̈ without constraints = what is applied − bias."""
    model = mujoco.MjModel.from_xml_path(str(load_case("boat").model_path))
    rng = np.random.default_rng(4)
    states = asking.states_of(model, rng.normal(size=(1, model.nq)), rng.normal(size=(1, model.nv)), np.ones((1, 2)))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = states.qpos[0], states.qvel[0], 1.0
    mujoco.mj_forward(model, data)
    expected = np.zeros((1, model.nv))
    mujoco.mj_solveM(model, data, expected, states.applied - data.qfrc_bias)
    np.testing.assert_allclose(data.qacc_smooth, expected[0], rtol=1e-12)
