"""The workers of a suite: processes of this machine, or anything else that takes a function and returns a future.

Only ``dispatch`` knows how work is handed out. A kind of workers is a class with the members of ``Workers``:
``LocalWorkers`` here, ``Cluster`` in ``cluster.py``.
"""

import itertools
import multiprocessing
import os
import pickle
import shutil
import signal
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from oarlock.base.errors import InputError
from oarlock.base.processes import end_with_parent, how_ended
from oarlock.base.pulse import felt_by
from oarlock.base.scratch import scratch

Item = TypeVar("Item")
Result = TypeVar("Result")

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Variables that keep a worker to one thread, because the workers share the cores."""

_SLICE_S = 0.5

_GRACE_S = 2.0
"""Time that processes have to end by themselves once another one has died, s."""

UNIT_TIMEOUT_S = 3600.0
"""Time that an item may be silent unless something else is asked for, s."""

OVERDUE = "no step within the time that a run may be silent (--unit-timeout)"


class Workers(Protocol):
    """The interface of workers that ``dispatch`` uses."""

    @property
    def slots(self) -> int:
        """Number of items that are in work at once."""
        ...

    def submit(self, function: Callable[[Item], Result], item: Item) -> "Future[Result]":
        """Hands out an item; returns the future of its result.

        If a worker dies and that may be another item's fault, the future ends in a BrokenExecutor, as do all that are
        in work. If an item's worker dies twice and it cannot be another item's fault, its future ends in a DiedError.

        Raises:
            BrokenExecutor: a worker died and ``renew`` was not called yet.
            LostError: there are no workers any more. Futures may end in it, too.
        """
        ...

    def renew(self) -> str:
        """Replaces the workers after one died; returns how it died, as far as that is known."""
        ...

    def expire(self) -> "set[Future[Any]]":
        """Ends the workers of items that are silent for longer than an item may be; returns their futures.

        These end as if the worker had died, and so may others. Workers that see to that by themselves return nothing.
        """
        ...

    def close(self) -> None:
        """Releases the workers once all work is finished."""
        ...

    def kill(self) -> None:
        """Ends the workers at once; what is in work is lost."""
        ...


class LocalWorkers:
    """Processes of this machine, which are started when they are needed and used again.

    Results are passed in files: a process that is killed while it writes to the pool's pipe would leave half a message
    there, and its reader waiting for ever. The name of a file is written in one piece.
    """

    def __init__(self, jobs: int, limit_s: float | None = None):
        """Starts nothing yet.

        Args:
            jobs: number of processes at most.
            limit_s: time that an item may be in work without a beat of its pulse (``base.pulse``), s; None for ever.
        """
        self._jobs, self._limit_s = jobs, limit_s
        self._files: Path | None = None
        self._pool: ProcessPoolExecutor | None = None
        self._clocks: dict[Future[Any], _Clock] = {}
        self._numbers = itertools.count()
        self._processes: list[multiprocessing.process.BaseProcess] = []

    @property
    def slots(self) -> int:
        """Number of processes; each has one item in work."""
        return self._jobs

    def submit(self, function: Callable[[Item], Result], item: Item) -> "Future[Result]":
        """Hands out an item; see ``Workers``."""
        if self._pool is None or self._files is None:
            self._files = scratch()
            main = threading.current_thread() is threading.main_thread()
            # Not fork: a library's threads would not survive it.
            self._pool = ProcessPoolExecutor(
                self._jobs,
                mp_context=multiprocessing.get_context("spawn"),
                initializer=partial(end_with_parent, os.getpid(), from_main_thread=main),
            )
        before = multiprocessing.active_children()
        result: Future[Result] = Future()
        pulse = self._files / f"pulse-{next(self._numbers)}"
        with uninterrupted_children(), _one_thread():
            file = self._pool.submit(_to_file, function, item, str(self._files), str(pulse))
        file.add_done_callback(partial(_from_file, result))
        if self._limit_s is not None:
            self._clocks[result] = _Clock(pulse, self._limit_s)
            result.add_done_callback(lambda future: self._clocks.pop(future, None))
        self._processes += [child for child in multiprocessing.active_children() if child not in before]
        return result

    def renew(self) -> str:
        """Replaces the processes after one died; see ``Workers``."""
        processes, forced = self._processes, []
        # The pool ends those that are left with SIGTERM, which one that is stopped does not obey.
        force = threading.Timer(_GRACE_S, lambda: forced.extend(_killed(processes)))
        force.daemon = True
        force.start()
        self._let_go(wait=True)
        force.cancel()
        codes = [p.exitcode for p in processes if p not in forced and p.exitcode not in (None, 0, -signal.SIGTERM)]
        if not codes or codes[0] is None:
            return "its process ended"
        return f"its process ended with {how_ended(codes[0])}"

    def expire(self) -> "set[Future[Any]]":
        """Ends all processes if one item has been silent for too long; see ``Workers``."""
        late = {future for future, clock in list(self._clocks.items()) if clock.late()}
        if late:
            _killed(self._processes)
        return late

    def close(self) -> None:
        """Releases the processes once all work is finished; see ``Workers``."""
        self._let_go(wait=True)

    def kill(self) -> None:
        """Ends the processes at once; see ``Workers``."""
        _killed(self._processes)
        self._let_go(wait=False)

    def _let_go(self, *, wait: bool) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=wait, cancel_futures=True)
        if self._files is not None:
            shutil.rmtree(self._files, ignore_errors=True)
        self._pool, self._files, self._processes = None, None, []


class _Clock:
    """How long an item has been silent. Beats are told by the time of a file, which only has to change."""

    def __init__(self, pulse: Path, limit_s: float):
        self._pulse, self._limit_s = pulse, limit_s
        self._last: int | None = None
        self._due = time.monotonic() + limit_s

    def late(self) -> bool:
        """Whether nothing was heard for too long."""
        try:
            last = self._pulse.stat().st_mtime_ns
        except OSError:  # not a beat yet
            last = None
        if last != self._last:
            self._last, self._due = last, time.monotonic() + self._limit_s
        return self._due < time.monotonic()


def _killed(processes: list[multiprocessing.process.BaseProcess]) -> list[multiprocessing.process.BaseProcess]:
    """Ends processes at once, also those that are stopped; returns those that lived."""
    lived = [process for process in processes if process.is_alive()]
    for process in lived:
        process.kill()
    return lived


def _to_file(function: Callable[[Item], Any], item: Item, folder: str, pulse: str) -> str:
    tempfile.tempdir = folder  # whatever it leaves when it is killed goes with that
    with felt_by(partial(Path(pulse).touch)):
        result = function(item)
    Path(pulse).unlink(missing_ok=True)
    with tempfile.NamedTemporaryFile(dir=folder, delete=False) as file:
        pickle.dump(result, file)
    return file.name


def _from_file(result: "Future[Any]", file: "Future[str]") -> None:
    try:
        path = Path(file.result())
        content = pickle.loads(path.read_bytes())
        path.unlink()
    except BaseException as error:
        result.set_exception(error)
    else:
        result.set_result(content)


@contextmanager
def uninterrupted_children() -> Iterator[None]:
    """Keeps what a terminal sends to all its processes away from those started in the block; this process ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
    multiprocessing.get_context("spawn").Lock()  # starts multiprocessing's tracker, which lets interruptions in again
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Keeps linear algebra of processes started in the block on one thread, unless the user set it otherwise."""
    added = [name for name in _ONE_THREAD if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


class DiedError(Exception):
    """The worker of an item died twice, the second time with nothing else in work, or had to be ended twice."""


class LostError(InputError):
    """The workers are gone for good, and nothing that is waiting can be finished."""


class Done(Generic[Item, Result]):
    """A finished item.

    Attributes:
        item: the item.
        error: the error that it ended in; None if it has a result.
    """

    def __init__(self, item: Item, future: "Future[Result] | None" = None, error: BaseException | None = None):
        self.item = item
        self.error = error if future is None else future.exception()
        self._future = future

    @property
    def result(self) -> Result:
        """The result of the item. Reading it raises the error if there is one."""
        if self.error is not None or self._future is None:
            raise self.error or RuntimeError("nothing came of it")
        return self._future.result()


def dispatch(
    function: Callable[[Item], Result], items: Iterable[Item], workers: Workers
) -> Generator[Done[Item, Result]]:
    """Calls a function on every item, in the order given, and yields each item as soon as it is finished.

    When a worker dies, everything that was in work is run again, one at a time: a second death is then the item's own
    fault, and the others go on. An item that is silent for too long is run once more as well, and so is what was in
    work beside it. Workers are killed if the iteration is left early, by an interruption or otherwise.

    Raises:
        LostError: the workers are gone for good; what was finished until then is yielded before.
    """
    waiting, suspects = deque(items), deque[Item]()
    flying: dict[Future[Result], Item] = {}
    overran: set[Item] = set()
    whole = False
    try:
        while waiting or suspects or flying:
            alone = bool(suspects)
            broken: list[Item] = []
            queue, slots = (suspects, 1) if alone else (waiting, workers.slots)
            while queue and len(flying) < slots and not broken:
                item = queue.popleft()
                try:
                    flying[workers.submit(function, item)] = item
                except BrokenExecutor:
                    if flying:  # one of those; this one had not begun
                        queue.appendleft(item)
                        break
                    broken.append(item)
            done: set[Future[Result]] = set()
            late: set[Future[Any]] = set()
            while flying and not done:  # in slices: an interruption that reaches another thread does not end a wait
                done, _ = wait(flying, _SLICE_S, return_when=FIRST_COMPLETED)
                late |= set() if done else workers.expire()
            if any(isinstance(future.exception(), BrokenExecutor) for future in done):
                done, _ = wait(flying)
            lost: LostError | None = None
            overdue: list[Item] = []
            for future in sorted(done, key=list(flying).index):
                item, error = flying.pop(future), future.exception()
                if isinstance(error, BrokenExecutor):
                    (overdue if future in late else broken).append(item)
                elif isinstance(error, LostError):
                    lost = error
                else:
                    yield Done(item, future)
            if lost:
                raise lost
            if broken or overdue:
                how = workers.renew()
                for item in overdue:
                    if item in overran:
                        yield Done(item, error=DiedError(f"{OVERDUE}, twice"))
                    else:
                        overran.add(item)
                        waiting.append(item)
                if overdue:  # whose fault it was is known
                    (suspects if alone else waiting).extendleft(reversed(broken))
                elif alone:
                    yield from (Done(item, error=DiedError(f"{how}, twice")) for item in broken)
                else:
                    suspects.extend(broken)
        whole = True
    finally:
        if not whole:
            workers.kill()
