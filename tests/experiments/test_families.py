"""Models that come in sizes: small ones of every sort move as their mechanism must, and start closed."""

import mujoco
import numpy as np
import pytest
from mechanisms import only, setup_of
from oarlock import InputError, load_case, run
from oarlock.mechanics.load import load_model
from tolerances import CLOSED, LOCKSTEP_PARITY, SAME_MOTION
from whole import require_start

DOF = {
    "n_four_bar:N=5": 1,
    "n_four_bar:N=4,apart=1": 4,
    "n_four_bar:N=3,connects=2,apart=1": 3,
    "net:k=1": 1,
    "net:k=2": 2,
    "net:k=4,doubled=0": 4,
    "net:k=2,tree=1,doubled=1": 4,
    "net:k=4,tree=1": 8,
    "n_crank:K=2": 1,
    "n_crank:K=3": 1,
    "n_crank:K=11": 1,
    "sarrus:legs=3,cells=2": 2,
    "sarrus:cells=3": 3,
    "sarrus:legs=3,cells=2,apart=1": 2,
    "sarrus:apart=1": 1,
    "tensegrity": 9,
    "tensegrity:cells=3": 15,
    "ring:bodies=5,apart=1": 15,
    "ring:bodies=5,planar=1": 5,
    "ring:bodies=6,planar=1,apart=1": 6,
}
"""Degrees of freedom by the count of each model's page, of corners, bars, planes or bodies, not of its rows."""

REDUNDANT = {
    "n_crank:K=11": 2 * 10 - 11,
    "tensegrity:cells=3": 3 * 2,
    "ring:bodies=5,apart=1": 0,
    "net:k=4,doubled=0": 0,
    "net:k=2,tree=1,doubled=1": 2 * 4,
}
"""Rows that are not zero, beyond the rank: what the model was made for."""

STEPS = 20


@pytest.mark.parametrize("name", DOF)
def test_each_moves_as_its_mechanism_must(name):
    case = load_case(name)
    require_start(case)
    assert case.expected()["dof"] == DOF[name]


@pytest.mark.parametrize("name", DOF)
def test_each_is_closed_as_it_is_built(name):
    """No closing is needed, neither of positions nor of velocities."""
    case = load_case(name)
    model = load_model(case.model_path, case.parameters)
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() <= CLOSED
    assert np.abs(data.efc_vel[: data.ne]).max() <= CLOSED
    assert setup_of(case, case.file.run.integrator).start.moved <= CLOSED


@pytest.mark.parametrize("name", REDUNDANT)
def test_redundancy_is_as_constructed(name):
    setup = setup_of(load_case(name), "euler")
    data = setup.data()
    mujoco.mj_forward(setup.model, data)
    sizes = np.abs(data.efc_J.reshape(data.nefc, setup.model.nv)[: data.ne]).max(axis=1)
    assert np.count_nonzero(sizes > CLOSED) - setup.start.rank == REDUNDANT[name]


def trees(name):
    case = load_case(name)
    return len(set(load_model(case.model_path, case.parameters).body_treeid.tolist()) - {-1})


def test_parts_stand_apart_or_on_one_tree():
    assert [trees(f"net:tree={tree}") for tree in (0, 1)] == [3, 1]
    assert [trees(f"n_four_bar:N=5,apart={apart}") for apart in (0, 1)] == [6, 10]
    assert [trees(f"sarrus:legs=3,cells=4,apart={apart}") for apart in (0, 1)] == [3, 16]
    assert [trees(f"ring:bodies=7,apart={apart}") for apart in (0, 1)] == [1, 7]


@pytest.mark.parametrize("name", ["sarrus:legs=3,cells=2", "ring:bodies=4,planar=1,apart=1", "n_four_bar:N=2,apart=1"])
def test_other_ways_to_build_it_match_mujoco(name):
    results = run(name, mode="lockstep", form="matched", solver="pinv", duration=STEPS * 1e-3)
    row = only(results.rows, mode="lockstep")
    assert (row["status"], row["steps_done"]) == ("done", STEPS)
    assert row["qacc_rel_diff_max"] <= LOCKSTEP_PARITY


@pytest.mark.parametrize("pair", [("ring", "ring:apart=1"), ("ring:planar=1", "ring:planar=1,apart=1")])
def test_a_ring_moves_alike_however_it_is_tied(pair):
    """Place of the last body after some steps: both are the same mechanism."""
    places = []
    for name in pair:
        setup = setup_of(load_case(name), "rk4", duration_s=STEPS * 1e-3)
        results = run(name, mode="free", form="hard", solver="pinv", duration=STEPS * 1e-3)
        data = setup.data()
        data.qpos[:] = results.steps.filter(mode="free")["qpos"][-1].to_numpy()
        mujoco.mj_kinematics(setup.model, data)
        places.append(data.body("body6").xpos.copy())
    np.testing.assert_allclose(*places, rtol=0, atol=SAME_MOTION)


def test_only_a_linkage_on_the_ground_has_the_truth_of_one():
    """A stack moves otherwise, and so does a chain of loops; those apart move like one alone."""
    truths = {name: load_case(name).truth_path for name in ("sarrus:cells=2", "sarrus:apart=1", "n_four_bar:apart=1")}
    assert truths["sarrus:cells=2"] is None
    assert truths["n_four_bar:apart=1"] is None
    results = run("sarrus:apart=1", mode="free", form="hard", solver="pinv", duration=0.1)
    assert only(results.rows, solver="pinv")["truth_error_max"] <= SAME_MOTION


def test_a_word_is_expected_of_listed_parameters_only():
    """How many reactions are unique hangs on the parameters, and a word is no expression of them."""
    assert load_case("tensegrity:cells=2").expected()["reactions"] == "partly unique"
    assert "reactions" not in load_case("tensegrity:cells=3").expected()


@pytest.mark.parametrize(
    "name",
    [
        "net:k=0",
        "net:tree=2",
        "net:doubled=1.5",
        "n_crank:K=1",
        "tensegrity:cells=0",
        "sarrus:cells=0",
        "sarrus:apart=2",
        "ring:bodies=3,planar=1",
        "ring:planar=2",
        "n_four_bar:apart=-1",
    ],
)
def test_a_size_that_makes_no_mechanism_is_refused(name):
    case = load_case(name)
    wrong = name.split(":")[1].split(",")[0].replace("=", " = ")
    with pytest.raises(InputError, match=rf"{wrong}, expected"):
        load_model(case.model_path, case.parameters)
