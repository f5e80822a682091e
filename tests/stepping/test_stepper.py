"""Exact steps on data of one's own are those of a run."""

import copy

import mujoco
import numpy as np
import oarlock
import pytest
from mechanisms import four_bar
from oarlock.base.errors import InputError
from oarlock.cases.case import load_case
from oarlock.stepping.prepared import PreparedCase
from oarlock.stepping.stepper import STABILISATIONS

MORE = '<body><joint name="more"/><geom type="sphere" size="0.1"/></body>'

EXACT = 1e-12
"""What the documentation promises between a run and its steps, rad or m, and relative of multipliers."""


def prepared(name: str, integrator: str = "euler") -> PreparedCase:
    return PreparedCase(load_case(name), None, integrator, "default")


def driven(case: PreparedCase):
    """Writes the controls of a case into a data, as a loop of one's own would."""
    drive = case.drive
    return lambda data: drive.apply(data)


def run_of(name: str, integrator: str, steps: int, solver: str = "auto"):
    case = prepared(name, integrator)
    results = oarlock.run(
        name,
        mode="free",
        form="hard",
        solver=solver,
        integrator=integrator,
        stabilisation="projection",
        duration=steps * case.timestep_s,
    )
    return results.steps.filter(results.steps["mode"] == "free")


@pytest.mark.parametrize(
    ("name", "integrator", "steps"),
    [
        ("boat", "euler", 300),
        ("gripping_gripper", "euler", 400),
        ("gripping_gripper", "implicitfast", 400),
        ("standing_leg", "euler", 200),
        ("four_bar", "rk4", 200),
        ("net:tree=1", "euler", 50),
    ],
)
def test_its_steps_are_those_of_a_run(name, integrator, steps):
    """Of the boat with its motor, and of a gripper that closes on a box: contacts and limits among them."""
    case = prepared(name, integrator)
    stepper, data = oarlock.Stepper(case.model), case.data()
    write = driven(case)
    rows = run_of(name, integrator, steps)
    for qpos, multipliers, active in zip(rows["qpos"], rows["multipliers"], rows["active"], strict=True):
        assert np.abs(data.qpos - qpos.to_numpy()).max() <= EXACT
        write(data)
        stepper.step(data)
        figures, wanted = stepper.figures(), multipliers.to_numpy()
        if integrator != "rk4":  # of which the last solve is that of its last stage
            assert np.abs(figures.multipliers - wanted).max() <= EXACT * max(1.0, np.abs(wanted).max())
        assert figures.active == active
        assert figures.status == "converged"
        assert figures.drift < 1e-12
    assert data.time == pytest.approx(steps * case.timestep_s)


def test_a_loop_of_ones_own_keeps_its_loops_closed_where_mujoco_lets_them_open():
    model = mujoco.MjModel.from_xml_string(four_bar())
    exact, soft = mujoco.MjData(model), mujoco.MjData(model)
    exact.qvel[0] = soft.qvel[0] = 6.0
    stepper = oarlock.Stepper(model)
    stepper.close(exact)
    open_by = 0.0
    for _ in range(500):
        stepper.step(exact)
        mujoco.mj_step(model, soft)
        mujoco.mj_fwdPosition(model, soft)
        open_by = max(open_by, np.abs(soft.efc_pos[: soft.ne]).max())
        assert stepper.figures().drift < 1e-14
        assert stepper.figures().projection == "landed"
    assert open_by > 1e-5


def test_forces_and_controls_of_the_data_are_taken_and_what_a_step_found_is_left_there():
    model = mujoco.MjModel.from_xml_string(four_bar(rest='<actuator><motor name="m" joint="crank"/></actuator>'))
    stepper, data = oarlock.Stepper(model), mujoco.MjData(model)
    stepper.close(data)
    stepper.step(data)
    plain = data.qacc.copy()
    assert np.allclose(data.qfrc_constraint, _transposed(model, data) @ stepper.figures().multipliers, atol=1e-12)
    for field, place, value in (("ctrl", 0, 3.0), ("qfrc_applied", 2, 1.0), ("xfrc_applied", 2, 5.0)):
        other = mujoco.MjData(model)
        stepper.close(other)
        getattr(other, field)[place] = value
        stepper.step(other)
        assert np.abs(other.qacc - plain).max() > 1e-3


def _transposed(model, data):
    """Jᵀ of the state that the data had at the start of its last step, which is closed as this one is."""
    before = mujoco.MjData(model)
    oarlock.Stepper(model).close(before)
    mujoco.mj_forward(model, before)
    jacobian = np.zeros((before.nefc, model.nv))
    mujoco.mju_sparse2dense(
        jacobian, before.efc_J, before.efc_J_rownnz, before.efc_J_rowadr, before.efc_J_colind
    ) if mujoco.mj_isSparse(model) else jacobian.__setitem__(slice(None), before.efc_J.reshape(-1, model.nv))
    return jacobian[: before.ne].T


