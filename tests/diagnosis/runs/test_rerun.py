"""The same run again: of an unchanged model the same bits, of a changed one its own motion, or nothing."""

import copy

import mujoco
import numpy as np
import pytest
from diagnosis.runs.test_row_law import recorded
from gallery import piece
from oarlock.diagnosis.runs.rerun import rerun

STEPS = 60


@pytest.mark.parametrize("name", ["boat", "gripping_gripper", "cable_finger"])
def test_an_unchanged_model_makes_the_same_run(name):
    recording = recorded(piece(name), STEPS)
    again = rerun(recording, copy.deepcopy(recording.model))
    assert again is not None
    assert np.array_equal(again.position, recording.position)
    assert np.array_equal(again.qpos, recording.qpos)
    assert np.abs(again.position).max() > 0.0


def test_a_changed_model_goes_its_own_way_as_plain_steps_do():
    recording = recorded(piece("four_bar"), STEPS)
    model = copy.deepcopy(recording.model)
    model.opt.timestep /= 4
    again = rerun(recording, model, parts=4, steps=STEPS // 2)
    assert again is not None
    assert not np.array_equal(again.qpos[-1], recording.qpos[STEPS // 2 - 1])
    data = recording.restart(model)
    for step in range(STEPS // 2):
        assert np.array_equal(again.qpos[step], data.qpos)
        for _ in range(4):
            mujoco.mj_step(model, data)


def test_a_run_that_does_not_stay_finite_is_none():
    recording = recorded(piece("four_bar"), STEPS)
    model = copy.deepcopy(recording.model)
    model.eq_solref[:] = (-1e12, -1e3)
    assert rerun(recording, model) is None
