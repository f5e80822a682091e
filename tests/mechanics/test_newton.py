"""Newton on sparse Jacobians: an answer that is no minimum is asked for once more."""

import mujoco
import numpy as np
import pytest
from mechanisms import GROUPED, case_of, write_model
from oarlock.experiments.task import Task
from oarlock.mechanics import newton
from oarlock.mechanics.engine_version import SPARSE_NEWTON_ERRS
from oarlock.mechanics.prepare import prepare
from oarlock.stepping.solvers import SolverSpec
from walks import require_equal

MUJOCO, AUTO = SolverSpec("mujoco"), SolverSpec("auto")
SPARSE, DENSE = mujoco.mjtJacobian.mjJAC_SPARSE, mujoco.mjtJacobian.mjJAC_DENSE

ALIKE = 2.0
"""Gradients that are rounding alone differ by no more."""

SAME = 1e-8
"""Largest difference of two answers to rounding, relative: the rounding of a gradient, 1e-13, by the condition."""


def mechanism(seed: int) -> mujoco.MjModel:
    """A random tree with 3 to 60 connects."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(20, 100))
    spec = mujoco.MjSpec()
    bodies = [spec.worldbody]
    for _ in range(count):
        body = bodies[rng.integers(max(0, len(bodies) - 30), len(bodies))].add_body(pos=rng.uniform(-0.5, 0.5, 3))
        body.name = f"b{len(bodies)}"
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=rng.normal(size=3))
        geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0.0, 0.0], mass=1.0)
        geom.contype = geom.conaffinity = 0
        bodies.append(body)
    for _ in range(int(rng.integers(3, 60))):
        first, second = rng.choice(np.arange(1, count + 1), 2, replace=False)
        equality = spec.add_equality(type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_BODY)
        equality.name1, equality.name2 = f"b{first}", f"b{second}"
        equality.data[:3] = rng.uniform(-0.1, 0.1, 3)
    return spec.compile()


def asked(model: mujoco.MjModel, jacobian: mujoco.mjtJacobian, ask=newton.forward) -> mujoco.MjData:
    model.opt.jacobian = jacobian
    data = mujoco.MjData(model)
    data.qvel[:] = np.sin(np.arange(model.nv))
    ask(model, data)
    return data


def left(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    return newton.gradient(model, data, data.qacc, data.qfrc_constraint)


def test_an_answer_that_is_no_minimum_is_asked_for_once_more():
    model = mujoco.MjModel.from_xml_string(GROUPED)
    wrong = not newton.is_minimum(model, asked(model, SPARSE, mujoco.mj_forward))
    assert wrong == SPARSE_NEWTON_ERRS
    confirmed = asked(model, SPARSE)
    assert (model.opt.jacobian == DENSE) == wrong
    assert left(model, confirmed) <= newton.ROUNDING
    np.testing.assert_allclose(confirmed.qacc, asked(model, DENSE).qacc, rtol=SAME)


def test_of_random_mechanisms_every_answer_is_that_of_a_dense_jacobian():
    """Which is the minimum in most of them; in some the terms of the forces are too large to tell by the gradient."""
    errs = minima = 0
    for seed in range(40):
        model = mechanism(seed)
        sparse = asked(model, SPARSE)
        kept, minimum = model.opt.jacobian == SPARSE, left(model, sparse) <= newton.ROUNDING
        if kept:
            assert newton.is_minimum(model, sparse)
        errs += not kept
        dense = asked(model, DENSE)
        minima += minimum
        # What is kept is rounding of such terms, of a dense Jacobian's answer too: 0.14 and 0.09 in the worst of them.
        assert minimum or left(model, sparse) <= (ALIKE if kept else 1.0) * left(model, dense)
        assert np.abs(sparse.qacc - dense.qacc).max() <= SAME * np.abs(dense.qacc).max()
    assert (errs > 0) == SPARSE_NEWTON_ERRS
    assert errs < 20 < 34 < minima


def test_stiff_rows_alone_make_no_jacobian_dense():
    """The gradient is larger there, and rounding all the same: the same answers stay sparse as with soft rows."""
    stays = []
    for solref, solimp in (
        ((0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)),
        ((0.004, 0.5), (0.9999, 0.9999, 0.001, 0.5, 2.0)),
    ):
        kept = []
        for seed in range(40):
            model = mechanism(seed)
            model.eq_solref[:], model.eq_solimp[:] = solref, solimp
            sparse = asked(model, SPARSE)
            kept.append(model.opt.jacobian == SPARSE)
            dense = asked(model, DENSE)
            assert np.abs(sparse.qacc - dense.qacc).max() <= SAME * np.abs(dense.qacc).max()
        stays.append(kept)
    assert stays[0] == stays[1]


def test_who_is_not_doubted_is_not_asked_twice():
    model = mujoco.MjModel.from_xml_string(GROUPED)
    model.opt.solver = mujoco.mjtSolver.mjSOL_CG
    asked(model, SPARSE)
    assert model.opt.jacobian == SPARSE


@pytest.mark.parametrize(
    ("changed", "stays"), [("", True), ('<joint range="-1 1" axis="0 1 0"/>', not SPARSE_NEWTON_ERRS)]
)
def test_limits_make_it_dense_beforehand(changed, stays):
    """Newton stops at its tolerance there, so that a gradient does not tell a wrong factor."""
    text = GROUPED.replace("<joint/>", changed or "<joint/>", 1)
    model = prepare(mujoco.MjModel.from_xml_string(text), integrator="euler")
    assert (model.opt.jacobian == SPARSE) == stays


@pytest.mark.parametrize(
    "task",
    [
        Task("calibration", MUJOCO, (), (), "rk4", "default"),
        Task("lockstep", MUJOCO, ("matched", "hard"), (AUTO,), "euler", "default"),
        Task("lockstep", AUTO, ("matched", "hard"), (AUTO,), "rk4", "default", "both"),
        Task("one-step", MUJOCO, ("matched",), (AUTO,), "euler", "default"),
        Task("free", MUJOCO, ("matched", "hard"), (MUJOCO, AUTO), "implicit", "default"),
    ],
    ids=lambda task: f"{task.mode}-{task.walker.name}",
)
def test_both_paths_ask_once_more_alike(tmp_path, task):
    for _, _, steps in require_equal(case_of(write_model(tmp_path, GROUPED)), task, 60):
        assert len(steps) == 60
        if task.mode == "calibration":
            assert steps["trajectory_diff"].max() <= SAME
        if task.mode == "lockstep" and task.forms[0] == "matched" and "qacc_rel_diff" in steps.columns:
            assert steps["min_norm_error"].max() <= SAME
