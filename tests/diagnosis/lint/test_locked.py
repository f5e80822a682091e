"""Locks that a lint sees, and what is said of them."""

import mujoco
import numpy as np
import pytest
from oarlock.diagnosis.lint.locked import without
from oarlock.mechanics.load import load_model
from seen import CHECK, of_file, only


@pytest.mark.parametrize(
    ("equalities", "frees", "said"),
    [
        (["a"], ["a"], ["it would move without 'a'"]),
        (["a"], [], []),
        (["a", "b"], ["b"], ["it would move without 'b'"]),
        (["a", "b", "c"], ["a", "c"], ["'a' and 'c' contradict each other: it would move without 'a' or 'c'"]),
        (["a", "b", "c"], ["a", "b", "c"], ["it would move without 'a', 'b' or 'c'"]),
        (["a", "b"], [], ["leaving out one of its equalities does not free it"]),
    ],
)
def test_what_would_have_to_go(equalities, frees, said):
    assert without(equalities, frees) == said


@pytest.mark.parametrize("name", ["tilted_hinge.xml", "locked_cranks.xml"])
def test_what_is_named_frees_it_and_what_is_not_does_not(name):
    """By the rank of plain MuJoCo's rows of one equality less, at the closed pose that the lint took."""
    one = only(of_file(name), "S3")
    assert one.severity is None
    named = one.line.partition("it would move without ")[2].replace("'", "").split(" or ")
    model = load_model(CHECK / name)
    pose = closed(model)

    def freedoms(dropped: int | None) -> int:
        data = mujoco.MjData(model)
        data.qpos[:] = pose
        if dropped is not None:
            data.eq_active[dropped] = 0
        mujoco.mj_forward(model, data)
        if not data.ne:
            return model.nv
        return model.nv - int(np.linalg.matrix_rank(data.efc_J.reshape(-1, model.nv)[: data.ne], tol=1e-6))

    assert freedoms(None) == 0
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_EQUALITY, index) for index in range(model.neq)]
    assert [each for index, each in enumerate(names) if freedoms(index) > 0] == named


def closed(model: mujoco.MjModel) -> np.ndarray:
    """A pose (nq) near the start at which plain MuJoCo's rows are closed, by Newton's method."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(50):
        mujoco.mj_forward(model, data)
        rows = data.efc_J.reshape(-1, model.nv)[: data.ne]
        mujoco.mj_integratePos(model, data.qpos, -np.linalg.pinv(rows, rcond=1e-10) @ data.efc_pos[: data.ne], 1.0)
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-9
    return data.qpos.copy()
