"""Mocap bodies that are moved: MuJoCo's run as a plain loop's, and the exact solution against closed forms."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mechanisms import only, write_model
from oarlock import InputError, check, load_case, run
from oarlock.experiments.outcome import Results
from scipy.integrate import solve_ivp
from tolerances import (
    BODY_FORCE,
    CLOSED,
    DIFFERENCED_RATE,
    HALF_OF_A_STEP,
    RK4_ORDER_HIGH,
    RK4_ORDER_LOW,
    SAME_MOTION,
    SOFTNESS_SHOWS,
    UNPROJECTED_SECOND,
)

TIMESTEP, STEPS = 0.002, 300
AMPLITUDE, RATE = 0.1, 6.0
MASS, HALF = 0.2, 0.15
"""Of the pendulum: kg, and m from its pivot to its centre."""

PENDULUM = """
<mujoco>
  <option timestep="{timestep}" integrator="{integrator}"/>
  <worldbody>
    <body name="cart" mocap="true" pos="0 0 1"/>
    <body name="bob" pos="0 0 1">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
      <joint name="turn" axis="0 1 0"/>
      <inertial pos="0.15 0 0" mass="0.2" diaginertia="0.001 0.0016 0.0016"/>
    </body>
  </worldbody>
  <equality><connect name="pin" body1="cart" body2="bob" anchor="0 0 0"/></equality>
</mujoco>"""

CIRCLE = {
    "mocap:cart.x": f"{AMPLITUDE}*(1 - cos({RATE}*t))",
    "mocap:cart.z": f"1 + {AMPLITUDE}*({RATE}*t - sin({RATE}*t))",
}
"""It begins at rest where the model has the cart, so that the start is closed as it stands."""

TRAY = """
<mujoco>
  <option timestep="0.002" integrator="{integrator}"/>
  <worldbody>
    <body name="hand" mocap="true" pos="0 0 1"/>
    <body name="tray" pos="0.3 0 1"><freejoint/>
      <inertial pos="0.05 0.02 0.03" mass="0.8" diaginertia="0.01 0.02 0.015"/></body>
    <body name="charm" pos="0.6 0 1"><freejoint/>
      <inertial pos="0 0 -0.2" mass="0.1" diaginertia="0.001 0.001 0.0005"/></body>
  </worldbody>
  <equality>
    <weld name="hold" body1="hand" body2="tray"/>
    <connect name="ring" body1="tray" body2="charm" anchor="0.3 0 0"/>
  </equality>
</mujoco>"""

TURNS = {
    "mocap:hand.x": "0.1*(1 - cos(6*t))",
    "mocap:hand.rx": "0.6*(1 - cos(4*t))",
    "mocap:hand.ry": "0.3*t^2",
    "mocap:hand.rz": "t^2",
}


def pendulum(folder: Path, integrator: str = "RK4", timestep: float = TIMESTEP) -> Path:
    return write_model(folder, PENDULUM.format(integrator=integrator, timestep=timestep))


def walked(results: Results, solver: str, column: str = "qpos") -> np.ndarray:
    """Of the free run of a solver."""
    rows = zip(results.rows, results.tables, strict=True)
    (table,) = [table for row, table in rows if row["solver"] == solver and row["mode"] == "free"]
    return np.array(table.collect()[column].to_list())


def loop(path: Path, pose: Callable[[float], tuple[np.ndarray, np.ndarray]], steps: int = STEPS) -> np.ndarray:
    """Positions (steps, nq) of a program that writes the pose of the only mocap body before each step."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    seen = []
    for _ in range(steps):
        seen.append(data.qpos.copy())
        data.mocap_pos[0], data.mocap_quat[0] = pose(data.time)
        mujoco.mj_step(model, data)
    return np.array(seen)


def on_circle(time: float) -> tuple[np.ndarray, np.ndarray]:
    angle = RATE * time
    place = [AMPLITUDE * (1.0 - np.cos(angle)), 0.0, 1.0 + AMPLITUDE * (angle - np.sin(angle))]
    return np.array(place), np.array([1.0, 0.0, 0.0, 0.0])


