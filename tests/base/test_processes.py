"""Which process something belongs to: a later one of the same number is not taken for it."""

import os
import subprocess
import sys
from dataclasses import replace

import pytest
from oarlock.base.processes import Owner, myself


def test_this_process_lives_and_can_be_read_back():
    owner = myself()
    assert Owner.parse(str(owner)) == owner
    assert owner.here
    assert not owner.dead


@pytest.mark.parametrize(
    "text", ["", "12", "12-34", "12-34-xyz", "-12-34-0a0a0a0a", "12-34-0a0a0a0a/..", "١-1-0a0a0a0a"]
)
def test_anything_else_is_nobody(text):
    assert Owner.parse(text) is None


@pytest.mark.skipif(sys.platform == "win32", reason="no way to look for a process")
def test_one_that_ended_is_dead_also_while_nobody_asked_how():
    with subprocess.Popen([sys.executable, "-c", "print()"], stdout=subprocess.PIPE) as process:
        owner = replace(myself(), pid=process.pid, started=0)
        assert process.stdout is not None
        process.stdout.read()
        if sys.platform == "linux":  # a zombie until then
            os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
            assert owner.dead
        process.wait()
        assert owner.dead


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells when a process was started")
def test_another_of_the_same_number_is_not_taken_for_it():
    assert replace(myself(), started=myself().started + 1).dead


def test_of_another_machine_nothing_is_said():
    owner = replace(myself(), host="00000000", pid=2**22 + 1)
    assert not owner.here
    assert not owner.dead