def test_many_data_at_once_are_the_same_as_each_alone():
    case = prepared("gripping_gripper")
    rates = np.linspace(-0.2, 0.2, 5)
    alone, together = [], []
    ctrl = np.tile(np.linspace(0.0, 0.3, 60)[:, None], (len(rates), 1, case.model.nu))
    for number, rate in enumerate(rates):
        data = case.data()
        data.qvel[0] += rate
        together.append(copy.copy(data))
        stepper = oarlock.Stepper(case.model)
        path = []
        for step in range(60):
            data.ctrl[:] = ctrl[number, step]
            stepper.step(data)
            path.append((data.qpos.copy(), data.qvel.copy()))
        alone.append(path)
    stepper = oarlock.Stepper(case.model)
    qpos, qvel = stepper.rollout(together, control=ctrl)
    assert qpos.shape == (5, 60, case.model.nq)
    for number, path in enumerate(alone):
        assert np.array_equal(qpos[number], [one[0] for one in path])
        assert np.array_equal(qvel[number], [one[1] for one in path])
        assert np.array_equal(together[number].qpos, path[-1][0])
    assert stepper.figures(4).status == "converged"
    assert stepper.figures(5) is None


def test_baumgarte_pulls_back_what_is_open_and_nothing_does_where_nothing_is_asked():
    model = mujoco.MjModel.from_xml_string(four_bar())
    left = {}
    for how in STABILISATIONS:
        data = mujoco.MjData(model)
        data.qvel[0] = 6.0
        stepper = oarlock.Stepper(model, stabilisation=how)
        stepper.close(data)
        for _ in range(2000):
            stepper.step(data)
        left[how] = stepper.figures().drift
        assert (stepper.figures().projection is None) == (how in ("baumgarte", "none"))
    assert left["projection"] < 1e-14
    assert left["both"] < 1e-14
    assert 1e-14 < left["baumgarte"] < 0.1 * left["none"]


def test_energy_of_a_conservative_mechanism_stays():
    case = prepared("four_bar", "rk4")
    stepper, data = oarlock.Stepper(case.model), case.data()
    before = sum(stepper.energy(data))
    for _ in range(1000):
        stepper.step(data)
    assert sum(stepper.energy(data)) == pytest.approx(before, rel=1e-7)


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda model, other: oarlock.Stepper(3), "model is a int, expected an MjModel"),
        (lambda model, other: oarlock.Stepper(model, stabilisation="hope"), "unknown stabilisation 'hope'"),
        (lambda model, other: oarlock.Stepper(model, solver="nope"), "unknown solver 'nope'"),
        (lambda model, other: oarlock.Stepper(model).step(3), "data is a int, expected an MjData"),
        (
            lambda model, other: oarlock.Stepper(model).step(mujoco.MjData(other)),
            "of a model with nq = 4, expected 3",
        ),
        (lambda model, other: oarlock.Stepper(model).rollout([mujoco.MjData(model)]), "steps = None, expected a whole"),
        (
            lambda model, other: oarlock.Stepper(model).rollout([mujoco.MjData(model)], control=np.zeros((2, 3, 0))),
            r"control of the shape \(2, 3, 0\), expected \(1, steps, 0\)",
        ),
        (
            lambda model, other: oarlock.Stepper(model).rollout(2 * [mujoco.MjData(model)], steps=2),
            r"data\[1\] is there twice",
        ),
    ],
)
def test_what_cannot_be_is_one_line(call, line):
    model = mujoco.MjModel.from_xml_string(four_bar())
    other = mujoco.MjModel.from_xml_string(
        four_bar(rest="").replace(
            "</worldbody>", '<body><joint name="more"/><geom type="sphere" size="0.1"/></body></worldbody>'
        )
    )
    with pytest.raises(InputError, match=line):
        call(model, other)


def test_the_data_of_another_model_of_the_same_size_is_refused():
    model = mujoco.MjModel.from_xml_string(four_bar())
    stepper = oarlock.Stepper(model)
    other = mujoco.MjModel.from_xml_string(four_bar(pivot="0.71 0 0"))
    for call in (stepper.step, stepper.close, stepper.energy, lambda data: stepper.rollout([data], steps=1)):
        with pytest.raises(InputError, match=r"data of another model of the same size, whose \w+ differs"):
            call(mujoco.MjData(other))
    same, painted = (mujoco.MjModel.from_xml_string(four_bar()) for _ in range(2))
    painted.geom_rgba[:] = 0.5
    model.body_mass[:] *= 2.0  # later changes are not seen, and its data stay its own
    for one in (model, same, painted):
        stepper.step(mujoco.MjData(one))
        stepper.step(mujoco.MjData(one))