def turned(time: float) -> tuple[np.ndarray, np.ndarray]:
    vector = np.array([0.6 * (1.0 - np.cos(4.0 * time)), 0.3 * time**2, time**2])
    angle, quaternion = float(np.linalg.norm(vector)), np.array([1.0, 0.0, 0.0, 0.0])
    if angle > 0.0:
        mujoco.mju_axisAngle2Quat(quaternion, vector / angle, angle)
    return np.array([0.1 * (1.0 - np.cos(6.0 * time)), 0.0, 1.0]), quaternion


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_mujoco_walks_as_the_loop_does(tmp_path, integrator):
    """Bit for bit, in ``run`` and in ``check``, while the pose is one that the law and NumPy round alike."""
    path = write_model(tmp_path, PENDULUM.format(integrator=integrator, timestep=TIMESTEP))
    law, duration = {"mocap:cart.x": "0.5*t*t", "mocap:cart.qx": "3*t", "mocap:cart.qw": "2"}, STEPS * TIMESTEP
    expected = loop(path, lambda time: (np.array([0.5 * time * time, 0.0, 1.0]), np.array([2.0, 3.0 * time, 0.0, 0.0])))
    results = run(path, mode="free", solver="mujoco", duration=duration, control=law)
    np.testing.assert_array_equal(walked(results, "mujoco"), expected)
    recording = check(path, budget=0, duration=duration, control=law).examination.recording
    assert recording is not None
    np.testing.assert_array_equal(recording.qpos, expected)
    assert np.abs(expected - expected[0]).max() > 0.1


def closed_form(qpos: np.ndarray, timestep: float) -> np.ndarray:
    """Angles of a pendulum whose pivot goes along ``CIRCLE``: (I + m c²) α = m c (ẍ sin a + (z̈ + g) cos a)."""

    def rates(time: float, state: np.ndarray) -> list[float]:
        angle, omega = state
        x, z = AMPLITUDE * RATE**2 * np.cos(RATE * time), AMPLITUDE * RATE**2 * np.sin(RATE * time)
        torque = MASS * HALF * (x * np.sin(angle) + (z + 9.81) * np.cos(angle))
        return [omega, torque / (0.0016 + MASS * HALF**2)]

    times = np.arange(len(qpos)) * timestep
    return solve_ivp(rates, (0.0, times[-1]), [qpos[0, 2], 0.0], "DOP853", times, rtol=1e-12, atol=1e-13).y[0]


def test_a_pendulum_on_a_pivot_that_moves_follows_its_equation(tmp_path):
    """With the order of Runge–Kutta, closed, and off by what its own estimate says."""
    errors = []
    for timestep in (0.004, 0.002):
        path = pendulum(tmp_path, timestep=timestep)
        results = run(path, mode="free", form="hard", solver="pinv", duration=0.6, control=CIRCLE)
        qpos = walked(results, "pinv")
        errors.append(np.abs(qpos[:, 2] - closed_form(qpos, timestep)).max())
        for name, bound in (("drift_pos", CLOSED), ("drift_vel", DIFFERENCED_RATE)):
            assert walked(results, "pinv", name).max() <= bound
        estimate = walked(results, "pinv", "error_estimate").max()
        assert 0.5 * errors[-1] <= estimate <= 2.0 * errors[-1]
        times = np.arange(len(qpos)) * timestep
        np.testing.assert_allclose(qpos[:, 0], [on_circle(time)[0][0] for time in times], atol=CLOSED)
    assert RK4_ORDER_LOW < errors[0] / errors[1] < RK4_ORDER_HIGH


