"""Programs in processes of their own: answers, crashes, silence, and what is no answer."""

import os
import time
from pathlib import Path

import mujoco
import numpy as np
import pytest
from fake_engines import engine
from mechanisms import four_bar
from oarlock.engines import asking, environments, running
from oarlock.engines.answers import read
from oarlock.engines.registry import parse_engine

STATES = 3


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    """A question about three states of a four-bar: model, states, folder."""
    model = mujoco.MjModel.from_xml_string(four_bar())
    qvel = np.outer([0.0, 1.0, 2.0], np.ones(model.nv))
    qpos = np.tile(model.qpos0, (STATES, 1))
    states = asking.states_of(model, qpos, qvel, np.zeros((STATES, 0)))
    files = {
        "model.xml": four_bar().encode(),
        "model.npz": asking.arrays_of(model),
        "states.parquet": states.table(),
        "ask.json": asking.ask("four_bar", model, "step"),
    }
    return model, states, asking.write(tmp_path_factory.mktemp("ask") / "step", files)


def answered(tmp_path, name, asked, silence_s=60.0):
    model, states, folder = asked
    chosen = engine(tmp_path, name)
    written = running.run(chosen.program, environments.find(chosen), [folder], silence_s)
    return read(written.files[0], model.nq, model.nv, len(states), written.status)


def test_this_mujoco_answers_as_itself(asked):
    model, states, folder = asked
    chosen = parse_engine("mujoco")
    written = running.run(chosen.program, environments.find(chosen), [folder])
    answer = read(written.files[0], model.nq, model.nv, len(states), written.status)
    data = mujoco.MjData(model)
    for row in range(len(states)):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = states.qpos[row], states.qvel[row]
        mujoco.mj_step(model, data)
        np.testing.assert_array_equal(answer.qvel[row], data.qvel)
    assert answer.versions == {"mujoco": mujoco.__version__}
    assert answer.facts["compiled_apart"] == {}
    assert answer.facts["total_mass"] == pytest.approx(model.body_mass.sum(), rel=1e-15)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("crashes", "crashes ended with status 7: it is broken"),
        ("dies", "dies ended with SIGKILL"),
        ("nan", "qacc of row 1 is not finite"),
        ("half", "answer.parquet has 1 rows, expected 3"),
        ("wrong_size", "qacc has entries of size 2, expected 3"),
    ],
)
def test_what_is_no_answer_is_one_line(tmp_path, asked, name, message):
    with pytest.raises(running.EngineError, match=message) as failed:
        answered(tmp_path, name, asked)
    assert "\n" not in str(failed.value)


def test_the_tail_of_its_complaints_is_kept(tmp_path, asked):
    with pytest.raises(running.EngineError) as failed:
        answered(tmp_path, "crashes", asked)
    assert failed.value.tail == b"a word before\nit is broken\n"


def test_what_cannot_be_expressed_is_an_answer(tmp_path, asked):
    answer = answered(tmp_path, "cannot", asked)
    assert not answer.expressible
    assert answer.not_expressible == [{"element": "equality 'pin'", "why": "no such thing"}]


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state not in "ZX"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked at in /proc")
def test_a_silent_program_is_ended_with_its_children(tmp_path, asked, monkeypatch):
    notes = tmp_path / "notes"
    monkeypatch.setenv("OARLOCK_TEST_NOTES", str(notes))
    with pytest.raises(running.EngineError, match="hangs was silent for 3 s and was ended"):
        answered(tmp_path, "hangs", asked, silence_s=3.0)
    numbers = [int(word) for word in notes.read_text().split()]
    assert len(numbers) == 2
    until = time.monotonic() + 10.0
    while any(map(alive, numbers)) and time.monotonic() < until:
        time.sleep(0.05)
    assert [number for number in numbers if alive(number)] == []


def test_an_interpreter_that_is_none_is_named(tmp_path):
    from oarlock.base.errors import InputError

    with pytest.raises(InputError, match="'/no/such/python' is no Python that runs"):
        environments.find(parse_engine("mujoco=/no/such/python"))


def test_a_program_sees_its_path_first(tmp_path, asked):
    """A folder of a version comes before the packages of the interpreter."""
    (tmp_path / "first").mkdir()
    (tmp_path / "first" / "mujoco.py").write_text("raise SystemExit(5)")
    chosen = parse_engine("mujoco")
    first = environments.Environment(environments.find(chosen).python, (str(tmp_path / "first"),), "")
    with pytest.raises(running.EngineError, match="ended with status 5"):
        running.run(chosen.program, first, [asked[2]])
    assert os.environ.get("OARLOCK_ENGINE_PATH") is None
