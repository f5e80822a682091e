"""A short attack stands: what ``make test-attack`` does for a quarter of an hour, for a minute."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from attack import endings, fence
from places import TESTS


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_suites_that_are_ended_and_pairs_in_one_folder(capsys):
    assert endings.main(["--tries", "8", "--pairs", "4", "--seconds", "120"]) == 0, capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.skipif(not fence.available(), reason="needs a kernel that keeps what is attacked from writing elsewhere")
@pytest.mark.parametrize("part", ["models", "cases", "arguments", "folders", "kept"])
def test_mutated_inputs_and_damaged_results(part):
    arguments = [sys.executable, "-m", "attack", "--only", part, "--tries", "25", "--seed", "1"]
    done = subprocess.run(arguments, cwd=TESTS, capture_output=True, encoding="utf-8", timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " tried, " in done.stdout


@pytest.mark.skipif(not fence.available(), reason="needs a kernel that can")
def test_nothing_gets_over_the_fence(tmp_path):
    (tmp_path / "in").mkdir()
    theirs = tmp_path / "theirs"
    theirs.write_text("theirs")
    (tmp_path / "in" / "link").symlink_to(theirs)
    pid = os.fork()
    if not pid:
        fence.fence(tmp_path / "in")
        (tmp_path / "in" / "own").write_text("own")
        ways = [
            lambda: (tmp_path / "in" / "link").write_text("mine"),
            lambda: os.truncate(theirs, 0),
            lambda: os.replace(tmp_path / "in" / "own", theirs),
            lambda: os.rename(tmp_path / "in", tmp_path / "out"),
            theirs.unlink,
            (tmp_path / "new").touch,
            (tmp_path / "folder").mkdir,
        ]
        os._exit(sum(_done(way) for way in ways))
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "theirs"]
    assert theirs.read_text() == "theirs"
    assert Path(tmp_path / "in" / "own").read_text() == "own"


def _done(way):
    try:
        way()
    except OSError:
        return False
    return True
