"""Projection: it lands on the constraints by the shortest way in M, leaves alone what is there, and never jumps."""

import mujoco
import numpy as np
import pytest
from mechanisms import case_of, four_bar, frames_of, only, parallelogram, setup_of, write_model
from oarlock import InputError, RunOptions, load_case, run
from oarlock.mechanics.rows import closing_jacobian
from oarlock.stepping.projection import TRACKED, Projection, Projector, gap
from oarlock.stepping.solvers import SolverSpec
from tolerances import (
    CLOSED,
    HARD_DRIFT,
    M_ORTHOGONAL,
    NEARLY_REDUNDANT,
    PROJECTED,
    SAME_ACCELERATION,
    SINGULAR_ENERGY,
    SINGULAR_ENERGY_LOST,
    STRAIGHT_WAY,
)

ANYWHERE = 0.5
"""rad or m: a trust length that does not bind."""

DISTURBANCE = 1e-4
"""rad or m, and per s: a hundred times what Euler's step leaves on the boat at 1 ms."""

AGAIN = '<equality><connect name="again" site1="tip1" site2="tip2"/></equality>'


def boat(_folder):
    return load_case("boat")


def bar(folder):
    return case_of(write_model(folder, four_bar()), start={"qpos": {"crank": 1.0}})


def doubled(folder):
    return case_of(write_model(folder, four_bar(rest=AGAIN)), start={"qpos": {"crank": 1.0}})


def ball(folder):
    xml = """<mujoco><worldbody><body><joint name="ball" type="ball"/><geom size="0.1" pos="0 0 1"/>
      <body pos="0 0 1"><joint name="skew" axis="1 2 3"/><geom type="capsule" fromto="0 0 0 0 0.5 0.2" size="0.02"/>
        <site name="s1" pos="0 0.5 0.2"/></body></body>
      <body pos="0.4 0.4 1"><freejoint/><geom size="0.1"/><site name="s2"/></body></worldbody>
      <default><geom contype="0" conaffinity="0"/></default>
      <equality><connect site1="s1" site2="s2"/></equality></mujoco>"""
    return case_of(write_model(folder, xml), start={"qvel": {"ball": [1.0, 0.5, 0.2]}})


MECHANISMS = {"boat": boat, "four-bar": bar, "doubled": doubled, "ball": ball}
"""A redundant row an oar; a row of zeros; the same rows twice; quaternions and rows of full rank."""


@pytest.fixture(params=MECHANISMS)
def closed(request, tmp_path):
    """A model with its rank cut, and a state on its constraints, moving."""
    case = MECHANISMS[request.param](tmp_path)
    setup = setup_of(case)
    data = setup.data()
    data.qvel[:] = 1.0
    Projector(setup.model, case.file.rank_cut).project(data, ANYWHERE)
    assert np.abs(data.qvel).max() > 0.1
    return setup.model, case.file.rank_cut, data


def disturbed(model, data, seed, size=DISTURBANCE):
    """A copy of the state, moved off the constraints in positions and velocities."""
    rng = np.random.default_rng(seed)
    other = mujoco.MjData(model)
    other.qpos[:], other.qvel[:] = data.qpos, data.qvel
    mujoco.mj_integratePos(model, other.qpos, size * rng.uniform(-1, 1, model.nv), 1.0)
    other.qvel += size * rng.uniform(-1, 1, model.nv)
    mujoco.mj_fwdPosition(model, other)
    return other


def rate(model, data):
    """Largest J v."""
    return np.abs(closing_jacobian(model, data) @ data.qvel).max()


def state(data):
    return np.concatenate([data.qpos, data.qvel])


@pytest.mark.parametrize("seed", range(5))
def test_projection_lands_on_the_constraints(closed, seed):
    model, cut, data = closed
    other = disturbed(model, data, seed)
    before = gap(other), rate(model, other)
    assert min(before) > 1e-3 * DISTURBANCE
    projection = Projector(model, cut).project(other, ANYWHERE)
    mujoco.mj_fwdPosition(model, other)  # nothing that the projection left may be needed
    assert gap(other) <= PROJECTED
    assert rate(model, other) <= PROJECTED
    assert projection.status == "landed"
    assert 1 <= projection.rounds <= 3  # Newton from 1e-4: 1e-8, rounding, and one round more on account of rounding
    assert projection.rounds < projection.solves
    assert 0 < projection.moved < 10 * DISTURBANCE


