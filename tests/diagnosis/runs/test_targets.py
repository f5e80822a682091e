"""Mocap targets that a mechanism does not follow, beside plain MuJoCo with the target where it is said to be met."""

from pathlib import Path

import mujoco
import numpy as np
import oarlock
import pytest

ARM = """<mujoco><option timestep="0.002"/><default><geom contype="0" conaffinity="0"/></default><worldbody>
  <body name="upper"><joint name="shoulder" axis="0 1 0" damping="0.4"/>
    <geom type="capsule" fromto="0 0 0 0.28 0 0" size="0.02" mass="0.5"/>
    <body name="fore" pos="0.28 0 0"><joint name="elbow" axis="0 1 0" damping="0.4"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.4"/><site name="tip" pos="0.2 0 0"/></body></body>
  <body name="goal" mocap="true" pos="{pos}"><site name="goal"/></body></worldbody>
  <equality><{kind} name="follow" site1="tip" site2="goal"/></equality>
  <keyframe><key name="bent" qpos="0 1.5707963267948966"/></keyframe></mujoco>"""


def finding(tmp_path: Path, pos: str, kind: str = "connect", **control: str):
    file = tmp_path / "arm.xml"
    file.write_text(ARM.format(pos=pos, kind=kind))
    checked = oarlock.check(file, control={f"mocap:goal.{name}": law for name, law in control.items()}, budget=0)
    return next((one for one in checked.verdict if one.code == "S8"), None), checked.answer


def rest(pos: np.ndarray, quat: np.ndarray, kind: str) -> tuple[float, float]:
    """Distance and angle between tip and goal after 4 s of plain MuJoCo."""
    model = mujoco.MjModel.from_xml_string(ARM.format(pos="0 0 0", kind=kind))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.mocap_pos[0], data.mocap_quat[0] = pos, quat
    for _ in range(2000):
        mujoco.mj_step(model, data)
    turn, sites = np.zeros(4), [np.zeros(4), np.zeros(4)]
    for site, found in enumerate(sites):
        mujoco.mju_mat2Quat(found, data.site_xmat[site])
    mujoco.mju_negQuat(turn, sites[0])
    mujoco.mju_mulQuat(turn, turn.copy(), sites[1])
    distance = float(np.linalg.norm(data.site_xpos[0] - data.site_xpos[1]))
    return distance, 2.0 * float(np.arccos(min(1.0, abs(turn[0]))))


def test_a_target_out_of_reach_is_told_with_a_pose_that_is_met(tmp_path):
    one, answer = finding(tmp_path, "0.45 0 -0.4")
    assert one.element == "follow"
    assert one.severity == "error"
    assert one.figures["gap"] == pytest.approx(np.hypot(0.45, 0.4) - 0.48, rel=1e-3)
    assert "out of reach" in answer
    assert rest(one.figures["pos"], one.figures["quat"], "connect")[0] < 0.05 * one.figures["gap"]


def test_a_weld_to_a_place_that_is_reached_and_an_orientation_that_is_not(tmp_path):
    one, answer = finding(tmp_path, "0.3 0 -0.25", "weld")
    assert "its orientation cannot" in answer
    assert one.figures["pos"] == pytest.approx([0.3, 0.0, -0.25], abs=1e-6)
    distance, angle = rest(one.figures["pos"], one.figures["quat"], "weld")
    assert distance < 1e-3
    assert angle < 1e-2
    assert rest(np.array([0.3, 0.0, -0.25]), np.array([1.0, 0.0, 0.0, 0.0]), "weld")[1] > 0.5


def test_a_target_that_moves_too_fast(tmp_path):
    one, answer = finding(tmp_path, "0.28 0 -0.2", z="-0.2 + 0.08*sin(9*t)")
    assert one.severity == "warning"
    assert one.figures["speed"] == pytest.approx(0.08 * 9.0, rel=0.05)
    assert one.figures["left"] < 0.5 * one.figures["gap"]
    assert "faster than the rows follow" in answer


def test_a_target_that_leaves_the_reach_in_the_run(tmp_path):
    one, _ = finding(tmp_path, "0.28 0 -0.2", x="0.28 + 0.25*t")
    assert one.severity == "error"
    assert one.figures["time_s"] > 0.5
    assert np.linalg.norm(one.figures["pos"]) == pytest.approx(0.48, rel=1e-3)


def test_a_target_that_is_met_is_not_named(tmp_path):
    assert finding(tmp_path, "0.28 0 -0.2")[0] is None
