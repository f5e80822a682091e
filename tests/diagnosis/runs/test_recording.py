"""What ``oarlock check`` takes down of a run: MuJoCo as configured, and the exact solution beside it."""

import mujoco
import numpy as np
import pytest
from gallery import piece
from mechanisms import INTEGRATORS, TANGLE, four_bar, relative
from oarlock import InputError
from oarlock.diagnosis.runs.exact import record_exact
from oarlock.diagnosis.runs.recording import record
from oarlock.diagnosis.runs.row_law import attribute
from oarlock.mechanics.controls import drive, laws
from oarlock.mechanics.load import load_model
from oarlock.poses.layout import Layout
from oarlock.stepping import native_path
from places import FIXTURES
from tolerances import CLOSED, LOCKSTEP_PARITY, POWER_BALANCE, WORK_OF_IMPACTS, WORK_OF_ROWS

# Controls.


def hopper() -> mujoco.MjModel:
    return load_model(FIXTURES / "hopper.xml")


def test_keyframe_gives_the_controls_of_actuators_without_names():
    model = hopper()
    given = laws(model, "keyframe")
    assert given == {"#0": "0.5"}
    data = mujoco.MjData(model)
    drive(model, given).apply(data)
    assert data.ctrl[0] == 0.5


def test_random_controls_stay_in_range_use_it_and_repeat():
    model = piece("gripper").model
    model.actuator_ctrllimited[:], model.actuator_ctrlrange[:] = 1, (-0.2, 0.6)
    data = mujoco.MjData(model)
    seen = []
    model.opt.timestep = 0.005
    controls = drive(model, laws(model, "random", seed=3))
    for data.time in np.arange(4000) * 0.005:
        controls.apply(data)
        seen.append(data.ctrl.copy())
    assert np.min(seen) >= -0.2
    assert np.max(seen) <= 0.6
    assert np.ptp(seen) > 0.4
    assert np.abs(np.diff(seen, axis=0)).max() < 0.1  # smooth
    assert laws(model, "random", seed=3) == laws(model, "random", seed=3) != laws(model, "random", seed=4)


def test_mistakes_in_controls_are_named():
    model = hopper()
    with pytest.raises(InputError, match="unknown kind of controls 'sine', expected one of: keyframe"):
        laws(model, "sine")  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="keyframe 3, expected a number from 0 to 0"):
        laws(model, "keyframe", key=3)
    with pytest.raises(InputError, match="unknown actuator 'hip', expected one of: #0"):
        laws(model, "constant", values={"hip": 1.0})
    with pytest.raises(InputError, match="control of actuator '#0' = nan"):
        laws(model, "constant", values={"#0": np.nan})
    with pytest.raises(InputError, match="no keyframe"):
        laws(piece("boat").model, "keyframe")


# Recording.


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_recorded_run_is_mujocos_own(integrator):
    """Bit for bit that of mj_step with the drive as its hook: taking down changes nothing."""
    one = piece("gripper", integrator)
    recording = record(one.model, one.qpos, one.qvel, one.laws, 200)
    data = mujoco.MjData(one.model)
    data.qpos[:], data.qvel[:] = one.qpos, one.qvel
    with drive(one.model, one.laws).installed():
        for step in range(200):
            assert (recording.qpos[step] == data.qpos).all()
            assert (recording.qvel[step] == data.qvel).all()
            mujoco.mj_step(one.model, data)
    assert recording.end.how == "finished"
    assert recording.integrator == integrator
    assert np.ptp(recording.ctrl) > 0.0


def test_the_force_of_a_solver_without_error_is_newtons():
    """And of a solver that is stopped early it is still the same, at the same state."""
    one = piece("stewart")
    newton = record(one.model, one.qpos, one.qvel, one.laws, 50)
    assert relative(newton.force, newton.exact_force) < LOCKSTEP_PARITY
    one.model.opt.solver, one.model.opt.iterations = mujoco.mjtSolver.mjSOL_PGS, 3
    lazy = record(one.model, one.qpos, one.qvel, one.laws, 1)
    assert relative(lazy.force, newton.force[:1]) > 1e-3
    assert relative(lazy.exact_force, newton.force[:1]) < LOCKSTEP_PARITY


