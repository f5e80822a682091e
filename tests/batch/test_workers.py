"""How work is handed out: a worker that dies or stops takes only its own item with it, and none outlives its parent.

Units in real processes: ``test_suite.py``.
"""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing

import pytest
from oarlock.batch.workers import LocalWorkers, dispatch
from places import TESTS
from suites import SILENCE_S, alive, slow_with_a_pulse, stopped_once, stopped_twice
from tolerances import GONE_S

SPAWNED_S = 10.0
"""More than a process takes to start on a machine with other things to do, s."""

PARENT = """
import sys, threading
sys.path.insert(0, sys.argv[1])
from suites import told_where
from oarlock.batch.workers import LocalWorkers, dispatch
work = lambda: list(dispatch(told_where, sys.argv[3:], LocalWorkers(2)))
if __name__ == "__main__":
    if sys.argv[2] == "main":
        work()
    else:
        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        thread.join()
"""
"""Hands items out, in its main thread or in another."""


class FragileWorkers:
    """Workers in this process that do an item when it is waited for; those named break all that is in work."""

    def __init__(self, slots, deadly):
        self.slots, self.deadly = slots, deadly
        self.flying, self.renewed, self.killed, self.together = [], 0, False, []

    def submit(self, function, item):
        future = Future()
        self.flying.append((future, function, item))
        if len(self.flying) == self.slots or item in self.alone():
            self.land()
        return future

    def alone(self):
        return self.deadly if self.renewed else ()

    def land(self):
        self.together.append([item for _, _, item in self.flying])
        broken = any(item in self.deadly for _, _, item in self.flying)
        for future, function, item in self.flying:
            if broken:
                future.set_exception(BrokenProcessPool("gone"))
            else:
                future.set_result(function(item))
        self.flying = []

    def renew(self):
        self.renewed += 1
        self.slots = 1
        return "its process ended"

    def expire(self):
        return set()

    def close(self): ...

    def kill(self):
        self.killed = True


def test_the_innocent_are_done_again_alone():
    workers = FragileWorkers(3, deadly=["b"])
    done = {d.item: d for d in dispatch(str.upper, ["a", "b", "c", "d", "e"], workers)}
    assert {item: d.result for item, d in done.items() if d.error is None} == {"a": "A", "c": "C", "d": "D", "e": "E"}
    assert str(done["b"].error) == "its process ended, twice"
    assert workers.together[:4] == [["a", "b", "c"], ["a"], ["b"], ["c"]]
    assert workers.renewed == 2
    assert not workers.killed


def test_leaving_early_kills_the_workers():
    workers = FragileWorkers(1, deadly=[])
    with closing(dispatch(str.upper, ["a", "b"], workers)) as all_done:
        assert next(all_done).result == "A"
    assert workers.killed


@pytest.mark.parametrize("thread", ["main", "another"])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP], ids=lambda number: number.name)
def test_no_worker_outlives_its_parent(tmp_path, thread, number):
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    notes = [tmp_path / "a", tmp_path / "b"]
    arguments = [sys.executable, script, TESTS, thread, *notes]
    with subprocess.Popen(arguments, stderr=subprocess.DEVNULL, env={**os.environ, "TMPDIR": str(tmp_path)}) as parent:
        deadline = time.monotonic() + 60
        while not all(note.exists() for note in notes):
            assert parent.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.01)
        found = [int(note.read_text()) for note in notes]
        assert all(alive(process) for process in found)
        os.kill(found[0], signal.SIGSTOP if thread == "main" and sys.platform == "linux" else signal.SIGCONT)
        parent.send_signal(number)
        parent.wait()
    deadline = time.monotonic() + GONE_S
    while any(alive(process) for process in found):
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_what_a_stopped_worker_had_is_done_elsewhere(tmp_path):
    with closing(LocalWorkers(2, limit_s=SPAWNED_S)) as workers:
        items = [str(tmp_path / name) for name in "abc"]
        began = time.monotonic()
        done = {d.item: d for d in dispatch(stopped_once, items, workers)}
    assert time.monotonic() - began < 60
    assert {item: d.result for item, d in done.items()} == {item: f"{item} done" for item in items}


def test_what_goes_on_may_take_as_long_as_it_likes(tmp_path):
    with closing(LocalWorkers(1, limit_s=SILENCE_S)) as workers:
        (done,) = dispatch(slow_with_a_pulse, [str(tmp_path / "a")], workers)
    assert done.result == 1


def test_what_never_ends_fails_and_nothing_else_does(tmp_path):
    with closing(LocalWorkers(2, limit_s=SPAWNED_S)) as workers:
        items = [str(tmp_path / name) for name in "abc"]
        done = {d.item: d for d in dispatch(stopped_twice, items, workers)}
    errors = {item: str(d.error) for item, d in done.items() if d.error}
    assert errors == {items[0]: "no step within the time that a run may be silent (--unit-timeout), twice"}
    assert all(done[item].result == f"{item} done" for item in items[1:])