@pytest.mark.parametrize("seed", range(3))
def test_correction_has_no_part_along_the_motions_that_are_free(closed, seed):
    """δ = M⁻¹ Jᵀ λ: M-orthogonal to null(J), which is checked against NumPy's own singular vectors."""
    model, cut, data = closed
    other = disturbed(model, data, seed)
    projector = Projector(model, cut)
    jacobian, mass = closing_jacobian(model, other).copy(), np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, other, mass)
    _, values, directions = np.linalg.svd(jacobian)
    rank = int((values > NEARLY_REDUNDANT * values[0]).sum())
    step = projector.correction(other, -other.efc_pos[: other.ne])
    assert projector.rank == rank < model.nv
    free = directions[rank:]
    assert np.abs(free @ mass @ step).max() <= M_ORTHOGONAL * np.linalg.norm(mass @ step)
    # As a velocity: the nearest admissible one, so that kinetic energy can only fall.
    energy = 0.5 * other.qvel @ mass @ other.qvel
    qvel = other.qvel + projector.correction(other, -(jacobian @ other.qvel))
    assert 0.5 * qvel @ mass @ qvel <= energy


def test_projection_is_idempotent_and_leaves_consistent_states_alone(closed):
    """The second projection, and any other projector, changes no bit and solves nothing."""
    model, cut, data = closed
    other = disturbed(model, data, 7)
    projector = Projector(model, cut)
    projector.project(other, ANYWHERE)
    there = state(other).copy()
    for again in (projector, Projector(model, cut, solver=SolverSpec("pinv"))):
        again.project(other, ANYWHERE)
        np.testing.assert_array_equal(state(other), there)


def test_what_is_closed_takes_no_solve():
    setup = setup_of(load_case("boat"))
    data = setup.data()
    start = state(data).copy()
    assert Projector(setup.model).project(data, ANYWHERE) == Projection("landed", 0, 0, 0, 0.0)
    np.testing.assert_array_equal(state(data), start)


@pytest.mark.parametrize("solver", ["pinv", "cholesky"])
def test_solvers_project_to_the_same_state(closed, solver):
    """Solvers that cut the rank where the tracked one does; others take nearly redundant rows at their word."""
    model, cut, data = closed
    states = []
    for spec in (TRACKED, SolverSpec(solver)):
        other = disturbed(model, data, 3)
        assert Projector(model, cut, solver=spec).project(other, ANYWHERE).status == "landed"
        states.append(state(other).copy())
    assert np.abs(states[0] - states[1]).max() <= SAME_ACCELERATION


def test_duplicated_rows_change_nothing(tmp_path):
    """The same way to the constraints, whether they are written once or twice."""
    states = []
    for name, mechanism in (("once", bar), ("twice", doubled)):
        setup = setup_of(mechanism(tmp_path / name))
        data = disturbed(setup.model, setup.data(), 11)
        projector = Projector(setup.model)
        projector.project(data, ANYWHERE)
        assert projector.rank == 2
        states.append(state(data).copy())
    assert np.abs(states[0] - states[1]).max() <= SAME_ACCELERATION


def test_rows_that_contradict_one_another_are_open(tmp_path):
    """Two pins 1 mm apart cannot both hold: halfway between them is the least-squares answer, and it is said."""
    apart = '<worldbody><site name="peg" pos="0.5 0.001 0.5"/></worldbody>'
    pins = '<equality><connect name="again" site1="tip1" site2="peg"/></equality>'
    model, cut = mujoco.MjModel.from_xml_string(four_bar(rest=apart + pins)), None
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    assert gap(data) == pytest.approx(0.001)  # across the plane of the mechanism: no coordinate helps
    start = state(data).copy()
    projection = Projector(model, cut).project(data, ANYWHERE)
    assert projection.status == "open"
    np.testing.assert_array_equal(state(data), start)


