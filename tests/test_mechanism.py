"""The boat's MJCF against the paper's formulas, J̇v against differences and MuJoCo, and models that cannot be read."""

import boat_paper as paper
import mujoco
import numpy as np
import pytest
from mechanisms import TANGLE, four_bar, relative, setup_of, write_model
from oarlock import InputError, load_case
from oarlock.case_file import Baumgarte
from oarlock.curvature import Curvature, curvature_from_reference
from oarlock.mechanism import coordinates, equalities, load_model
from oarlock.state import State
from oarlock.stepping import smooth_stages
from tolerances import FINITE_DIFFERENCE, FINITE_DIFFERENCE_STEP, PAPER_FORMULA, REFERENCE_CURVATURE

STATES = 100


def random_boat_states():
    """(time, q, v) with the oars in every direction that a rower would not break them at."""
    rng = np.random.default_rng(20240607)
    for _ in range(STATES):
        q = rng.uniform(-1.2, 1.2, 5)
        q[0] = rng.uniform(0, 15)
        yield rng.uniform(0, 12), q, rng.normal(0, 3, 5)


@pytest.fixture(scope="module")
def boat():
    """MuJoCo's view of a state, and its rows: time, q, v → State."""
    setup = setup_of(load_case("boat"))
    data = setup.data()
    state = State(setup.model, data, Baumgarte(beta=5, k=1e4))

    def at(time, q, v):
        data.time, data.qpos[:], data.qvel[:] = time, q, v
        smooth_stages(setup.model, data, setup.drive)
        state.read()
        return state

    return at


def test_boat_is_the_papers(boat):
    for time, q, v in random_boat_states():
        state = boat(time, q, v)
        assert relative(state.mass, paper.mass(q)) <= PAPER_FORMULA
        assert relative(state.residual, paper.MIRROR * paper.constraints(q)) <= PAPER_FORMULA
        assert relative(state.jacobian, paper.MIRROR[:, None] * paper.jacobian(q)) <= PAPER_FORMULA
        assert relative(state.rate, paper.MIRROR * (paper.jacobian(q) @ v)) <= PAPER_FORMULA
        assert relative(state.curvature, paper.MIRROR * paper.curvature(q, v)) <= PAPER_FORMULA


def test_boat_forces_are_the_papers(boat):
    for time, q, v in random_boat_states():
        force, expected = boat(time, q, v).force, paper.force(time, q, v)
        # The motor's 1e4 N m/rad would hide the oars in one norm.
        assert relative(force[:1], expected[:1]) <= PAPER_FORMULA
        assert relative(force[1:], expected[1:]) <= PAPER_FORMULA


def test_hard_question_is_baumgartes(boat):
    for time, q, v in random_boat_states():
        aref, softness = boat(time, q, v).question("hard")
        g, rate, bend = paper.constraints(q), paper.jacobian(q) @ v, paper.curvature(q, v)
        assert softness is None
        assert relative(aref, paper.MIRROR * (-bend - 2 * 5 * rate - 1e4 * g)) <= PAPER_FORMULA


# J̇v.


@pytest.fixture(scope="module")
def tangle():
    return mujoco.MjModel.from_xml_string(TANGLE)


def tangled(model, seed):
    """A random state with its smooth stages done."""
    rng = np.random.default_rng(seed)
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(0, 1, model.nv), 1.0)
    data.qvel[:] = rng.normal(0, 2, model.nv)
    return data


def curvature(model, data):
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    out = np.full(data.ne, np.nan)
    Curvature(model, data).write(data, out)
    return out


def rate_later(model, data, step):
    """J(q ⊕ step·v) v."""
    moved = mujoco.MjData(model)
    moved.eq_active[:], moved.qpos[:], moved.qvel[:] = data.eq_active, data.qpos, data.qvel
    mujoco.mj_integratePos(model, moved.qpos, data.qvel, step)
    mujoco.mj_fwdPosition(model, moved)
    return moved.efc_J.reshape(moved.nefc, model.nv) @ data.qvel


