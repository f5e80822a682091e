"""Equalities that are switched off during a run: as in a plain loop, on both paths, and exact while they are on."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from mechanisms import only, write_model
from oarlock import InputError, check, load_case, run
from oarlock.cases.motion import Motion
from oarlock.experiments.opening import open_case
from oarlock.experiments.task import Task
from oarlock.stepping.solvers import SolverSpec
from tolerances import CLOSED
from walks import require_equal

STEPS, RELEASED = 120, 50
"""Steps of a run, and the step before which the grip is let go."""

LAW = {"active:grip": f"{(RELEASED - 0.5) * 0.002} - t"}

CRANE = """
<mujoco>
  <option timestep="0.002" integrator="{integrator}"/>
  <default><geom type="capsule" size="0.01" mass="0.2" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="arm" pos="0 0 1"><joint name="arm" axis="0 1 0" damping="0.02"/><geom fromto="0 0 0 0.3 0 0"/></body>
    <body name="bar" pos="0.3 0 1">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
      <joint name="turn" axis="0 1 0"/>
      <geom fromto="0 0 0 0.2 0 0.1"/>
    </body>
    <body name="post" pos="0.5 0 0.6"><joint name="post" axis="0 1 0"/><geom fromto="0 0 0 0 0 0.5"/></body>
  </worldbody>
  <equality>
    <connect name="grip" body1="arm" body2="bar" anchor="0.3 0 0"/>
    <connect name="pin" body1="bar" body2="post" anchor="0.2 0 0.1"/>
  </equality>
</mujoco>"""


def written(folder: Path, integrator: str = "Euler") -> Path:
    return write_model(folder, CRANE.format(integrator=integrator))


def loop(path: Path) -> np.ndarray:
    """Positions (STEPS, nq) of a program that lets go by writing ``eq_active``."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    seen = []
    for step in range(STEPS):
        seen.append(data.qpos.copy())
        data.eq_active[0] = step < RELEASED
        mujoco.mj_step(model, data)
    return np.array(seen)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_mujoco_walks_as_the_loop_does(tmp_path, integrator):
    """Bit for bit; the exact solution keeps what is closed, with the rank that is left."""
    path = written(tmp_path, integrator)
    duration = STEPS * 0.002
    results = run(path, mode="free", form="hard", solver=["mujoco", "pinv"], duration=duration, control=LAW)
    tables = dict(zip((row["solver"] + row["mode"] for row in results.rows), results.tables, strict=True))
    walked = np.array(tables["mujocofree"].collect()["qpos"].to_list())
    np.testing.assert_array_equal(walked, loop(path))
    exact = tables["pinvfree"].collect()
    assert exact["rank"].to_list() == [4] * RELEASED + [2] * (STEPS - RELEASED)
    assert exact["drift_pos"].max() <= CLOSED
    assert only(results.rows, solver="pinv", mode="free")["status"] == "done"
    recording = check(path, budget=0, duration=duration, control=LAW).examination.recording
    assert recording is not None
    np.testing.assert_array_equal(recording.qpos, walked)
    assert recording.present[:RELEASED, :3].any()
    assert not recording.present[RELEASED:, :3].any()


def test_check_shows_the_exact_force_until_it_is_let_go(tmp_path):
    exact = check(written(tmp_path), budget=0, duration=STEPS * 0.002, control=LAW).examination.exact
    assert exact is not None
    assert exact.end.how == "finished"
    force = np.abs(exact.force[:, :3]).max(axis=1)
    assert force[:RELEASED].min() > 0.1
    assert not force[RELEASED:].any()


@pytest.mark.parametrize("mode", ["calibration", "lockstep", "one-step", "free"])
@pytest.mark.parametrize("integrator", ["euler", "implicitfast", "rk4"])
def test_both_paths_give_the_same(tmp_path, mode, integrator):
    walker = SolverSpec("pinv" if mode == "lockstep" else "mujoco")
    task = Task(
        mode, walker, ("matched", "hard"), (SolverSpec("auto"), SolverSpec("sr1-tracked")), integrator, "default"
    )
    require_equal(open_case(written(tmp_path)), task, STEPS, Motion(control=LAW))


def test_a_case_and_a_log_switch_as_well(tmp_path):
    path = written(tmp_path)
    times = np.array([0.0, RELEASED * 0.002])
    np.savez(tmp_path / "log.npz", **{"time": times, "active:grip": np.array([1.0, 0.0])})
    (tmp_path / "log.csv").write_text(f"time,active:grip\n0,1\n{RELEASED * 0.002!r},0\n")
    asked = {"mode": "free", "solver": "mujoco", "duration": STEPS * 0.002, "integrator": "euler"}
    walks = [run(path, **asked, controls=str(tmp_path / name)) for name in ("log.npz", "log.csv")]
    (tmp_path / "case.toml").write_text(f'title = "x"\n[drive.active]\ngrip = "{LAW["active:grip"]}"\n')
    assert not load_case(tmp_path).bare
    walks.append(run(tmp_path, **asked))
    for results in walks:
        (table,) = [table for row, table in zip(results.rows, results.tables, strict=True) if row["mode"] == "free"]
        np.testing.assert_array_equal(np.array(table.collect()["qpos"].to_list()), loop(path))


def test_an_unknown_equality_is_named(tmp_path):
    with pytest.raises(InputError, match="unknown equality after 'active:' 'hook', expected one of: grip, pin"):
        run(written(tmp_path), mode="free", duration=0.01, control={"active:hook": "1 - t"})