def test_the_rates_of_a_weld_that_turns_are_whole(tmp_path):
    """Without projection and without Baumgarte's terms nothing but r̈ = 0 keeps the tray on the hand."""
    path = write_model(tmp_path, TRAY.format(integrator="RK4"))
    asked = {"mode": "free", "form": "hard", "solver": "pinv", "duration": 1.0, "control": TURNS}
    results = run(path, **asked, stabilisation="baumgarte")
    assert walked(results, "pinv", "drift_pos").max() <= UNPROJECTED_SECOND
    qpos = walked(run(path, **asked), "pinv")
    for step in range(0, len(qpos), 50):
        place, quaternion = turned(step * TIMESTEP)
        arm, whole = np.zeros(3), np.zeros(4)
        mujoco.mju_rotVecQuat(arm, np.array([0.3, 0.0, 0.0]), quaternion)
        np.testing.assert_allclose(qpos[step, :3], place + arm, atol=SAME_MOTION)
        mujoco.mju_mulQuat(whole, np.array([1.0, -1.0, -1.0, -1.0]) * quaternion, qpos[step, 3:7])
        assert abs(whole[1:]).max() <= SAME_MOTION


def test_a_weld_carries_weight_and_inertia(tmp_path):
    """The force is m (p̈ + g), to the last step."""
    text = TRAY.format(integrator="RK4").replace(
        '<connect name="ring" body1="tray" body2="charm" anchor="0.3 0 0"/>', ""
    )
    path = write_model(tmp_path, text)
    law = {"mocap:hand.x": "0.1*(1 - cos(6*t))"}
    force = walked(run(path, mode="free", form="hard", solver="pinv", duration=0.5, control=law), "pinv", "multipliers")
    times = np.arange(len(force)) * TIMESTEP
    np.testing.assert_allclose(np.abs(force[:, 0]), 0.8 * np.abs(3.6 * np.cos(6.0 * times)), atol=BODY_FORCE)
    np.testing.assert_allclose(np.abs(force[:, 2]), 0.8 * 9.81, atol=BODY_FORCE)


FOUR_BAR = """
<mujoco>
  <option timestep="0.002" integrator="RK4" gravity="{gravity} 0 -9.81"/>
  <default><joint damping="0.01"/><geom type="capsule" size="0.02" contype="0" conaffinity="0" mass="0.3"/></default>
  <worldbody>
    <body name="base" mocap="true" pos="0 0 1"/>
    <body name="crank" pos="0 0 1"><joint type="slide" axis="1 0 0" damping="0"/>
      <joint type="slide" axis="0 0 1" damping="0"/><joint axis="0 1 0" damping="0"/><geom fromto="0 0 0 0 0 0.3"/>
      <body name="coupler" pos="0 0 0.3"><joint axis="0 1 0"/><geom fromto="0 0 0 0.5 0 0.2"/></body></body>
    <body name="rocker" pos="0.7 0 1"><joint type="slide" axis="1 0 0" damping="0"/>
      <joint type="slide" axis="0 0 1" damping="0"/><joint axis="0 1 0" damping="0"/>
      <geom fromto="0 0 0 -0.2 0 0.5"/></body>
  </worldbody>
  <equality>
    <connect name="left" body1="base" body2="crank" anchor="0 0 0"/>
    <connect name="right" body1="base" body2="rocker" anchor="0.7 0 0"/>
    <connect name="pin" body1="coupler" body2="rocker" anchor="0.5 0 0.2"/>
  </equality>
</mujoco>"""


@pytest.mark.parametrize("acceleration", [3.0, -5.0])
def test_a_base_that_speeds_up_is_as_gravity_that_leans(tmp_path, acceleration):
    """A four-bar of which both ground pivots are on the mocap body (d'Alembert)."""
    asked = {"mode": "free", "form": "hard", "solver": "pinv", "duration": 0.5}
    law = {"mocap:base.x": f"0.5*{acceleration}*t^2"}
    moved = walked(run(write_model(tmp_path, FOUR_BAR.format(gravity=0.0)), **asked, control=law), "pinv")
    still = walked(run(write_model(tmp_path, FOUR_BAR.format(gravity=-acceleration)), **asked), "pinv")
    way = 0.5 * acceleration * (np.arange(len(moved)) * TIMESTEP) ** 2
    still[:, [0, 4]] += way[:, np.newaxis]
    np.testing.assert_allclose(moved, still, atol=SAME_MOTION)
    assert np.abs(still[:, 2] - still[0, 2]).max() > 0.05


