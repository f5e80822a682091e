"""What a folder holds is not lost to a run of something else."""

import json
import shutil
from dataclasses import replace

import oarlock
import pytest
from mechanisms import four_bar, write_model
from oarlock import InputError
from oarlock.base.lock import NAME, locked
from oarlock.base.processes import myself
from suites import TINY, Heard


class Told(Heard):
    """What was noted besides."""

    def __init__(self):
        super().__init__()
        self.notes = []

    def note(self, text):
        self.notes.append(text)


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A case, the results of its experiments, and those of its suite."""
    folder = tmp_path_factory.mktemp("held")
    case = write_model(folder / "tiny", four_bar(), TINY).parent
    oarlock.run(case, out=folder / "run")
    oarlock.suite(case, out=folder / "suite", jobs=1)
    return folder


@pytest.fixture
def held(made, tmp_path):
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    return tmp_path


OTHERS = {
    "other solvers": (
        "run",
        {"mode": "free", "solver": "svd"},
        "other runs, lockstep-matched-along-mujoco-pinv-rk4 and",
    ),
    "shorter": ("run", {"duration": 0.01}, "runs of 10 steps of 0.002 s"),
    "another timestep": ("run", {"timestep": 0.001}, "runs of 10 steps of 0.002 s"),
    "without contacts": ("run", {"ignore_inequalities": True}, "runs with contacts, limits and friction"),
    "a suite": ("suite/tiny", {}, "the results of a suite"),
}


@pytest.mark.parametrize("what", OTHERS)
def test_other_results_are_not_touched(held, what):
    where, asked, said = OTHERS[what]
    before = contents(held)
    with pytest.raises(InputError) as refused:
        oarlock.run(held / "tiny", out=held / where, **asked)
    assert str(refused.value).startswith(f"'{held / where}' holds {said}")
    assert str(refused.value).endswith(", expected another folder (--out), or --replace")
    assert contents(held) == before
    results = oarlock.run(held / "tiny", out=held / where, replace=True, **asked)
    tables = {path.stem for path in (held / where / "steps").iterdir()}
    assert tables == {row["run"] for row in results.rows}


def test_results_of_another_case_are_not_touched(held):
    shutil.copytree(held / "tiny", held / "other")
    with pytest.raises(InputError, match="holds runs of case 'tiny', expected"):
        oarlock.run(held / "other", out=held / "run")


def test_the_same_runs_are_written_anew(held):
    """Also where a part of them is there, or a summary that cannot be read."""
    oarlock.run(held / "tiny", out=held / "run")
    summary = held / "run" / "summary.json"
    document = json.loads(summary.read_text())
    summary.write_text(json.dumps({**document, "runs": document["runs"][:2]}))
    oarlock.run(held / "tiny", out=held / "run")
    summary.write_text("{")
    assert len(oarlock.run(held / "tiny", out=held / "run").rows) == 7


def test_by_default_they_go_beside(held, oarlock_here):
    assert oarlock_here("run", held / "tiny").returncode == 0
    before = contents(held / "results" / "tiny")
    for number, mode in ((2, "free"), (3, "lockstep"), (2, "free")):
        done = oarlock_here("run", held / "tiny", "--mode", mode, "--duration", "0.01")
        assert done.returncode == 0
        assert f"; the tables are in 'results/tiny-{number}'\n" in done.stderr
        assert done.stderr.startswith("oarlock: 'results/tiny' holds other runs, ")
    assert contents(held / "results" / "tiny") == before
    done = oarlock_here("run", held / "tiny", "--mode", "free", "--replace")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_suite_refuses_those_of_another_run(held, oarlock_here):
    oarlock.run(held / "tiny", out=held / "out" / "tiny", duration=0.01)
    before = contents(held)
    done = oarlock_here("suite", held / "tiny", "--out", held / "out")
    assert done.returncode == 2
    assert done.stderr == (
        f"oarlock: '{held / 'out' / 'tiny'}' holds runs of 5 steps of 0.002 s of 'oarlock run', "
        "expected another folder (--out), or none there\n"
    )
    assert contents(held) == before
    shutil.copytree(held / "run", held / "same" / "tiny")
    assert oarlock.suite(held / "tiny", out=held / "same", jobs=1).status == 0


def test_a_folder_in_use_is_refused_by_name(held, oarlock_here):
    folder = held / "suite" / "tiny"
    with locked([held / "run"], "oarlock run boat", print), locked([folder], "oarlock run boat", print):
        before = contents(held)
        for command, out in (("run", "run"), ("suite", "suite")):
            done = oarlock_here(command, held / "tiny", "--out", held / out)
            assert done.returncode == 2
            assert "is in use by 'oarlock run boat', process " in done.stderr
            assert len(done.stderr.splitlines()) == 1
        assert contents(held) == before
    with pytest.raises(InputError, match="is in use"), locked([held / "saved"], "oarlock suite", print):
        oarlock.run(held / "tiny", mode="free").save(held / "saved")


def test_what_dead_processes_left_is_said(held):
    left = held / "run" / f".steps.{replace(myself(), pid=2**22 + 1)}.abc"
    left.mkdir()
    told = Told()
    oarlock.run(held / "tiny", out=held / "run", progress=told)
    assert not left.exists()
    assert [note for note in told.notes if str(held / "run") in note]
    assert not (held / "run" / NAME).exists()