def test_rows_keep_their_places_when_mujoco_leaves_some_out():
    """A weld between two fixed bodies has none, and stands first."""
    fixed = '<body name="post" pos="0 1 0"><geom type="sphere" size="0.1"/></body>'
    xml = four_bar().replace("<worldbody>", f"<worldbody>{fixed}")
    xml = xml.replace("<equality>", '<equality><weld name="idle" body1="post" body2="world"/>')
    model = mujoco.MjModel.from_xml_string(xml)
    recording = record(model, model.qpos0, np.array([1.0, -1.0, 0.5]), {}, 20)
    assert recording.layout.labels[:2] == ("idle x", "idle y")
    assert recording.layout.units[3:9] == ("rad", "rad", "rad", "m", "m", "m")
    assert not recording.present[:, :6].any()
    assert recording.present[:, 6:].all()
    assert (recording.position[:, :6] == 0.0).all()
    assert recording.drift.max() > 0.0


def test_a_sparse_jacobian_gives_the_same_rows():
    dense = piece("delta")
    sparse = piece("delta")
    sparse.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    first, second = (record(one.model, one.qpos, one.qvel, one.laws, 30) for one in (dense, sparse))
    for name in ("position", "velocity", "force", "diagonal", "reached"):
        assert relative(getattr(second, name), getattr(first, name)) < LOCKSTEP_PARITY


def test_a_run_that_diverges_says_where():
    model = mujoco.MjModel.from_xml_string(four_bar())
    model.opt.timestep, model.eq_solref[:] = 1e-3, (-1e6, -2e3)
    recording = record(model, model.qpos0, np.array([3.0, -3.0, 2.0]), {}, 1000)
    assert recording.end.how == "diverged"
    assert recording.steps < 1000
    assert recording.end.time_s == pytest.approx(recording.steps * 1e-3)
    assert "acceleration of joint 'c" in recording.end.message
    assert np.isfinite(recording.position).all()


def test_contacts_and_limits_are_counted_and_their_power_is_not_the_loops():
    model = hopper()
    model.opt.timestep = 2e-4  # an impact lasts a few milliseconds
    recording = record(model, model.key_qpos[0].copy(), np.zeros(model.nv), laws(model, "keyframe"), 4000)
    assert recording.others.max() > 8
    assert recording.others_active is not None
    assert recording.others_active[0] == 0.0  # friction, from the start
    theirs = recording.timestep_s * recording.other_power.sum()
    assert theirs < -5.0
    assert recording.energy_error[-1] == pytest.approx(_work(recording), abs=WORK_OF_IMPACTS * abs(theirs))


def _work(recording) -> float:
    rates = 0.5 * (recording.velocity[1:] + recording.velocity[:-1])
    return float(recording.timestep_s * (recording.force[:-1] * rates).sum())


@pytest.mark.parametrize("name", ["four_bar", "gripper", "delta", "crane"])
def test_energy_that_comes_from_nowhere_is_the_work_of_the_loops(name):
    """Under Runge–Kutta: conservative, driven, damped, and with springs and tendons."""
    if name == "crane":
        model = load_model(FIXTURES / "crane.xml")
        model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 1e-3
        recording = record(model, model.qpos0, np.zeros(model.nv), laws(model, "random"), 500)
    else:
        one = piece(name, "rk4")
        recording = record(one.model, one.qpos, one.qvel, one.laws, 500)
    power = (recording.force * recording.velocity).sum(axis=1)
    work = 0.5 * recording.timestep_s * (power[1:] + power[:-1]).sum()
    assert abs(work) > POWER_BALANCE
    assert recording.energy_error[-1] == pytest.approx(work, rel=WORK_OF_ROWS)