def test_a_log_moves_as_well(tmp_path):
    """Each pose is held until the next; quaternions may change their sign. MuJoCo walks as the loop, bit for bit."""
    path = write_model(tmp_path, TRAY.format(integrator="implicitfast"))
    times = np.arange(STEPS) * TIMESTEP
    poses = [turned(max(0.0, time - TIMESTEP)) for time in times]  # the first step is one of rest, as the model's start
    places, quaternions = np.array([one for one, _ in poses]), np.array([one for _, one in poses])
    quaternions[::3] *= -1.0
    columns = {f"mocap:hand.{axis}": places[:, at] for at, axis in enumerate("xyz")}
    columns |= {f"mocap:hand.q{part}": quaternions[:, at] for at, part in enumerate("wxyz")}
    np.savez(tmp_path / "log.npz", **{"time": times, **columns})
    asked = {"mode": "free", "form": "hard", "solver": ["mujoco", "pinv"], "duration": STEPS * TIMESTEP}
    results = run(path, **asked, controls=str(tmp_path / "log.npz"), integrator="rk4")
    assert walked(results, "pinv", "drift_pos").max() <= CLOSED
    law = walked(run(path, **asked, control=TURNS, integrator="rk4"), "pinv")
    assert np.abs(walked(results, "pinv")[1:] - law[:-1]).max() <= HALF_OF_A_STEP
    row = iter(range(STEPS))

    def logged(_: float) -> tuple[np.ndarray, np.ndarray]:
        at = next(row)
        return places[at], quaternions[at]

    results = run(path, **{**asked, "solver": "mujoco"}, controls=str(tmp_path / "log.npz"))
    expected = loop(path, logged)
    np.testing.assert_array_equal(walked(results, "mujoco"), expected)


def test_a_case_moves_as_well(tmp_path):
    """With constants; the parts of a pose are those of the command."""
    path, asked = pendulum(tmp_path), {"mode": "free", "form": "hard", "solver": ["mujoco", "pinv"], "duration": 0.1}
    (tmp_path / "case.toml").write_text(
        'title = "x"\n[drive.constants]\nw = 6\n[drive.mocap.cart]\nx = "0.1*(1 - cos(w*t))"\nry = "0.2*t"\n'
    )
    law = {"mocap:cart.x": "0.1*(1 - cos((6)*t))", "mocap:cart.ry": "0.2*t"}
    ours, theirs = run(tmp_path, **asked, integrator="rk4"), run(path, **asked, control=law, integrator="rk4")
    for solver in ("mujoco", "pinv"):
        np.testing.assert_array_equal(walked(ours, solver), walked(theirs, solver))
    (tmp_path / "case.toml").write_text('title = "x"\n[drive.mocap.cart]\nw = "1"\n')
    with pytest.raises(InputError, match=r"drive\.mocap\.cart\.w"):
        load_case(tmp_path)


def test_every_mode_takes_it_on_the_python_path(tmp_path):
    """MuJoCo's own force is followed to rounding, and its question answered as it stands; energies are not noted."""
    asked = {"mode": "free", "form": "hard", "solver": "pinv", "duration": 0.02}
    results = run(pendulum(tmp_path), solver=["mujoco", "pinv"], duration=0.1, control=CIRCLE, integrator="rk4")
    assert {row["status"] for row in results.rows} == {"done"}
    assert {row["stepping"] for row in results.rows} == {"python", "mujoco"}
    assert only(results.rows, mode="calibration")["trajectory_diff_max"] <= CLOSED
    assert only(results.rows, mode="lockstep", form="matched", solver="pinv")["qacc_rel_diff_max"] <= DIFFERENCED_RATE
    assert only(results.rows, mode="lockstep", form="hard", solver="pinv")["qacc_rel_diff_max"] > SOFTNESS_SHOWS
    assert set(walked(run(pendulum(tmp_path), **asked, control=CIRCLE), "pinv", "energy").tolist()) == {None}
    with pytest.raises(InputError, match="no native stepping: mocap bodies move on the Python path only"):
        run(pendulum(tmp_path), mode="free", duration=0.1, control=CIRCLE, stepping="native")