@pytest.mark.parametrize("fraction", [0.5, 2.0])
def test_correction_beyond_the_trust_length_is_refused(closed, fraction):
    model, cut, data = closed
    other = disturbed(model, data, 5)
    given = state(other).copy()
    needed = Projector(model, cut).project(other, ANYWHERE).moved
    other.qpos[:], other.qvel[:] = given[: model.nq], given[model.nq :]
    projection = Projector(model, cut).project(other, fraction * needed)
    if fraction < 1:
        assert (projection.status, projection.rounds, projection.moved) == ("too-far", 0, 0.0)
        np.testing.assert_array_equal(state(other), given)
    else:
        assert projection.status == "landed"
    assert gap(other) == np.abs(other.efc_pos[: other.ne]).max()


def test_no_trust_makes_a_jump():
    setup = setup_of(load_case("boat"))
    other = disturbed(setup.model, setup.data(), 5, size=1.0)
    given = state(other).copy()
    assert Projector(setup.model).project(other, 1e9).status == "too-far"
    np.testing.assert_array_equal(state(other), given)


def test_what_was_refused_is_tried_again_with_the_way_of_both_steps(closed):
    model, cut, data = closed
    other = disturbed(model, data, 5)
    given = other.qpos.copy()
    needed = Projector(model, cut).project(other, ANYWHERE).moved
    projector = Projector(model, cut)
    found = []
    for _ in range(3):
        other.qpos[:] = given
        found.append(projector.project(other, 0.6 * needed).status)
    assert found == ["too-far", "landed", "too-far"]  # once landed, the way begins anew


def test_unknown_solver_is_refused():
    setup = setup_of(load_case("boat"))
    with pytest.raises(InputError, match="no option 'predicts'"):
        Projector(setup.model, solver=SolverSpec("sr1-tracked", (("predicts", 0.0),)))


# In runs.


@pytest.mark.parametrize("integrator", ["euler", "implicitfast", "rk4"])
def test_projected_boat_stays_closed(integrator):
    results = run(
        "boat",
        mode="free",
        form="hard",
        solver="sr1-tracked",
        integrator=integrator,
        stabilisation="projection",
        duration=0.5,
    )
    row = only(results.rows, mode="free")
    assert row["run"] == f"free-hard-sr1-tracked-projection-{integrator}"
    assert (row["status"], row["stabilisation"], row["unprojected"]) == ("done", "projection", 0)
    assert row["drift_pos_max"] <= PROJECTED
    assert row["drift_vel_max"] <= PROJECTED
    assert 0 < row["projection_rounds_mean"] <= row["projection_rounds_max"] <= 2
    assert row["projection_iterations_mean"] > 0
    if integrator == "rk4":
        assert row["truth_error_max"] <= HARD_DRIFT
        steps = frames_of(results)[-1]
        assert (steps["projection_solves"] >= steps["projection_rounds"]).all()
        assert steps["projection"].to_list() == ["landed"] * 500


def test_both_stabilises_twice_and_baumgarte_not_by_projection():
    rows = {}
    for stabilisation in ("baumgarte", "projection", "both"):
        results = run("boat", mode="free", form="hard", solver="pinv", stabilisation=stabilisation, duration=0.3)
        rows[stabilisation] = only(results.rows, mode="free")
    assert rows["baumgarte"]["run"] == "free-hard-pinv-rk4"
    assert rows["both"]["run"] == "free-hard-pinv-both-rk4"
    assert rows["baumgarte"]["projection_rounds_max"] is rows["baumgarte"]["unprojected"] is None
    assert rows["both"]["drift_pos_max"] <= PROJECTED < rows["baumgarte"]["drift_pos_max"]
    assert rows["both"]["drift_acc_max"] != rows["projection"]["drift_acc_max"]  # Baumgarte sees rounding times k


