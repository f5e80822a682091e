"""Limits, friction loss and contacts beside loops: as MuJoCo has them where loops are soft, and with exact loops."""

import mujoco
import numpy as np
import polars as pl
import pytest
from mechanisms import case_of, four_bar, gripper, only, write_model
from oarlock import make_solver, run
from oarlock.base.arrays import relative_difference
from oarlock.cases.case_file import Baumgarte
from oarlock.experiments.options import RunOptions
from oarlock.experiments.task import Task
from oarlock.stepping.inequalities import Rows
from oarlock.stepping.question import Question
from oarlock.stepping.solvers import SolverSpec
from oarlock.stepping.state import State
from walks import require_equal

MUJOCO, AUTO, TRACKED = (SolverSpec.parse(text) for text in ("mujoco", "auto", "sr1-tracked"))
CLOSING = 'drive.ctrl.close = "-0.7"\n'
EXACT = "tolerance='0' iterations='200'"
"""MuJoCo's own solver goes on until it makes no progress."""

CONES = [("elliptic", condim) for condim in (1, 3, 4, 6)] + [("pyramidal", condim) for condim in (1, 3, 4, 6)]
KINDS = [
    Task("calibration", MUJOCO, (), (), "rk4", "default"),
    Task("lockstep", AUTO, ("matched", "hard"), (AUTO, TRACKED), "rk4", "default", "projection"),
    Task("one-step", MUJOCO, ("matched", "hard"), (AUTO, TRACKED), "euler", "default"),
    Task("free", MUJOCO, ("matched", "hard"), (MUJOCO, AUTO), "implicit", "default"),
    Task("free", MUJOCO, ("hard",), (TRACKED,), "implicitfast", "default", "projection"),
    Task("free", MUJOCO, ("hard",), (AUTO,), "rk4", "default", "projection"),
]


@pytest.mark.parametrize("task", KINDS, ids=lambda task: f"{task.mode}-{task.integrator}")
def test_both_paths_walk_the_same_way(tmp_path, task):
    case = case_of(write_model(tmp_path, gripper(), f'title = "g"\n{CLOSING}'))
    found = require_equal(case, task, 80)
    assert all(status == "done" for status, _, _ in found)
    if task.mode != "calibration":
        assert all((steps["contact_force"] > 0).any() for _, _, steps in found)


def stack(count: int) -> str:
    """So many boxes on a floor, each welded to the next one: from 10 on MuJoCo keeps J in compressed rows."""
    box = '<body name="b{}" pos="{} 0 0.0999"><freejoint/><geom type="box" size="0.09 0.1 0.1" mass="{}"/></body>'
    boxes = "".join(box.format(i, 0.2 * i, i + 1) for i in range(count))
    welds = "".join(f'<weld body1="b{i}" body2="b{i + 1}"/>' for i in range(count - 1))
    return f"""<mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="9 9 1"/>{boxes}</worldbody>
      <equality>{welds}</equality></mujoco>"""


def test_sparse_rows_walk_the_same_way(tmp_path):
    case = case_of(write_model(tmp_path, stack(11), 'title = "s"\n'))
    task = Task("free", MUJOCO, ("matched", "hard"), (AUTO,), "euler", "default", "projection")
    for status, _, steps in require_equal(case, task, 15):
        assert status == "done"
        assert steps["contact_force"][-1] == pytest.approx(9.81 * sum(range(1, 12)), rel=0.5)


@pytest.mark.parametrize(("cone", "condim"), CONES)
def test_the_matched_form_is_mujocos_own_answer(tmp_path, cone, condim):
    """Two exact solutions of one convex problem, at states along MuJoCo's own steps.

    Accelerations are compared entry by entry, to 1e-8 of themselves or of 1 rad/s² or m/s²: a gripper that holds still
    has some of 1e-4.
    """
    model = mujoco.MjModel.from_xml_string(gripper(cone=cone, condim=condim, option=EXACT))
    data = mujoco.MjData(model)
    data.ctrl[:] = -0.7
    state = State(model, data, Baumgarte())
    question, solver = Question(state, "matched"), make_solver("auto")
    touched = 0
    for step in range(500):
        mujoco.mj_step(model, data)
        if step % 10 == 0:
            mujoco.mj_forward(model, data)
            state.read()
            question.ask()
            answer = question.answer(solver)
            np.testing.assert_allclose(answer.qacc, data.qacc, rtol=1e-8, atol=1e-8)
            assert relative_difference(answer.qfrc, data.qfrc_constraint) < 1e-9
            assert answer.info.status == "converged"
            touched += data.ncon > 0
    assert touched > 25


