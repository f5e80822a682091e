"""Stepping: MuJoCo's own force through our integrators is MuJoCo; what they must not leave out; the drive's hook."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from mechanisms import INTEGRATORS, boat_with, case_of, four_bar, only, setup_of, write_model
from oarlock import InputError, load_case, run
from oarlock.mechanics.drive import Drive
from oarlock.stepping.walkers import ForcedWalker, MujocoForce, MujocoWalker
from tolerances import (
    CALIBRATION,
    CALIBRATION_BROKEN,
    CALIBRATION_SWINGING,
    FROZEN_DRIVE,
    NEWTON_TIGHT,
    RK4_ORDER_HIGH,
    RK4_ORDER_LOW,
)

STEPS = 2000


def trajectory(setup, walker):
    """The positions of a walk, and their times."""
    path, times = [], []
    with setup.drive.installed():
        for _ in range(setup.steps):
            walker.look()
            walker.step()
            path.append(walker.data.qpos.copy())
            times.append(walker.data.time)
    return np.array(path), np.array(times)


def difference(setup, force=None, drive=None):
    """Largest difference of our walk from MuJoCo's, in any coordinate at any step."""
    theirs, their_times = trajectory(setup, MujocoWalker(setup.model, setup.data()))
    force = force or MujocoForce(setup.model)
    ours, our_times = trajectory(setup, ForcedWalker(setup.model, setup.data(), drive or setup.drive, force))
    np.testing.assert_array_equal(our_times, their_times)
    return np.abs(ours - theirs).max()


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_calibration_of_the_boat(integrator):
    setup = setup_of(load_case("boat"), integrator, duration_s=2.0)
    assert setup.steps == STEPS
    assert difference(setup) <= CALIBRATION


def test_what_is_left_in_singular_poses_is_the_tolerance_of_mujocos_newton():
    """Within it MuJoCo's acceleration is not the one that its own force gives."""
    found = []
    for tolerance in (None, NEWTON_TIGHT):
        case = load_case("n_four_bar")
        setup = setup_of(case, "rk4", duration_s=case.file.run.duration_s)
        if tolerance is not None:
            setup.model.opt.tolerance = tolerance
        found.append(difference(setup))
    assert found[1] <= CALIBRATION_SWINGING < found[0] / 10


def swinging(tmp_path, joint="", start=1.0):
    """A four-bar that falls."""
    return case_of(write_model(tmp_path, four_bar(joint=joint)), start={"qpos": {"crank": start}})


@pytest.mark.parametrize("joint", ["", 'damping="0.3"', 'damping="0.3" armature="0.05" stiffness="2"'])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_calibration_of_a_four_bar(tmp_path, integrator, joint):
    setup = setup_of(swinging(tmp_path, joint), integrator, duration_s=STEPS * 0.002)
    assert setup.steps == STEPS
    assert difference(setup) <= CALIBRATION_SWINGING


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_mujocos_two_halves_are_its_step(tmp_path, integrator):
    setup = setup_of(swinging(tmp_path, 'damping="0.3"'), integrator)
    path, _ = trajectory(setup, MujocoWalker(setup.model, setup.data()))
    data = setup.data()
    for row in path:
        mujoco.mj_step(setup.model, data)
        np.testing.assert_array_equal(data.qpos, row)


class Partial(MujocoForce):
    """Forgets one of the two places where MuJoCo's integrators look for the constraint force."""

    def __init__(self, model, forgotten):
        super().__init__(model)
        self._forgotten = forgotten

    def apply(self, data):
        super().apply(data)
        if self._forgotten == "qacc":
            data.qacc[:] = data.qacc_smooth
        else:
            data.qfrc_constraint[:] = 0.0


@pytest.mark.parametrize(
    ("forgotten", "integrator", "joint"),
    [
        ("qacc", "euler", ""),
        ("qacc", "rk4", 'damping="0.3"'),
        ("qfrc_constraint", "euler", 'damping="0.3"'),
        ("qfrc_constraint", "implicit", ""),
        ("qfrc_constraint", "implicitfast", 'damping="0.3"'),
    ],
)
def test_calibration_notices_a_forgotten_field(tmp_path, forgotten, integrator, joint):
    setup = setup_of(swinging(tmp_path, joint), integrator)
    assert difference(setup, Partial(setup.model, forgotten)) > CALIBRATION_BROKEN


def test_calibration_notices_a_drive_held_over_the_step():
    case = load_case("boat")
    setup = setup_of(case, "rk4")
    frozen = Drive(setup.model, case)
    frozen.held_s = setup.timestep_s
    assert difference(setup, drive=frozen) > FROZEN_DRIVE


SPINNING = """
<mujoco>
  <option timestep="0.005" gravity="0 0 -9.81" integrator="RK4"/>
  <worldbody>
    <body name="top">
      <freejoint name="free"/><inertial pos="0.05 -0.02 0.1" mass="1" diaginertia="0.02 0.05 0.06"/>
    </body>
  </worldbody>
</mujoco>"""
"""An asymmetric body in free flight, about its own frame that is not at its centre of mass."""

BALL_CHAIN = """
<mujoco>
  <option timestep="0.005" gravity="0 0 -9.81" integrator="RK4"/>
  <default><geom type="box" size="0.03 0.05 0.2" pos="0 0 0.2" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="a" pos="0 0 1">
      <joint name="a" type="ball"/><geom/>
      <body name="b" pos="0 0 0.4">
        <joint name="b" type="ball"/><geom/>
        <body name="c" pos="0 0 0.4"><joint name="c"/><geom/><site name="end" pos="0 0 0.4"/></body>
      </body>
    </body>
    <body name="d" pos="0 0 2.4"><freejoint name="d"/><geom pos="0 0 0"/><site name="eye" pos="0 0 -0.2"/></body>
  </worldbody>
  <equality><connect name="hook" site1="end" site2="eye"/></equality>
</mujoco>"""
"""Ball joints and a hinge, hooked to a free body."""

