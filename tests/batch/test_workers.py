"""How work is handed out: a worker that dies takes only its own item with it. Real processes: ``test_suite.py``."""

from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing

from oarlock.batch.workers import dispatch


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