def test_what_cannot_be_recorded_is_named():
    model = mujoco.MjModel.from_xml_string(four_bar())
    model.eq_active0[:] = 0
    for take in (record, record_exact):
        with pytest.raises(InputError, match="no active equality, expected at least one"):
            take(model, model.qpos0, np.zeros(3), {}, 10)
    model.eq_active0[:] = 1
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EQUALITY
    with pytest.raises(InputError, match="no equality has a row in this run"):
        record(model, model.qpos0, np.zeros(3), {}, 10)
    model.opt.disableflags = 0
    gone = record(model, model.qpos0, np.array([1e11, 0.0, 0.0]), {}, 10)
    assert (gone.steps, gone.end.how) == (0, "diverged")
    with pytest.raises(InputError, match="nothing to attribute: velocity of joint 'crank' is 1e"):
        attribute(gone)
    model.opt.timestep = 0.0
    with pytest.raises(InputError, match="timestep of the model = 0 s"):
        record(model, model.qpos0, np.zeros(3), {}, 10)


def test_layout_of_a_tangle_follows_mujocos_rows():
    model = mujoco.MjModel.from_xml_string(TANGLE)
    layout = Layout.of(model)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert layout.rows == data.ne
    assert (layout.columns(data.efc_id[: data.ne]) == np.arange(data.ne)).all()
    assert [layout.equalities[owner].index for owner in layout.owner] == data.efc_id[: data.ne].tolist()


# The exact solution.


@pytest.mark.parametrize(("name", "integrator"), [("gripper", "rk4"), ("welded_frame", "euler"), ("bricard", "euler")])
def test_the_exact_run_is_closed_and_the_same_on_both_paths(name, integrator, monkeypatch):
    one = piece(name, integrator)
    runs = []
    if not native_path.refusal():
        runs.append(record_exact(one.model, one.qpos, one.qvel, one.laws, 300))
    monkeypatch.setattr(native_path, "refusal", lambda: "not now")
    runs.append(record_exact(one.model, one.qpos, one.qvel, one.laws, 300))
    for run in runs:
        assert run.end.how == "finished"
        assert run.drift[:, :2].max() < CLOSED
        assert (run.qpos == runs[0].qpos).all()
        assert (run.force == runs[0].force).all()
        assert run.integrator == integrator
    soft = record(one.model, one.qpos, one.qvel, one.laws, 300)
    assert (soft.layout.labels, len(soft.time)) == (runs[0].layout.labels, len(runs[0].time))
    assert 0.0 < np.abs(soft.qpos - runs[0].qpos).max() < 0.1


def test_the_exact_run_goes_on_where_a_limit_is_met():
    xml = four_bar(rocker='limited="true" range="-0.3 0.3"')
    model = mujoco.MjModel.from_xml_string(xml)
    run = record_exact(model, model.qpos0, _along(model), {}, 2000)
    assert (run.end.how, len(run.qpos)) == ("finished", 2000)
    assert run.drift[:, 0].max() < CLOSED
    assert 0.3 < np.abs(run.qpos[:, 2]).max() < 0.35
    assert run.loads[:, 0].max() > 0
    assert not run.loads[:, 1:].any()
    soft = record(model, model.qpos0, _along(model), {}, 2000)
    (push,) = soft.pushes
    assert (push.kind, push.name) == ("limit", "limit of joint 'rocker'")
    assert 0 < push.first_s < push.last_s
    assert push.largest == pytest.approx(run.loads[:, 0].max(), rel=0.2)


def _along(model: mujoco.MjModel) -> np.ndarray:
    """A velocity that the four-bar's loop admits."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    jacobian = data.efc_J[: data.ne * model.nv].reshape(data.ne, model.nv)
    return 2.0 * np.linalg.svd(jacobian)[2][-1]
