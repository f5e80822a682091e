"""What is code, and how it is kept from running."""

import os

import pytest
from mechanisms import four_bar, write_model
from oarlock.cases.case import NO_CODE
from suites import TINY, python_model


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    """As it was, after a command that sets it."""
    monkeypatch.setenv(NO_CODE, "")
    yield
    os.environ[NO_CODE] = ""


@pytest.fixture
def code(tmp_path):
    """A case whose model is code that leaves a trace."""
    return python_model(tmp_path / "code", "(HERE.parent / 'ran').touch()")


COMMANDS = {
    "run": ["run", "code", "--mode", "free", "--duration", "0.01"],
    "file": ["run", "code/model.py", "--mode", "free", "--duration", "0.01"],
    "check": ["check", "code", "--budget", "0", "--duration", "0.01"],
    "suite": ["suite", "code", "--jobs", "1"],
    "sweep": ["suite", "code", "--jobs", "1", "--sweep", "seed=1:2:2"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_code_is_refused_before_anything_is_done(code, oarlock_here, tmp_path, command):
    done = oarlock_here(*COMMANDS[command], "--no-code")
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if "is code" in line]
    assert "model.py' is code, which --no-code (OARLOCK_NO_CODE) keeps from running, expected MJCF" in line
    assert not (tmp_path / "ran").exists()
    assert not list(tmp_path.rglob("*.parquet"))


def test_code_runs_unless_it_is_refused(code, oarlock_here, tmp_path):
    assert oarlock_here(*COMMANDS["run"]).returncode == 0
    assert (tmp_path / "ran").exists()


def test_the_environment_refuses_it_too(code, oarlock_here, monkeypatch):
    monkeypatch.setenv(NO_CODE, "1")
    assert "is code" in oarlock_here(*COMMANDS["run"]).stderr


def test_other_models_go_on(code, oarlock_here, tmp_path):
    """MJCF, and the code of models that come along."""
    write_model(tmp_path / "tiny", four_bar(), TINY)
    done = oarlock_here("suite", "tiny", "code", "--jobs", "1", "--no-code")
    assert done.returncode == 2
    assert len(list(tmp_path.glob("results/tiny/steps/*.parquet"))) == 7
    assert oarlock_here("run", "n_four_bar", "--no-code", "--mode", "free", "--duration", "0.002").returncode in (0, 1)