SPIN = {SPINNING: [0.1, 0.2, 0.3, 9.0, 5.0, -7.0], BALL_CHAIN: np.linspace(4.0, -5.0, 13)}


def spinning(xml, spin, timestep=None):
    """A model with a drive that does nothing, and a state in full turn."""
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.timestep = timestep or model.opt.timestep
    data = mujoco.MjData(model)
    data.qvel[:] = spin
    return model, data, Drive(model, case_of(Path("spinning.xml")))


def turned(xml, spin, *, corrected=True):
    """Largest difference of our Runge–Kutta walk from MuJoCo's, in any number of the state."""
    model, theirs, _ = spinning(xml, spin)
    _, ours, drive = spinning(xml, spin)
    walkers = MujocoWalker(model, theirs), ForcedWalker(model, ours, drive, MujocoForce(model))
    if not corrected:
        walkers[1]._turns = np.zeros((0, 3), dtype=int)
    worst = 0.0
    for _ in range(60):
        for walker in walkers:
            walker.look()
            walker.step()
        worst = max(worst, *(np.abs(a - b).max() for a, b in ((theirs.qpos, ours.qpos), (theirs.qvel, ours.qvel))))
    return worst


@pytest.mark.parametrize("xml", SPIN, ids=["free body", "ball chain"])
def test_orientations_step_as_mujocos(xml):
    assert turned(xml, SPIN[xml]) <= CALIBRATION
    assert turned(xml, SPIN[xml], corrected=False) > CALIBRATION_BROKEN


def test_orientations_are_of_order_four():
    """Against a run of far smaller steps; without the correction the ratio is 4."""

    def orientation(timestep):
        model, data, drive = spinning(SPINNING, SPIN[SPINNING], timestep)
        walker = ForcedWalker(model, data, drive, MujocoForce(model))
        for _ in range(round(0.4 / timestep)):
            walker.look()
            walker.step()
        return data.qpos[3:].copy()

    exact = orientation(5e-4)
    coarse, fine = (np.abs(orientation(timestep) - exact).max() for timestep in (1e-2, 5e-3))
    assert RK4_ORDER_LOW < coarse / fine < RK4_ORDER_HIGH


def test_runge_kutta_is_of_order_four():
    errors = []
    for timestep in (4e-3, 2e-3, 1e-3):
        results = run("boat", mode="free", form="hard", solver="pinv", timestep=timestep, duration=0.4)
        errors.append(only(results.rows, mode="free")["truth_error_max"])
    coarse, middle, fine = errors
    assert RK4_ORDER_LOW < middle / fine < RK4_ORDER_HIGH
    assert RK4_ORDER_LOW < coarse / middle < 2 * RK4_ORDER_HIGH


def test_activations_are_refused_with_rk4_only(tmp_path):
    lag = '<actuator><general name="lag" joint="crank" dyntype="filter" dynprm="0.1" gainprm="1"/></actuator>'
    case = case_of(write_model(tmp_path, four_bar(rest=lag)), drive={"ctrl": {"lag": "sin(9*t)"}})
    setup = setup_of(case, "rk4")
    with pytest.raises(InputError, match=r"1 actuator activation.* with rk4: use euler or implicitfast"):
        ForcedWalker(setup.model, setup.data(), setup.drive, MujocoForce(setup.model))
    for integrator in ("euler", "implicitfast"):
        assert difference(setup_of(case, integrator)) <= CALIBRATION


# The hook through which MuJoCo asks for controls is global to the process.


def test_hook_is_gone_after_a_run():
    run("boat", mode="free", solver="mujoco", duration=0.01)
    assert mujoco.get_mjcb_control() is None


@pytest.mark.parametrize("integrator", ["euler", "rk4"])
def test_hook_is_gone_after_a_failure(tmp_path, integrator):
    """A law that loses its value in mid-run: named with law and time, the hook taken down."""
    drive = {"ctrl": {"motor_angle": "sqrt(0.0101 - t)"}}
    setup = setup_of(boat_with(drive=drive), integrator)
    with pytest.raises(InputError, match=r"sqrt\(0\.0101 - t\).* is nan at t = 0\.01\d* s"):
        trajectory(setup, MujocoWalker(setup.model, setup.data()))
    assert mujoco.get_mjcb_control() is None


def test_hook_answers_for_its_own_model_only():
    setup = setup_of(load_case("boat"))
    other = mujoco.MjModel.from_xml_path(str(load_case("boat").model_path))
    with setup.drive.installed():
        mine, theirs = setup.data(), mujoco.MjData(other)
        mine.time = theirs.time = 1.0
        mujoco.mj_forward(setup.model, mine)
        mujoco.mj_forward(other, theirs)
    assert mine.ctrl.all()
    assert not theirs.ctrl.any()


def test_drive_follows_its_law():
    setup = setup_of(load_case("boat"))
    data = setup.data()
    for time in (0.0, 0.3, 7.7):
        data.time = time
        setup.drive.apply(data)
        omega, stroke = 2 * np.pi / 5, 0.7
        np.testing.assert_allclose(
            data.ctrl,
            [omega * time - stroke * np.sin(omega * time), omega * (1 - stroke * np.cos(omega * time))],
            rtol=CALIBRATION,
        )