@pytest.mark.parametrize("off", [None, "bodies", "world", "sites"])
@pytest.mark.parametrize("seed", range(5))
def test_curvature_is_the_derivative_of_the_jacobian(tangle, seed, off):
    data = tangled(tangle, seed)
    if off:
        data.eq_active[tangle.equality(off).id] = 0
    found = curvature(tangle, data)
    step = FINITE_DIFFERENCE_STEP
    expected = (rate_later(tangle, data, step) - rate_later(tangle, data, -step)) / (2 * step)
    assert len(found) == (6 if off else 9)
    assert relative(found, expected) <= FINITE_DIFFERENCE


@pytest.mark.parametrize("off", [None, "bodies", "world", "sites"])
@pytest.mark.parametrize("seed", range(5))
def test_curvature_is_what_mujoco_puts_into_aref(tangle, seed, off):
    data = tangled(tangle, seed)
    if off:
        data.eq_active[tangle.equality(off).id] = 0
    found = curvature(tangle, data)
    mujoco.mj_fwdActuation(tangle, data)
    mujoco.mj_fwdAcceleration(tangle, data)
    assert relative(found, curvature_from_reference(data)) <= REFERENCE_CURVATURE


def test_curvature_follows_an_equality_that_is_switched_off(tangle):
    data = tangled(tangle, 7)
    mujoco.mj_fwdPosition(tangle, data)
    mujoco.mj_fwdVelocity(tangle, data)
    law, whole = Curvature(tangle, data), np.zeros(9)
    law.write(data, whole)
    data.eq_active[tangle.equality("world").id] = 0
    mujoco.mj_fwdPosition(tangle, data)
    mujoco.mj_fwdVelocity(tangle, data)
    rest = np.zeros(6)
    law.write(data, rest)
    np.testing.assert_array_equal(rest, whole[[0, 1, 2, 6, 7, 8]])


def test_curvature_refuses_a_weld_by_name():
    weld = '<equality><weld name="glue" body1="coupler" body2="rocker"/></equality>'
    model = mujoco.MjModel.from_xml_string(four_bar(rest=weld))
    data = mujoco.MjData(model)
    with pytest.raises(InputError, match=r"'glue' is a weld, expected connects only"):
        Curvature(model, data)
    data.eq_active[model.equality("glue").id] = 0
    assert len(curvature(model, data)) == 3


# Reading a model.


def test_equalities_know_their_bodies(tangle):
    names = {e.name: tuple(tangle.body(body).name for body in e.bodies) for e in equalities(tangle)}
    assert names == {"bodies": ("a", "c"), "world": ("b", "world"), "sites": ("b", "c")}


def test_coordinates_name_every_entry_of_qpos(tangle):
    entries = coordinates(tangle)
    assert len(entries) == tangle.nq
    assert len({entry["name"] for entry in entries}) == tangle.nq
    assert [entry["unit"] for entry in entries] == ["–"] * 4 + ["rad", "m"] + ["m"] * 3 + ["–"] * 4


@pytest.mark.parametrize(
    ("xml", "message"),
    [
        ("<mujoco><worldbody><body></mujoco>", "MuJoCo refuses it"),
        ("", "MuJoCo refuses it"),
        ("\x00\xff", "MuJoCo refuses it"),
        ("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>", "no <equality> element"),
    ],
)
def test_unusable_models_are_refused_in_one_line(tmp_path, xml, message):
    path = write_model(tmp_path, xml)
    with pytest.raises(InputError) as raised:
        load_model(path)
    text = str(raised.value)
    assert str(path) in text
    assert message in text
    assert "\n" not in text


def test_missing_model_is_named(tmp_path):
    with pytest.raises(InputError, match=r"no model file '.*gone\.xml'"):
        load_model(tmp_path / "gone.xml")