def test_projection_has_no_baumgarte_terms(tmp_path):
    """k dt² = 100 diverges with Baumgarte's terms (another test); without them it does not matter what they are."""
    toml = 'title = "stiff"\nstart.qpos.crank = 1.0\nbaumgarte = {beta = 1000.0, k = 2.5e7}\nrun.duration_s = 0.5'
    path = write_model(tmp_path, four_bar(), toml + '\nrun.stabilisation = "projection"')
    results = run(path, mode="free", solver="pinv", form="hard", integrator="euler", timestep=2e-3)
    row = only(results.rows, mode="free")
    assert (row["status"], row["stabilisation"]) == ("done", "projection")  # the case's, for none was asked for
    assert row["drift_pos_max"] <= CLOSED
    asked = run(path, mode="free", solver="pinv", form="hard", integrator="euler", timestep=2e-3, stabilisation="both")
    assert only(asked.rows, mode="free")["stabilisation"] == "both"


def test_stabilisation_of_every_kind_of_run():
    """Where nothing is stabilised there is none; a single step is never projected, a hard walker is."""
    results = run("boat", solver=["pinv", "mujoco"], stabilisation="projection", duration=0.02)
    assert {row["mode"] for row in results.rows} == {"calibration", "lockstep", "one-step", "free"}
    for row in results.rows:
        hard = row["form"] == "hard"
        assert row["stabilisation"] == ("projection" if hard else None)
        assert ("projection" in row["run"]) == hard
        assert (row["projection_rounds_max"] is not None) == (hard and row["mode"] == "free")
    walked = run("boat", mode="lockstep", walker="pinv", solver="pinv", stabilisation="projection", duration=0.2)
    for form in ("matched", "hard"):
        row = only(walked.rows, mode="lockstep", form=form)
        assert row["stabilisation"] == "projection"
        assert row["drift_pos_max"] <= PROJECTED
        assert row["unprojected"] == 0


def test_experiments_take_their_own_stabilisation(tmp_path):
    toml = """title = "two"
start.qpos.crank = 1.0
run = { duration_s = 0.02, stabilisation = "projection" }
[[experiments]]
mode = "free"
[[experiments]]
mode = "free"
stabilisation = "baumgarte"
"""
    results = run(write_model(tmp_path, four_bar(), toml), out=tmp_path / "out")
    assert [row["run"] for row in results.rows] == ["free-hard-pinv-projection-rk4", "free-hard-pinv-rk4"]
    assert len(list((tmp_path / "out" / "steps").iterdir())) == 2


LIFT = """<mujoco>
  <default><geom contype="0" conaffinity="0" type="capsule" size="0.01" mass="0.2"/>
    <joint axis="0 1 0" damping="0.02"/></default>
  <worldbody>
    <body name="left" pos="-0.15 0 0"><joint name="left"/><geom fromto="0 0 0 0.1 0 -0.3"/>
      <body name="plate" pos="0.1 0 -0.3"><joint name="wrist"/>
        <geom type="box" size="0.15 0.05 0.01" pos="0.15 0 0" mass="2"/></body></body>
    <body name="right" pos="0.15 0 0"><joint name="right"/><geom fromto="0 0 0 0.1 0 -0.3"/></body>
  </worldbody>
  <equality><connect body1="right" body2="plate" anchor="0.1 0 -0.3"/></equality>
  <actuator><position name="lift" joint="left" kp="40" kv="4"/></actuator>
</mujoco>"""
"""A plate on two light arms that a servo lifts."""


@pytest.mark.parametrize("stepping", ["native", "python"])
def test_a_turning_point_does_not_end_projection(tmp_path, stepping):
    """The arms turn back with next to no velocity before and after a step of 10 ms, which opens the loop anyway."""
    toml = 'title = "lift"\nrun.duration_s = 2.0\ndrive.ctrl.lift = "-1.0"'
    path = write_model(tmp_path, LIFT, toml)
    asked = RunOptions(mode="free", form="hard", solver="auto", integrator="implicitfast", timestep=0.01)
    row = only(run(path, asked, stepping=stepping).rows, mode="free")
    assert (row["status"], row["unprojected"]) == ("done", 0)
    assert row["drift_pos_max"] <= PROJECTED


