"""The row law: it holds on every model, its parts add up, and what it says is confirmed by reruns and by other ways."""

import mujoco
import numpy as np
import pytest
import scipy.linalg
from gallery import Piece, piece
from mechanisms import INTEGRATORS, TANGLE, relative
from oarlock import model_names
from oarlock.cases.case_file import Baumgarte
from oarlock.diagnosis.runs.recording import Recording, record
from oarlock.diagnosis.runs.row_law import CAUSES, HOLDS, attribute, step_maps
from oarlock.mechanics.load import load_model
from oarlock.stepping.question import Question
from oarlock.stepping.solvers import SolverSpec
from oarlock.stepping.state import State
from places import FIXTURES
from tolerances import (
    ACCELERATION_PARTS,
    HALF_A_TIMESTEP,
    OSCILLATOR,
    PARTS_SUM,
    REDUNDANT_PARTS,
    SAME_PART,
    WORK_OF_ROWS,
)

COMPLIANCE, CURVATURE, SOLVER, START, STEPPING = range(5)


def recorded(one: Piece, steps: int) -> Recording:
    return record(one.model, one.qpos, one.qvel, one.laws, steps)


def softened(one: Piece, solref=None, solimp=None) -> Piece:
    if solref is not None:
        one.model.eq_solref[:] = solref
    if solimp is not None:
        one.model.eq_solimp[:] = solimp
    return one


# The law itself.


@pytest.mark.parametrize("integrator", ["euler", "rk4"])
@pytest.mark.parametrize("name", model_names())
def test_it_holds_on_every_model(name, integrator):
    recording = recorded(piece(name, integrator), 300)
    assert recording.end.how == "finished"
    attribution = attribute(recording)
    assert attribution.holds
    assert attribution.defect < HOLDS
    apart = np.abs(attribution.position.sum(axis=0) - recording.position).max()
    assert apart <= PARTS_SUM * max(1.0, recording.drift.max())
    law = attribution.acceleration.sum(axis=0) - (recording.reached + recording.curvature)
    assert np.abs(law).max() <= HOLDS * np.abs(recording.aref).max()


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_it_holds_for_every_kind_of_row_of_an_open_tangle(integrator):
    model = mujoco.MjModel.from_xml_string(TANGLE)
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    velocity = np.random.default_rng(0).normal(size=model.nv)
    attribution = attribute(record(model, model.qpos0, velocity, {}, 100))
    assert attribution.defect < HOLDS
    assert {share.name for share in attribution.shares} >= {"connect sites", "weld bodies", "angles", "line"}
    for share in attribution.shares:
        assert sum(share.shares.values()) == pytest.approx(1.0)
        assert sum(share.over_run.values()) == pytest.approx(1.0)


def test_it_says_where_it_does_not_describe_the_run():
    """The discrete integrator changes what MuJoCo asks of its rows."""
    one = piece("gripper")
    one.model.opt.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    attribution = attribute(recorded(one, 50))
    assert attribution.recording.integrator == "discrete"
    assert not attribution.holds


def test_contacts_and_limits_do_not_disturb_it():
    model = load_model(FIXTURES / "hopper.xml")
    recording = record(model, model.key_qpos[0].copy(), np.zeros(model.nv), {}, 400)
    assert recording.others.max() > 8
    assert attribute(recording).defect < HOLDS


# The oscillator.


@pytest.mark.parametrize(
    ("spring", "damping"), [(0.0, 0.0), (0.0, 90.0), (2500.0, 100.0), (1e6, 1e3), (4e6, 10.0), (1e8, 3e5)]
)
def test_step_maps_are_exponentials(spring, damping):
    h = 1e-3
    whole = scipy.linalg.expm([[0, 1, 0, 0], [-spring * h * h, -damping * h, 1, 0], [0, 0, 0, 1], [0, 0, 0, 0]])
    found = step_maps(np.array([spring, 1.0]), np.array([damping, 2.0]), h)
    for value, expected in zip(found, (whole[:2, :2], whole[:2, 2], whole[:2, 3]), strict=True):
        assert np.abs(value[0] - expected).max() <= OSCILLATOR * np.abs(whole).max()


def test_an_open_start_fades_as_an_oscillator():
    """Constant d makes K d and B constant: the start's part is one oscillator's free motion, whatever else moves."""
    one = softened(piece("four_bar", "rk4"), (0.02, 1.0), (0.95, 0.95, 0.001, 0.5, 2.0))
    qpos = one.qpos.copy()
    qpos[2] += 1e-3
    recording = record(one.model, qpos, one.qvel, {}, 200)
    attribution = attribute(recording)
    row = int(np.abs(recording.position[0]).argmax())
    spring = recording.stiffness[0, row] * 0.95
    damping = recording.damping[0, row]
    system = np.array([[0.0, 1.0], [-spring, -damping]])
    initial = [recording.position[0, row], recording.velocity[0, row]]
    expected = [(scipy.linalg.expm(time * system) @ initial)[0] for time in recording.time]
    assert relative(attribution.position[START, :, row], expected) < OSCILLATOR * 200
    assert abs(attribution.position[START, 0, row]) > 1e-4
    assert (np.delete(attribution.position[:, 0], START, axis=0) == 0.0).all()


# The figures of the gallery, and what reruns say of them.


def test_boat_is_soft():
    recording = recorded(piece("boat"), 2000)
    share = attribute(recording).worst
    assert (share.leading, share.unit) == ("compliance", "m")
    assert np.abs(recording.position).max() == pytest.approx(1.9e-4, rel=0.03)
    points = recording.position[:, recording.layout.of_equality(0)]
    apart = np.linalg.norm(points, axis=1)  # the moment of the distance, not of a row
    assert (share.time_s, abs(share.worst)) == (recording.time[apart.argmax()], np.abs(points[apart.argmax()]).max())
    assert share.shares["compliance"] == pytest.approx(1.006, abs=0.01)