@pytest.mark.parametrize(
    "change",
    [
        lambda model: setattr(model.opt, "timestep", 1e-3),
        lambda model: setattr(model.opt, "integrator", int(mujoco.mjtIntegrator.mjINT_RK4)),
        lambda model: model.opt.gravity.fill(0.0),
        lambda model: setattr(model.opt, "viscosity", 0.1),
        lambda model: setattr(model.opt, "cone", int(mujoco.mjtCone.mjCONE_ELLIPTIC)),
        lambda model: setattr(model.opt, "disableflags", int(mujoco.mjtDisableBit.mjDSBL_CONTACT)),
        lambda model: setattr(model.opt, "enableflags", int(mujoco.mjtEnableBit.mjENBL_ENERGY)),
        lambda model: setattr(model.opt, "disableactuator", 1),
    ],
    ids=["timestep", "integrator", "gravity", "viscosity", "cone", "disableflags", "enableflags", "disableactuator"],
)
def test_options_that_change_later_are_refused(change):
    model = mujoco.MjModel.from_xml_string(four_bar())
    stepper, data = oarlock.Stepper(model), mujoco.MjData(model)
    stepper.step(data)
    change(model)
    before = data.time, data.qpos.tolist()
    for call in (stepper.step, lambda data: stepper.rollout([data], steps=1)):
        with pytest.raises(InputError, match=r"the model's options .* changed after the stepper was made"):
            call(data)
    assert (data.time, data.qpos.tolist()) == before
    oarlock.Stepper(model).step(data)


def test_a_state_without_numbers_is_refused_and_the_stepper_goes_on():
    model = mujoco.MjModel.from_xml_string(four_bar())
    stepper, data, good = oarlock.Stepper(model), mujoco.MjData(model), mujoco.MjData(model)
    data.qvel[0] = np.nan
    with pytest.raises(InputError, match=r"the state at t = 0.* s is not finite"):
        stepper.step(data)
    stepper.step(good)
    assert good.time == pytest.approx(model.opt.timestep)
    with pytest.raises(InputError, match=r"data\[1\]: the state at t = 0"):
        stepper.rollout([good, data], steps=3)


def test_an_open_start_is_refused_and_a_closed_one_goes_on():
    """What a projection would have to move further than a step goes is no exact step."""
    model = mujoco.MjModel.from_xml_string(four_bar())
    data, stepper = mujoco.MjData(model), oarlock.Stepper(model)
    data.qvel[0] = 2.0
    with pytest.raises(
        InputError, match=r"the velocities at t = 0.0* s take the loops apart by .* m/s or rad/s: close the start first"
    ):
        stepper.step(data)
    other, rolled = mujoco.MjData(model), oarlock.Stepper(model)
    other.qvel[0] = 2.0
    with pytest.raises(InputError, match=r"data\[0\]: the velocities at t = 0"):
        rolled.rollout([other], steps=100)
    bent = mujoco.MjData(model)
    bent.qpos[0] += 0.3
    with pytest.raises(InputError, match=r"the loops stand open by .* close the start first \(stepper.close"):
        oarlock.Stepper(model).step(bent)
    # The data are where they were.
    assert (data.time, data.qvel.tolist(), data.qpos.tolist()) == (0.0, [2.0, 0.0, 0.0], model.qpos0.tolist())
    assert (other.time, bent.time) == (0.0, 0.0)
    stepper.close(data)
    stepper.reset()
    for _ in range(100):
        stepper.step(data)
    assert stepper.figures().projection == "landed"


def test_a_motion_that_is_too_fast_for_the_timestep_is_said_to_be():
    """Nothing is wrong with the start of such a step, which is closed."""
    model = mujoco.MjModel.from_xml_string(four_bar())
    data, stepper = mujoco.MjData(model), oarlock.Stepper(model)
    data.qvel[0] = 400.0
    stepper.close(data)

    def walk():
        for _ in range(1000):
            stepper.step(data)

    with pytest.raises(InputError, match=r"a step of 0\.\d+ s from closed loops at t = .* take a shorter one"):
        walk()
    assert np.isfinite(data.qpos).all()


def _elsewhere_and_back(model, data):
    """As a finite difference leaves a data: its pose as it was, what was computed of it that of another."""
    qpos = data.qpos.copy()
    data.qpos[:] += 0.1
    mujoco.mj_forward(model, data)
    data.qpos[:] = qpos


