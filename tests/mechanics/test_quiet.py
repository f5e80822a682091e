"""MuJoCo prints its warnings and writes them to MUJOCO_LOG.TXT in the working folder, unless it is kept from that."""

import os
import re
from pathlib import Path

import mujoco
import pytest
from mechanisms import four_bar
from oarlock.mechanics.load import quiet_engine

pytestmark = pytest.mark.filterwarnings("default:MuJoCo warns")

MODELS = {
    "no memory for rows": four_bar().replace("<mujoco>", '<mujoco><size memory="500"/>', 1),
    "no memory for a step": four_bar().replace("<mujoco>", '<mujoco><size memory="1K"/>', 1),
    "blows up": four_bar(joint='damping="-1e5"'),
}
COMMANDS = {
    "run": ("run", "model.xml", "--mode", "free", "--duration", "0.1"),
    "in Python": ("run", "model.xml", "--mode", "free", "--duration", "0.1", "--stepping", "python"),
    "check": ("check", "model.xml", "--duration", "0.1", "--budget", "0"),
    "new": ("new", "x", "model.xml", "--to", "."),
}


@pytest.mark.parametrize("what", MODELS)
@pytest.mark.parametrize("command", COMMANDS)
def test_no_log_is_left(oarlock_here, tmp_path, what, command):
    (tmp_path / "model.xml").write_text(MODELS[what])
    done = oarlock_here(*COMMANDS[command])
    assert done.returncode in (0, 1, 2)
    assert not [line for line in done.stderr.splitlines() if not line.startswith("oarlock: ")]
    assert {path.name for path in tmp_path.iterdir()} <= {"model.xml", "results", "x"}


def test_a_check_says_that_the_memory_is_too_small(oarlock_here, tmp_path):
    (tmp_path / "model.xml").write_text(MODELS["no memory for rows"])
    said = oarlock_here(*COMMANDS["check"]).stderr.splitlines()
    assert [line for line in said if line.startswith("oarlock: MuJoCo warns: Insufficient arena memory")] != []
    assert len(said) == len(set(said))


def test_others_hear_mujoco_as_before(tmp_path, monkeypatch):
    """Outside of what oarlock does, the process is the user's."""
    monkeypatch.chdir(tmp_path)
    heard = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(heard.append)
    try:
        with quiet_engine():
            step_into_the_void()
        assert heard == []
        step_into_the_void()
        assert [re.sub(" at.*", "", text) for text in heard] == ["Nan, Inf or huge value in QVEL"]
    finally:
        mujoco.set_mju_user_warning(before)
    assert os.listdir(Path()) == []


def step_into_the_void():
    model = mujoco.MjModel.from_xml_string(four_bar())
    data = mujoco.MjData(model)
    data.qvel[0] = 1e300
    mujoco.mj_step(model, data)
