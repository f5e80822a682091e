"""The workers of a dask.distributed cluster: those of a running scheduler, or processes of this machine.

An item is meant for one worker, which has no other item of oarlock in work. So a death has one possible cause: the dead
worker's item is run again elsewhere, once, and the others are not affected. What MuJoCo keeps for a whole process is
safe as well, however many threads a worker has.
"""

import asyncio
import importlib
import logging
import os
import pickle
import signal
import sys
import threading
import uuid
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass
from typing import Any, TypeVar
from urllib.parse import urlsplit

from oarlock.base.errors import InputError, one_line
from oarlock.base.pulse import felt_by
from oarlock.base.scratch import scratch_folder
from oarlock.batch import digest
from oarlock.batch.workers import OVERDUE, DiedError, LostError, uninterrupted_children

Item = TypeVar("Item")
Result = TypeVar("Result")

LOCAL = "local"
"""Stands for a cluster of processes of this machine in place of an address."""

_CONNECT_S = 4.0
_ANSWER_S = 6.0
"""Time to wait for an answer, s; longer than it takes to connect, because what listens may be no scheduler."""
_LOOK_S = 0.5
_ALONE_S = 10.0
"""Time without a worker after which the user is told, s."""
_CLOSE_S = 15.0
_RESTART_S = 60.0
"""Time for a worker to be started anew, s: one that is given up halfway is gone for good, and a machine may be busy."""

_LOGGERS = ("distributed", "distributed.client", "distributed.gc", "tornado", "tornado.application", "asyncio")

_ME = uuid.uuid4().hex
"""Identifies this process as a worker: a restarted one has the address of the one that died, but not its work."""

_TOPIC = "oarlock-pulse"
"""Of the scheduler's events that tell which worker goes on."""

_ONE_AT_A_TIME = threading.Lock()


_THERE = "__import__('oarlock.batch.cluster').batch.cluster.{}(*arguments)"
"""Names a function for ``eval`` on a worker. A worker that cannot import a pickled one would end without a word."""


def greet() -> tuple[str, str]:
    """Returns the identity of this worker and the digest of its program."""
    return _ME, digest.program()


def work(worker: str, call: bytes) -> Any:
    """Runs an item on this worker, if it is the one that is meant.

    Raises:
        RuntimeError: another worker is meant, or the item ended the process.
    """
    if worker != _ME:
        raise RuntimeError("meant for a worker that is gone")
    function, item = pickle.loads(call)
    with _ONE_AT_A_TIME, felt_by(_tell):
        try:
            return function(item)
        except (SystemExit, KeyboardInterrupt) as error:  # they would end the worker
            raise RuntimeError(str(error)) from None


def rested() -> str:
    """Returns the identity of this worker once it has nothing in work."""
    with _ONE_AT_A_TIME:
        return _ME


def _tell() -> None:
    """Tells everybody who listens at the scheduler that this worker goes on."""
    with suppress(ValueError, OSError):  # it is no worker any more
        importlib.import_module("distributed").get_worker().log_event(_TOPIC, _ME)


class _GoneError(Exception):
    """The worker was gone before its result arrived."""

    def __init__(self, expected: bool):
        super().__init__()
        self.expected = expected


@dataclass(eq=False)
class _Seat:
    """A worker of the cluster.

    Attributes:
        address: address of the worker.
        gone: resolved when the worker is gone, with whether that was intended.
        worker: its identity ``_ME``, once it is known.
        unfit: why it cannot be used; empty if it can.
        clock: ends the wait for what it has in work.
    """

    address: str
    gone: "asyncio.Future[bool]"
    worker: str = ""
    unfit: str = ""
    clock: asyncio.Timeout | None = None