def test_fast_four_bar_drifts_by_its_timestep():
    one = piece("four_bar")
    assert one.qvel[0] == 12.0  # rad/s
    share = attribute(recorded(one, 2000)).worst
    assert (share.leading, share.label) == ("stepping", "pin z")
    assert abs(share.worst) == pytest.approx(1.9e-3, rel=0.02)
    assert 1.0 < share.shares["stepping"] < 1.2
    assert share.shares["compliance"] < 0.0  # they oppose one another
    fine = attribute(recorded(piece("four_bar", "rk4"), 2000)).worst
    assert fine.rms["stepping"] < 1e-3 * share.rms["stepping"]


def test_the_part_of_stepping_is_of_eulers_order():
    coarse, fine = (attribute(recorded(piece("four_bar", "euler", 1e-3 / n), 500 * n)).position for n in (1, 2))
    ratio = np.sqrt(np.square(coarse[STEPPING]).mean() / np.square(fine[STEPPING]).mean())
    assert ratio == pytest.approx(2.0, rel=HALF_A_TIMESTEP)


def test_gear_train_misses_its_curvature():
    attribution = attribute(recorded(piece("gear_train"), 2000))
    share = attribution.worst
    assert (share.leading, share.unit) == ("curvature", "rad")
    assert share.shares["curvature"] > 0.9
    # With another softness that part stays and only compliance changes.
    other = piece("gear_train")
    other.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_DIAGEXACT
    changed = attribute(recorded(other, 300)).position
    same, softer = (relative(changed[part], attribution.position[part, :300]) for part in (CURVATURE, COMPLIANCE))
    assert same < SAME_PART < 0.1 < softer


def test_welded_frame_is_soft_because_mujoco_takes_its_rows_for_heavier():
    recording = recorded(piece("welded_frame"), 1000)
    share = attribute(recording).worst
    assert share.leading == "compliance"
    assert share.unit == "rad"
    assert share.shares["compliance"] == pytest.approx(1.0, abs=0.01)
    assert recording.scale[share.row] > 8.0
    exact = piece("welded_frame")
    exact.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_DIAGEXACT
    better = recorded(exact, 1000)
    assert better.scale == pytest.approx(np.ones(6))
    assert better.drift.max() < 0.2 * recording.drift.max()


def test_a_solver_that_is_stopped_early_opens_the_loop():
    """PGS with one sweep a step; with a hundred it is Newton's drift again."""
    shares, drifts = [], []
    for sweeps in (1, 100):
        one = piece("boat")
        one.model.opt.solver, one.model.opt.iterations = mujoco.mjtSolver.mjSOL_PGS, sweeps
        attribution = attribute(recorded(one, 500))
        assert attribution.defect < HOLDS
        shares.append(attribution.worst.shares["solver"])
        drifts.append(attribution.recording.drift.max())
    newton = attribute(recorded(piece("boat"), 500))
    assert shares[0] == pytest.approx(1.0, abs=0.05)
    assert abs(shares[1]) < 1e-3
    assert drifts[0] > 10 * drifts[1]
    assert drifts[1] == pytest.approx(newton.recording.drift.max(), rel=1e-2)
    assert newton.worst.rms["solver"] < 1e-9 * newton.worst.total


@pytest.mark.parametrize("name", ["four_bar", "bricard", "welded_frame"])
def test_energy_is_lost_in_the_loops(name):
    recording = recorded(piece(name, "rk4"), 1000)
    attribution = attribute(recording)
    lost = recording.energy.sum(axis=1)[-1] - recording.energy.sum(axis=1)[0]
    assert sum(share.work for share in attribution.shares) == pytest.approx(lost, rel=WORK_OF_ROWS)
    assert attribution.work[-1].sum() == pytest.approx(lost, rel=WORK_OF_ROWS)


# Accelerations.


@pytest.mark.parametrize("name", ["boat", "bricard", "gear_train", "welded_frame", "four_bar"])
def test_accelerations_differ_from_exact_ones_by_their_parts(name):
    """Exact ones by the hard form's own question at the recorded states, with a cut that redundant rows need there."""
    one = piece(name)
    recording = recorded(one, 400)
    found = attribute(recording).accelerations(np.array([50, 200, 399]))
    data = mujoco.MjData(one.model)
    state = State(one.model, data, Baumgarte())
    question = Question(state, "hard")
    solver = SolverSpec("pinv", (("rank_cut", 1e-6),)).make()
    redundant = name in ("boat", "bricard")
    tolerance = REDUNDANT_PARTS if redundant else ACCELERATION_PARTS
    scale = np.linalg.norm(found.difference, axis=1).max()
    for place, step in enumerate(found.instants):
        data.qpos[:], data.qvel[:], data.ctrl[:] = recording.qpos[step], recording.qvel[step], recording.ctrl[step]
        mujoco.mj_forward(one.model, data)
        state.read()
        question.ask()
        answer = question.answer(solver)
        apart = recording.qacc[step] - answer.qacc - found.difference[place]
        assert np.linalg.norm(apart) < tolerance * scale
        assert answer.info.rank == found.rank[place]
    leading = {"gear_train": CURVATURE}.get(name, COMPLIANCE)
    sizes = np.linalg.norm(found.parts, axis=2).max(axis=1)
    assert sizes[leading] > 0.3 * sizes.max()
    assert len(found.parts) == len(CAUSES)
