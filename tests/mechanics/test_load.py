"""The boat's MJCF against the paper's formulas, reading a model, and models that cannot be read."""

import boat_paper as paper
import mujoco
import numpy as np
import pytest
from mechanisms import TANGLE, relative, setup_of, write_model
from oarlock import InputError, load_case
from oarlock.cases.case_file import Baumgarte
from oarlock.mechanics.load import load_model
from oarlock.mechanics.names import coordinates, equalities
from oarlock.stepping.state import State
from oarlock.stepping.walkers import smooth_stages
from tolerances import PAPER_FORMULA, SAME_POINT

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
        setup.drive.apply(data)
        smooth_stages(setup.model, data)
        state.read()
        return state

    return at


def mass(state):
    full = np.zeros((state.model.nv, state.model.nv))
    mujoco.mj_fullM(state.model, state.data, full)
    return full


def test_boat_is_the_papers(boat):
    for time, q, v in random_boat_states():
        state = boat(time, q, v)
        assert relative(mass(state), paper.mass(q)) <= PAPER_FORMULA
        assert relative(state.residual, paper.MIRROR * paper.constraints(q)) <= PAPER_FORMULA
        assert relative(state.jacobian, paper.MIRROR[:, None] * paper.jacobian(q)) <= PAPER_FORMULA
        assert relative(state.rate, paper.MIRROR * (paper.jacobian(q) @ v)) <= PAPER_FORMULA
        assert relative(state.curvature, paper.MIRROR * paper.curvature(q, v)) <= PAPER_FORMULA


def test_boat_forces_are_the_papers(boat):
    for time, q, v in random_boat_states():
        force, expected = boat(time, q, v).data.qfrc_smooth, paper.force(time, q, v)
        # The motor's 1e4 N m/rad would hide the oars in one norm.
        assert relative(force[:1], expected[:1]) <= PAPER_FORMULA
        assert relative(force[1:], expected[1:]) <= PAPER_FORMULA


def test_hard_question_is_baumgartes(boat):
    for time, q, v in random_boat_states():
        aref, softness = boat(time, q, v).question("hard")
        g, rate, bend = paper.constraints(q), paper.jacobian(q) @ v, paper.curvature(q, v)
        assert softness is None
        assert relative(aref, paper.MIRROR * (-bend - 2 * 5 * rate - 1e4 * g)) <= PAPER_FORMULA


# Reading a model.


@pytest.fixture(scope="module")
def tangle():
    return mujoco.MjModel.from_xml_string(TANGLE)


def test_equalities_know_their_bodies(tangle):
    names = {e.name: tuple(tangle.body(body).name for body in e.bodies) for e in equalities(tangle)}
    assert names == {
        "connect bodies": ("a", "c"),
        "connect world": ("b", "world"),
        "connect sites": ("b", "c"),
        "weld bodies": ("a", "c"),
        "weld as it stands": ("b", "c"),
        "weld world": ("b", "world"),
        "weld sites": ("b", "c"),
        "weld world site": ("world", "c"),
        **dict.fromkeys(["angles", "angle", "mix", "line", "lines", "mix and line"], ("world", "world")),
    }


def test_equalities_know_their_rows(tangle):
    data = mujoco.MjData(tangle)
    mujoco.mj_fwdPosition(tangle, data)
    counts = {e.name: int((data.efc_id == e.index).sum()) for e in equalities(tangle)}
    assert {e.name: e.rows for e in equalities(tangle)} == counts
    units = {e.name: e.unit for e in equalities(tangle)}
    assert {units[name] for name in units if name.startswith("connect")} == {"m"}
    assert {units[name] for name in units if name.startswith("weld")} == {"m or rad"}
    expected = {"angles": "rad", "angle": "rad", "mix": "m or rad", "line": "m", "lines": "m"}
    assert {name: units[name] for name in expected} == expected


def test_anchors_are_where_mujoco_holds_them_together(tangle):
    rng = np.random.default_rng(5)
    data = mujoco.MjData(tangle)
    mujoco.mj_integratePos(tangle, data.qpos, rng.normal(0, 1, tangle.nv), 1.0)
    mujoco.mj_fwdPosition(tangle, data)
    for equality in equalities(tangle):
        if equality.kind.joins_points:
            point1, point2 = (
                data.site_xpos[equality.sites[end]]
                if equality.sites
                else data.xpos[body] + data.xmat[body].reshape(3, 3) @ equality.anchor(tangle, end)
                for end, body in enumerate(equality.bodies)
            )
            rows = np.flatnonzero(data.efc_id == equality.index)[:3]
            np.testing.assert_allclose(point1 - point2, data.efc_pos[rows], rtol=0, atol=SAME_POINT)


def test_coordinates_name_every_entry_of_qpos(tangle):
    entries = coordinates(tangle)
    assert len(entries) == tangle.nq
    assert len({entry["name"] for entry in entries}) == tangle.nq
    assert [entry["unit"] for entry in entries] == ["–"] * 4 + ["rad", "m", "rad"] + ["m"] * 3 + ["–"] * 4


@pytest.mark.parametrize(
    ("xml", "message"),
    [
        ("<mujoco>\n<worldbody><body></mujoco>", "mismatched element <body> at line 2, expected MJCF"),
        ("", "MuJoCo refuses it"),
        ("\x00\xff", "XML that cannot be read"),
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


def test_a_callback_that_stops_the_compiler_is_named():
    mujoco.set_mjcb_passive(lambda model, data: None)
    try:
        with pytest.raises(InputError, match=r"MuJoCo refuses it: .*; the process has set mjcb_passive, expected no"):
            load_model(load_case("four_bar").model_path)
    finally:
        mujoco.set_mjcb_passive(None)


def test_missing_model_is_named(tmp_path):
    with pytest.raises(InputError, match=r"no model file '.*gone\.xml'"):
        load_model(tmp_path / "gone.xml")


def test_a_rope_that_was_meant_for_a_rod_is_told_where_no_equality_is(tmp_path):
    file = tmp_path / "rope.xml"
    file.write_text("""<mujoco><worldbody><site name="a"/><body pos="0.1 0 0"><joint axis="0 1 0"/>
      <geom size="0.02"/><site name="b"/></body></worldbody>
      <tendon><spatial name="link" range="0 0.1" limited="true"><site site="a"/><site site="b"/></spatial></tendon>
      </mujoco>""")
    with pytest.raises(InputError, match="the limit of tendon 'link' holds it as a rope, which pulls and never pushes"):
        load_model(file)