def test_projections_that_do_not_land_are_a_status():
    """At 0.1 s Euler's steps lead so far away that there is no way back that is not a jump."""
    results = run(
        "boat", mode="free", form="hard", solver="pinv", integrator="euler", stabilisation="projection", timestep=0.1
    )
    row, steps = only(results.rows, mode="free"), frames_of(results)[-1]
    assert row["status"] in ("unprojected", "diverged")
    assert row["unprojected"] == (steps["projection"] != "landed").sum() > 0
    assert "too-far" in steps["projection"].to_list()


@pytest.mark.parametrize("solver", ["pinv", "sr1-tracked"])
def test_projection_carries_through_singular_poses(tmp_path, solver):
    """A parallelogram that turns over passes a pose of rank 1 twice a turn, where another branch of motion begins."""
    toml = """title = "parallelogram"
baumgarte = { beta = 5.0, k = 1e4 }
run.duration_s = 3.0
[start]
qpos = { crank = 0.1, coupler = -0.1, rocker = 0.1 }
qvel = { crank = 3.0, coupler = -3.0, rocker = 3.0 }
"""
    path = write_model(tmp_path, parallelogram(), toml)
    rows, paths = {}, {}
    for stabilisation in ("projection", "baumgarte"):
        results = run(path, mode="free", form="hard", solver=solver, timestep=2e-3, stabilisation=stabilisation)
        rows[stabilisation] = only(results.rows, mode="free")
        paths[stabilisation] = np.array(frames_of(results)[-1]["qpos"].to_list())
    projected, turned = rows["projection"], paths["projection"]
    assert (projected["status"], projected["unprojected"]) == ("done", 0)
    assert np.ptp(turned[:, 0]) > 2 * np.pi
    assert np.abs(turned[:, 0] - turned[:, 2]).max() <= STRAIGHT_WAY  # still a parallelogram, never the crossed one
    assert projected["drift_pos_max"] <= CLOSED
    assert projected["energy_drift_rel"] <= SINGULAR_ENERGY
    assert rows["baumgarte"]["energy_drift_rel"] > SINGULAR_ENERGY_LOST


SLIDERS = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body><joint name="near" type="slide" axis="1 0 0" limited="true" range="-1 0"/><geom size="0.1" mass="1"/></body>
    <body pos="0 1 0"><joint name="far" type="slide" axis="1 0 0"/><geom size="0.1" mass="3"/></body>
  </worldbody>
  <equality><joint joint1="near" JOINT2 polycoef="0.01 SLOPE 0 0 0"/></equality>
</mujoco>"""
"""Two masses on rails; the first is at its limit."""


def test_a_projection_does_not_push_what_is_at_its_limit_where_it_has_a_choice():
    """The masses must come apart by 0.01 m: freely by 3/4 and 1/4 of it, but the light one is beyond its limit."""
    model = mujoco.MjModel.from_xml_string(SLIDERS.replace("JOINT2", 'joint2="far"').replace("SLOPE", "1"))
    for beyond, moved in ((-0.5, 0.0075), (1e-3, 0.0)):
        data = mujoco.MjData(model)
        data.qpos[:] = beyond, beyond
        projector = Projector(model)
        assert projector.project(data, gone=0.1).status == "landed"
        np.testing.assert_allclose(data.qpos, [beyond + moved, beyond + moved - 0.01], atol=1e-10)
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = (beyond, beyond - 0.01), (-0.4, 0.0)
        projector.project(data, gone=0.1)
        np.testing.assert_allclose(data.qvel, [-0.1, -0.1], atol=1e-10)  # away from the limit: as freely


def test_loops_have_the_last_word_where_there_is_no_choice():
    model = mujoco.MjModel.from_xml_string(SLIDERS.replace("JOINT2", "").replace("SLOPE", "0"))
    data = mujoco.MjData(model)
    data.qpos[0] = 1e-3
    assert Projector(model).project(data, gone=0.1).status == "landed"
    assert data.qpos[0] == pytest.approx(0.01, abs=1e-12)