def _kinematics_elsewhere(model, data):
    qpos = data.qpos.copy()
    data.qpos[:] += 0.1
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    data.qpos[:] = qpos


def _reset_and_put_back(model, data):
    time, qpos, qvel = data.time, data.qpos.copy(), data.qvel.copy()
    mujoco.mj_resetData(model, data)
    data.time, data.qpos[:], data.qvel[:] = time, qpos, qvel


def _without_rows(model, data):
    data.eq_active[:] = 0
    mujoco.mj_forward(model, data)
    data.eq_active[:] = 1


@pytest.mark.parametrize("touch", [_elsewhere_and_back, _kinematics_elsewhere, _reset_and_put_back, _without_rows])
@pytest.mark.parametrize("name", ["boat", "gripping_gripper", "standing_leg", "cable_finger"])
def test_what_is_done_to_the_data_between_steps_changes_no_bit(name, touch):
    """What a step computes at its end is taken for the next one only where nobody touched it."""
    case = prepared(name)
    write = driven(case)
    left, touched = case.data(), case.data()
    one, other = oarlock.Stepper(case.model), oarlock.Stepper(case.model)
    for step in range(60):
        for stepper, data in ((one, left), (other, touched)):
            if data is touched and step % 3 == 2:
                touch(case.model, data)
            write(data)
            stepper.step(data)
        assert left.qpos.tobytes() == touched.qpos.tobytes()
        assert left.qvel.tobytes() == touched.qvel.tobytes()


def test_what_is_written_between_steps_is_seen():
    """A pose, an equality that is switched, and a mocap body that is moved, each by the arrays of the data alone."""
    bodies = (
        '<body name="hand" mocap="true" pos="0 0.3 0"/>'
        '<body name="arm" pos="0 0.3 0"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
        '<geom size="0.1"/></body><body pos="5 0 0"><joint type="slide" axis="0 1 0"/><geom size="0.1"/></body>'
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="0.001"/><worldbody>{bodies}</worldbody>'
        '<equality><connect body1="hand" body2="arm" anchor="0 0 0"/></equality>'
        '<sensor><framepos objtype="body" objname="hand"/></sensor></mujoco>'
    )
    data, stepper = mujoco.MjData(model), oarlock.Stepper(model)
    data.qvel[2] = 1.0  # a step explains 1 mm
    for step in range(1, 50):
        data.mocap_pos[0, 0] = 1e-4 * step
        stepper.step(data)
        assert data.qpos[0] == pytest.approx(data.mocap_pos[0, 0], abs=1e-12)
        assert data.sensordata[0] == data.mocap_pos[0, 0]
    bar = mujoco.MjModel.from_xml_string(four_bar())
    data, stepper = mujoco.MjData(bar), oarlock.Stepper(bar)
    stepper.close(data)
    stepper.step(data)
    data.qpos[0] += 0.2
    stepper.close(data)
    other, fresh = mujoco.MjData(bar), oarlock.Stepper(bar)
    other.qpos[:], other.qvel[:] = data.qpos, data.qvel
    stepper.step(data)
    fresh.step(other)
    assert data.qpos == pytest.approx(other.qpos, abs=1e-14)
    data.eq_active[:] = 0
    with pytest.raises(InputError, match="no equality is active"):
        stepper.step(data)


def test_sensors_and_energies_are_those_of_the_start_of_the_step():
    """As mj_step leaves them, with the forces of the exact step."""
    rest = '<sensor><jointpos joint="crank"/><jointvel joint="crank"/><jointactuatorfrc joint="crank"/></sensor>'
    model = mujoco.MjModel.from_xml_string(four_bar(rest=rest))
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data, stepper = mujoco.MjData(model), oarlock.Stepper(model)
    data.qvel[0] = 2.0
    stepper.close(data)
    for _ in range(50):
        before = data.qpos[0], data.qvel[0], sum(stepper.energy(data))
        stepper.step(data)
        assert data.sensordata[:2].tolist() == list(before[:2])
        assert sum(data.energy) == pytest.approx(before[2], abs=1e-12)


def test_without_an_active_equality_there_is_no_exact_step():
    model = mujoco.MjModel.from_xml_string(four_bar())
    data, stepper = mujoco.MjData(model), oarlock.Stepper(model)
    data.eq_active[:] = 0
    with pytest.raises(InputError, match=r"no equality is active, expected one at least: take mj_step"):
        stepper.step(data)
    with pytest.raises(InputError, match=r"index = -1, expected"):
        stepper.figures(-1)
    with pytest.raises(InputError, match=r"steps = 2\.5, expected a whole number"):
        stepper.rollout([data], steps=2.5)