def test_where_mujoco_stops_early_the_gradient_left_is_smaller(tmp_path):
    path = write_model(tmp_path, gripper(option="tolerance='1e-4' iterations='2'"), f'title = "g"\n{CLOSING}')
    results = run(path, RunOptions(mode="lockstep", form="matched", solver="auto", duration=0.5))
    steps = results.frames["steps"].lazy().filter(pl.col("mode") == "lockstep").collect()
    early = steps.filter(pl.col("mujoco_optimality") > 1e-9)
    assert len(early) > 5
    assert (early["optimality"] < 0.01 * early["mujoco_optimality"]).all()


def test_a_matched_free_run_stays_with_mujoco(tmp_path):
    path = write_model(tmp_path, gripper(option=EXACT), f'title = "g"\n{CLOSING}')
    options = RunOptions(mode="free", form="matched", solver="auto", integrator="implicitfast", duration=3.0)
    row = only(run(path, options).rows, mode="free")
    assert (row["status"], row["steps"]) == ("done", 1500)
    assert row["trajectory_diff_max"] < 1e-10
    assert row["newton_mean"] <= 1.3
    assert row["newton_max"] <= 10


def test_exact_loops_hold_while_the_gripper_grips(tmp_path):
    path = write_model(tmp_path, gripper(), f'title = "g"\n{CLOSING}')
    options = RunOptions(mode="free", form="hard", solver="auto", integrator="implicitfast", duration=2.0)
    results = run(path, options)
    row, theirs = only(results.rows, mode="free"), only(results.rows, mode="calibration")
    assert row["status"] == "done"
    assert row["drift_pos_max"] < 1e-12
    assert theirs["drift_pos_max"] > 1e-3
    assert row["newton_mean"] <= 1.3
    assert row["newton_max"] <= 10


@pytest.mark.parametrize("what", ["frictionloss", "limit"])
def test_rows_that_never_act_change_no_bit(tmp_path, what):
    far = 'limited="true" range="-3 3"' if what == "limit" else 'frictionloss="0"'
    start = "[start]\nqvel = {crank = 1.0}\n"
    walked = []
    for name, attribute in (("plain", ""), ("far", far)):
        path = write_model(tmp_path / name, four_bar(joint=attribute), f'title = "m"\n{start}')
        options = RunOptions(mode="free", form="hard", solver="sr1-tracked", duration=0.3)
        frame = run(path, options).frames["steps"].lazy().filter(pl.col("mode") == "free").collect()
        walked.append(frame.select("qpos", "multipliers", "iterations", "drift_pos"))
    assert walked[0].equals(walked[1])


def test_energy_is_told_until_a_limit_pushes(tmp_path):
    stopped = four_bar(rocker='limited="true" range="-0.5 0.05"')
    path = write_model(tmp_path, stopped, 'title = "m"\nstart.qvel.crank = 4.0\n')
    options = RunOptions(mode="free", form="hard", solver="auto", duration=0.2)
    results = run(path, options)
    steps = results.frames["steps"].lazy().filter(pl.col("mode") == "free").collect()
    pushed = steps["limit_force"].fill_null(0.0) > 0.0
    first = int(pushed.arg_max() or 0)
    assert 0 < first < len(steps)
    assert steps["energy"].is_not_null().to_list() == [step < first for step in range(len(steps))]
    assert only(results.rows, mode="free")["energy_drift_rel"] is None


def test_what_rows_are(tmp_path):
    model = mujoco.MjModel.from_xml_string(gripper(condim=4))
    data = mujoco.MjData(model)
    data.qpos[model.jnt_qposadr[model.joint("l_idle").id]] = 1.2
    data.qpos[model.jnt_qposadr[-1] + 2] -= 1e-3  # the block, into the table
    mujoco.mj_forward(model, data)
    rows = Rows(model, data)
    kinds = data.efc_type[data.ne :].tolist()
    assert len(rows) == len(kinds) == sum(max(dim, 1) for dim in rows.dims)
    assert rows.dims.count(0) == kinds.count(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF) + 1 == 5
    assert rows.dims.count(1) == 1 == kinds.count(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
    assert rows.dims.count(4) == data.ncon == 4
    loads = rows.loads(data.efc_force[data.ne :])
    normal = sum(data.efc_force[contact.efc_address] for contact in data.contact)
    assert loads.contact == pytest.approx(normal)
    limit = data.ne + kinds.index(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
    assert loads.limit == pytest.approx(float(data.efc_force[limit]))
    assert 0 < loads.friction <= 0.05
    np.testing.assert_array_equal(rows.mu[-4:], [contact.mu for contact in data.contact])