def test_check_holds_it_against_the_exact_motion_and_says_what_it_leaves_out(tmp_path):
    """What a row lags by is what the page says: 2 timeconst dampratio² times the speed."""
    path, speed = pendulum(tmp_path, "implicitfast"), 0.5
    exam = check(path, budget=0, duration=0.5, control={"mocap:cart.x": f"{speed}*t"}).examination
    assert exam.exact is not None
    assert exam.recording is not None
    assert exam.exact.end.how == "finished"
    assert exam.exact.drift[:, 0].max() <= CLOSED
    assert "2 timeconst dampratio²" in exam.missing["causes"]
    assert np.isnan(exam.recording.energy_error[-1])
    straight = check(path, budget=0, duration=0.5, control={"mocap:cart.x": f"{speed}*t"}, keyframe="none").examination
    assert straight.recording is not None
    assert abs(straight.recording.position[-1, 0]) == pytest.approx(2.0 * 0.02 * speed, rel=0.05)


def test_a_joint_on_a_moving_mocap_body_has_no_exact_solution(tmp_path):
    text = PENDULUM.format(integrator="RK4", timestep=TIMESTEP).replace(
        '<body name="cart" mocap="true" pos="0 0 1"/>',
        '<body name="cart" mocap="true" pos="0 0 1"><body><joint name="hook" axis="0 1 0"/>'
        '<geom size="0.01" contype="0" conaffinity="0"/></body></body>',
    )
    path = write_model(tmp_path, text)
    with pytest.raises(InputError, match=r"joint 'hook' hangs on the mocap body 'cart'"):
        run(path, mode="free", form="hard", solver="pinv", duration=0.1, control=CIRCLE)
    results = run(path, mode="free", solver="mujoco", duration=0.1, control=CIRCLE)
    assert only(results.rows, mode="free")["status"] == "done"


@pytest.mark.parametrize(
    ("law", "said"),
    [
        ({"mocap:cart": "t"}, r"'mocap:cart' names no part of a pose"),
        ({"mocap:kart.x": "t"}, "unknown mocap body after 'mocap:' 'kart', expected one of: cart"),
        ({"mocap:cart.w": "t"}, "unknown part in 'mocap:cart.w' 'w'"),
        ({"mocap:cart.qx": "t"}, "the quaternion of the mocap body 'cart' has the length 0 at t = 0 s"),
        ({"mocap:cart.qw": "1", "mocap:cart.rx": "t"}, "both 'mocap:cart.qw' and 'mocap:cart.rx' turn"),
        ({"mocap:cart.x": "1/t"}, "mocap:cart.x = .* at t = 0 s, expected a finite number"),
    ],
)
def test_bad_input_is_one_line(tmp_path, law, said):
    with pytest.raises(InputError, match=said) as caught:
        run(pendulum(tmp_path), mode="free", duration=0.01, control=law)
    assert "\n" not in str(caught.value)


def test_a_model_without_a_mocap_body_says_so(tmp_path):
    text = PENDULUM.format(integrator="RK4", timestep=TIMESTEP).replace(' mocap="true"', "")
    with pytest.raises(InputError, match=r"'mocap:cart\.x' names a mocap body, and the model has none"):
        run(write_model(tmp_path, text), mode="free", duration=0.01, control={"mocap:cart.x": "t"})