class Cluster:
    """The workers of a cluster, as they come and go. Workers with another program than this one are left out.

    Everything about them happens in one thread with an event loop of its own.
    """

    def __init__(self, scheduler: str, jobs: int | None, say: Callable[[str], None], limit_s: float | None = None):
        """Connects to a scheduler. A local cluster is started when it is needed.

        Args:
            scheduler: address of the scheduler, or ``local``.
            jobs: number of items in work at once, or of processes of a local cluster; None for as many as there are
                workers.
            say: called with what the user should know while it runs.
            limit_s: time that an item may be in work without a beat of its pulse (``base.pulse``), s; None for ever.

        Raises:
            InputError: dask.distributed is not installed, or no scheduler answers at the address.
        """
        self._scheduler = _checked(scheduler)
        self._jobs = jobs
        self._say = say
        self._limit_s = limit_s
        self._distributed = _distributed()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="oarlock-cluster", daemon=True)
        self._connected: Future[None] = Future()
        self._stop = asyncio.Event()
        self._hard = False
        self._lost: LostError | None = None
        self._tasks: set[asyncio.Task[Any]] = set()
        self._seats: dict[str, _Seat] = {}
        self._free: asyncio.Queue[_Seat] = asyncio.Queue()
        self._client: Any = None
        if scheduler != LOCAL:
            try:
                self._begin()
                self._connected.result()
            except BaseException:
                self.kill()
                raise

    @property
    def slots(self) -> int:
        """Number of items in work at once, by default unbounded: workers come and go, and items wait here for them."""
        return self._jobs or sys.maxsize

    def submit(self, function: Callable[[Item], Result], item: Item) -> "Future[Result]":
        """Hands out an item; see ``Workers``. A death breaks nothing else, so a second one is the item's own fault."""
        self._begin()
        return asyncio.run_coroutine_threadsafe(self._do(pickle.dumps((function, item))), self._loop)

    def renew(self) -> str:
        """Does nothing, because the workers never break as a whole; see ``Workers``."""
        return "its worker died"

    def expire(self) -> set[Future[Any]]:
        """Does nothing, because every item has a clock of its own, from when a worker has it; see ``Workers``."""
        return set()

    def close(self) -> None:
        """Releases the workers once all work is finished; see ``Workers``."""
        self._end()

    def kill(self) -> None:
        """Ends at once; see ``Workers``. What a remote worker has begun is finished there, and its result lost."""
        self._hard = True
        self._end()

    def _begin(self) -> None:
        if self._thread.ident is None:
            with uninterrupted_children():
                self._thread.start()

    def _end(self) -> None:
        if self._thread.ident is None:
            self._loop.close()
            return
        with suppress(RuntimeError):  # it ended before
            self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(_CLOSE_S)

    # In the thread of the loop.

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._live())

    async def _live(self) -> None:
        stop = asyncio.ensure_future(self._stop.wait())
        life = asyncio.ensure_future(self._serve())
        await asyncio.wait({stop, life}, return_when=asyncio.FIRST_COMPLETED)
        if life.done() and (error := life.exception()):
            lost = self._lose(": ".join(filter(None, ["no answer", one_line(error)])))
            if not self._connected.done():
                self._connected.set_exception(lost)
            await stop
        life.cancel()
        await asyncio.wait({life})

    async def _serve(self) -> None:
        """Until it is cancelled."""
        async with AsyncExitStack() as stack:
            where = await self._started(stack) if self._scheduler == LOCAL else self._scheduler
            make = self._distributed.Client
            client = make(where, asynchronous=True, timeout=_CONNECT_S, set_as_default=False)
            stack.push_async_callback(client.close)
            stack.push_async_callback(self._let_go)
            async with asyncio.timeout(_ANSWER_S):
                self._client = await client
                self._client.subscribe_topic("all", self._hear)
                self._client.subscribe_topic(_TOPIC, self._feel)
                known = await self._client.scheduler.identity(n_workers=-1)
            for address in known["workers"]:
                self._welcome(address)
            self._connected.set_result(None)
            await self._watch()

    async def _started(self, stack: AsyncExitStack) -> Any:
        """A cluster of processes of this machine."""
        folder = str(stack.enter_context(scratch_folder()))
        # Of its own: dask makes a folder in the system's, which would stay.
        stack.enter_context(importlib.import_module("dask").config.set({"temporary-directory": folder}))
        cluster = self._distributed.LocalCluster(
            n_workers=self._jobs,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address=None,
            scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
            memory_limit=0,
            local_directory=folder,
            silence_logs=logging.CRITICAL,
            asynchronous=True,
        )
        stack.push_async_callback(self._ended, cluster)
        return await cluster

    async def _ended(self, cluster: Any) -> None:
        if self._hard:
            for nanny in cluster.workers.values():
                nanny.close_gracefully()  # lets it start no other one
                with suppress(OSError):
                    if nanny.pid:
                        os.kill(nanny.pid, signal.SIGKILL)
        await cluster.close()

    async def _let_go(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _watch(self) -> None:
        loop, told = asyncio.get_running_loop(), False
        since = loop.time()
        while True:
            await asyncio.sleep(_LOOK_S)
            if self._client.status != "running":
                raise self._lose("the scheduler is gone")
            if self._seats:
                since, told = loop.time(), False
            elif not told and loop.time() - since > _ALONE_S:
                self._say(f"scheduler {self._scheduler}: no worker there; waiting for one")
                told = True

    def _hear(self, event: tuple[float, Any]) -> None:
        """Handles an event of the scheduler."""
        match event[1]:
            case {"action": "add-worker", "worker": address}:
                self._welcome(address)
            case {"action": "remove-worker", "worker": address, "expected": expected}:
                seat = self._seats.pop(address, None)
                if seat:
                    seat.gone.set_result(expected)

    def _feel(self, event: tuple[float, Any]) -> None:
        """Winds up the clock of a worker that goes on."""
        for seat in self._seats.values():
            if seat.worker == event[1] and seat.clock and not seat.clock.expired() and self._limit_s is not None:
                seat.clock.reschedule(self._loop.time() + self._limit_s)

    def _welcome(self, address: str) -> None:
        if address not in self._seats:
            seat = self._seats[address] = _Seat(address, self._loop.create_future())
            self._keep(self._greeted(seat))

    def _keep(self, work: Coroutine[Any, Any, None]) -> None:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _greeted(self, seat: _Seat) -> None:
        """Takes a worker on, if it has what it takes."""
        try:
            seat.worker, program = await self._at(seat, greet)
        except _GoneError as gone:
            if not gone.expected:
                self._say(f"scheduler {self._scheduler}: worker {seat.address} died before it had anything to do")
            return
        except Exception as error:
            seat.unfit = one_line(f"{type(error).__name__}: {error}")
        else:
            if program != digest.program():
                seat.unfit = "its oarlock, or what that builds on, is another one than here"
        if not seat.unfit:
            self._free.put_nowait(seat)
        elif all(other.unfit for other in self._seats.values()):
            self._lose(f"no worker there can be used: {seat.unfit}")
        else:
            self._say(f"scheduler {self._scheduler}: worker {seat.address} is left out: {seat.unfit}")

    async def _do(self, call: bytes) -> Any:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        try:
            return await self._done(call)
        except asyncio.CancelledError:
            raise self._lost or LostError("the cluster was closed") from None
        finally:
            self._tasks.discard(task)

    async def _done(self, call: bytes) -> Any:
        if self._lost:
            raise self._lost
        deaths, how = 0, self.renew()
        while deaths < 2:
            seat = await self._free.get()
            if seat.gone.done():
                continue
            late = False
            try:
                async with asyncio.timeout(self._limit_s) as seat.clock:
                    return await self._at(seat, work, seat.worker, call)
            except _GoneError as gone:
                deaths += not gone.expected
            except TimeoutError:
                deaths, how, late = deaths + 1, OVERDUE, True
            finally:
                seat.clock = None
                if late:
                    self._replace(seat)
                else:
                    self._free.put_nowait(seat)
        raise DiedError(f"{how}, twice")

    def _replace(self, seat: _Seat) -> None:
        """Gives up a worker that does not go on; whoever watches over it starts another, if somebody does."""
        self._say(f"scheduler {self._scheduler}: worker {seat.address} does not go on, and is replaced if it can be")
        self._keep(self._restarted(seat))

    async def _restarted(self, seat: _Seat) -> None:
        with suppress(Exception):  # nobody watches over it
            await self._client.restart_workers([seat.address], timeout=_RESTART_S, raise_for_error=False)
        with suppress(Exception):  # it is gone
            if await self._at(seat, rested) == seat.worker:  # it was late, no more, and is as good as any other
                self._free.put_nowait(seat)

    async def _at(self, seat: _Seat, function: Callable[..., Any], *arguments: Any) -> Any:
        """What a function gives at one worker, and nowhere else."""
        source = _THERE.format(function.__name__)
        future = self._client.submit(eval, source, {"arguments": arguments}, workers=[seat.address], pure=False)
        result = asyncio.ensure_future(future.result())
        try:
            await asyncio.wait({result, seat.gone}, return_when=asyncio.FIRST_COMPLETED)
            if not result.done():
                raise _GoneError(seat.gone.result())
            if future.cancelled():
                raise self._lose("the scheduler is gone")
            return result.result()
        finally:
            result.cancel()
            future.release()

    def _lose(self, why: str) -> LostError:
        """Ends everything that is waiting; the first reason counts."""
        self._lost = self._lost or LostError(f"scheduler {self._scheduler}: {why}")
        for task in self._tasks:
            task.cancel()
        return self._lost


def _checked(scheduler: str) -> str:
    if scheduler != LOCAL:
        try:
            parts = urlsplit(scheduler)
            right = parts.scheme in ("tcp", "tls") and parts.hostname and parts.port and not parts.path.strip("/")
        except ValueError:
            right = False
        if not right:
            raise InputError(
                f"scheduler '{scheduler}', expected {LOCAL} or the address of one, tcp://HOST:PORT or tls://HOST:PORT"
            )
    return scheduler


def _distributed() -> Any:
    """Imports the package and silences its loggers: what matters becomes a line of our own."""
    try:
        module = importlib.import_module("distributed")
    except ImportError as error:
        raise InputError("--scheduler needs dask.distributed: pip install 'oarlock[cluster]'") from error
    for name in _LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    return module
