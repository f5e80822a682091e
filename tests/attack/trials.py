"""Commands in forked processes, many a second, and what counts as right of each.

The parent has loaded the package and computes nothing, so that a child begins where it is: without the second that a
new interpreter takes. A child is the command itself, with arguments, streams, a folder and a temporary folder of its
own; workers of a suite are functions in it.
"""

import ctypes
import importlib
import os
import pickle
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
import types
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from oarlock.batch import session, suite
from oarlock.cli import app
from places import REPOSITORY

from attack.fence import fence

LIMIT_S = 60.0
"""Time that a command may take, s."""
LIMIT_MB = 4096
"""Memory that it may take."""
AT_ONCE = 2
LONGEST_LINE = 2600
"""Characters of a line: a text is cut at 2000 (``base.text``), and named in a sentence."""

MARKS = (
    "Traceback (most recent call",
    "panicked at",
    "Fatal Python error",
    "RuntimeWarning",
    "Segmentation",
    "Aborted",
)
"""Of an error that nobody turned into a line."""
LOADED = ("compare.compare", "compare.junit", "report.case_report", "report.summary", "scaffold.scaffold")
"""Loaded at first by the commands that need them."""


@dataclass(frozen=True)
class Attempt:
    """A command and what it is given.

    Attributes:
        name: how it was made, so that it can be made again.
        arguments: of the command.
        prepare: writes its files into a folder that is empty and will be the working folder.
        given: names in this folder that the command may change.
        after: called in the process of the command when that has ended, with the status; gives a complaint.
    """

    name: str
    arguments: tuple[str, ...]
    prepare: Callable[[Path], None] = lambda _: None
    given: tuple[str, ...] = ("out",)
    after: Callable[[int], str] | None = None


@dataclass
class _Flight:
    """An attempt in the air."""

    attempt: Attempt
    folder: Path
    before: dict[str, Any]
    pid: int
    began: float = field(default_factory=time.monotonic)
    ended: str = ""


@dataclass(frozen=True)
class Ending:
    """How a command ended.

    Attributes:
        status: exit status; negative: the number of a signal.
        out: standard output.
        err: standard error.
        seconds: time that it took.
        megabytes: memory at its peak.
    """

    status: int
    out: str
    err: str
    seconds: float
    megabytes: float


class InProcess:
    """Workers of a suite that are this process."""

    slots = 1

    def __init__(self, *_: Any): ...

    def submit(self, function: Callable[[Any], Any], item: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        future.set_result(function(item))
        return future

    def renew(self) -> str:
        return "nobody died"

    def expire(self) -> set[Any]:
        return set()

    def close(self) -> None: ...

    def kill(self) -> None: ...


def load() -> None:
    """Loads what commands need, once."""
    for command in app.COMMANDS.values():
        importlib.import_module(f"oarlock.cli.{command.partition('.')[0]}")
    for module in LOADED:
        importlib.import_module(f"oarlock.{module}")
    for module in (session, suite):
        setattr(module, "LocalWorkers", InProcess)  # noqa: B010


def tried(attempts: Iterable[Attempt], root: Path, until: float) -> Iterator[str]:
    """Tries, two at once; a complaint each, empty if it was right. Begins nothing new once ``until`` has passed."""
    load()
    around, statuses = surroundings(), Counter[int]()
    (root / "in" / "side").mkdir(parents=True)  # what goes up a folder or two is still in the root
    waiting, flying = iter(attempts), dict[int, _Flight]()
    poll = select.poll()
    number = 0
    while True:
        while len(flying) < AT_ONCE and time.monotonic() < until:
            attempt = next(waiting, None)
            if attempt is None:
                until = 0.0
                break
            number += 1
            flight = _begun(attempt, root / "in" / "side" / str(number), root)
            descriptor = os.pidfd_open(flight.pid)
            flying[descriptor] = flight
            poll.register(descriptor, select.POLLIN)
        if not flying:
            break
        done = {descriptor for descriptor, _ in poll.poll(50)}
        for descriptor, flight in list(flying.items()):
            _watch(flight)
            if descriptor in done:
                poll.unregister(descriptor)
                os.close(descriptor)
                del flying[descriptor]
                ending = _landed(flight)
                statuses[ending.status] += 1
                complaint = _complaint(flight, ending)
                shutil.rmtree(flight.folder)
                for path in flight.folder.parent.glob(f"{flight.folder.name}.*"):
                    shutil.rmtree(path) if path.is_dir() else path.unlink()
                yield f"{attempt_line(flight.attempt)}: {complaint}" if complaint else ""
    print("  status", ", ".join(f"{status}: {count}" for status, count in sorted(statuses.items())), flush=True)
    changed = {name for name, what in surroundings().items() if around.get(name) != what}
    if changed:
        yield f"changed outside of the folders that were given: {sorted(changed)[:5]}"


def attempt_line(attempt: Attempt) -> str:
    """An attempt for a message."""
    return f"{attempt.name} | {' '.join(repr(one) if len(one) < 80 else repr(one[:80]) for one in attempt.arguments)}"


def forked(call: Callable[[], Any], folder: Path) -> Any:
    """What a function gives in a process of its own, which may compute."""
    load()
    pid = os.fork()
    if not pid:
        try:
            fence(folder)
            (folder / "answer").write_bytes(pickle.dumps(call()))
            os._exit(0)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
    if os.waitpid(pid, 0)[1]:
        raise RuntimeError("what was to be attacked could not be made")
    answer = pickle.loads((folder / "answer").read_bytes())
    (folder / "answer").unlink()
    return answer


def command(arguments: Iterable[str], folder: Path) -> int:
    """Runs a command in this process, in a folder; returns its status. What it says goes to files beside the folder."""
    for number, name in ((0, os.devnull), (1, f"{folder}.out"), (2, f"{folder}.err")):
        file = os.open(name, os.O_RDONLY if number == 0 else os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        os.dup2(file, number)
    sys.stdout, sys.stderr = (os.fdopen(number, "w", encoding="utf-8", closefd=False) for number in (1, 2))
    os.environ["TMPDIR"] = f"{folder}.tmp"
    tempfile.tempdir = None
    os.chdir(folder)
    sys.argv = ["oarlock", *arguments]
    sys.modules["__main__"] = types.ModuleType("__main__")  # processes that are spawned load none of this
    status = 1
    try:
        app.main()
        status = 0
    except SystemExit as error:
        status = error.code if isinstance(error.code, int) else 1
    except BaseException:
        traceback.print_exc()
    return status


def _begun(attempt: Attempt, folder: Path, root: Path) -> _Flight:
    folder.mkdir()
    Path(f"{folder}.tmp").mkdir()
    attempt.prepare(folder)
    before = contents(folder, attempt.given)
    parent = os.getpid()
    pid = os.fork()
    if pid:
        return _Flight(attempt, folder, before, pid)
    status = 1
    try:
        os.setsid()
        ctypes.CDLL(None).prctl(1, signal.SIGKILL, 0, 0, 0)  # PR_SET_PDEATHSIG
        if os.getppid() == parent:
            fence(root)
            status = command(attempt.arguments, folder)
            complaint = attempt.after(status) if attempt.after else ""
            Path(f"{folder}.said").write_text(complaint)
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        traceback.print_exc()
        status = 99
    finally:
        os._exit(status)


def _watch(flight: _Flight) -> None:
    """Ends a command that takes too long or too much."""
    try:
        megabytes = int(Path(f"/proc/{flight.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE") / 2**20
    except (OSError, IndexError):
        return
    if time.monotonic() - flight.began > LIMIT_S:
        flight.ended = f"no end within {LIMIT_S:g} s"
    elif megabytes > LIMIT_MB:
        flight.ended = f"more than {LIMIT_MB} MB"
    if flight.ended:
        os.killpg(flight.pid, signal.SIGKILL)


def _landed(flight: _Flight) -> Ending:
    _, code, usage = os.wait4(flight.pid, 0)
    seconds = time.monotonic() - flight.began
    out, err = (_text(Path(f"{flight.folder}.{name}")) for name in ("out", "err"))
    return Ending(os.waitstatus_to_exitcode(code), out, err, seconds, usage.ru_maxrss / 1024)


def _complaint(flight: _Flight, ending: Ending) -> str:
    if flight.ended:
        return flight.ended
    if complaint := wrong(flight.attempt.arguments[0], ending):
        return complaint
    after = contents(flight.folder, flight.attempt.given)
    if changed := {name for name in flight.before.keys() | after.keys() if flight.before.get(name) != after.get(name)}:
        return f"changed outside of what was given: {sorted(changed)[:5]}"
    if left := [path.name for path in Path(f"{flight.folder}.tmp").iterdir()]:
        return f"left in the temporary folder: {left[:5]}"
    return _text(Path(f"{flight.folder}.said"))


def _text(path: Path) -> str:
    try:
        return path.read_text(errors="replace")
    except OSError:
        return ""


def wrong(name: str, ending: Ending) -> str:
    """What is wrong with the end of a command; empty if nothing is."""
    lines = ending.err.removesuffix("\n").split("\n") if ending.err else []
    found = next((mark for mark in MARKS if mark in ending.err or mark in ending.out), "")
    if found:
        last = lines[-1] if lines else ""
        return f"status {ending.status}, it says '{found} …': {last[:300]}"
    if ending.status not in (0, 1, 2, 130):
        return f"status {ending.status}: {ending.err[-300:]!r}"
    if "Permission denied" in ending.err:
        return f"it wanted to write outside: {ending.err[-300:]!r}"
    if ending.megabytes > LIMIT_MB:
        return f"{ending.megabytes:.0f} MB"
    if any(not line.isprintable() for line in (*lines, *ending.out.split("\n"))):
        return "control characters in what it prints"
    if any(len(line) > LONGEST_LINE for line in lines):
        return f"a line of {max(map(len, lines))} characters"
    ours = [line for line in lines if line.startswith("oarlock: ")]
    progress = ("  ", "running: ", "reporting: ") if name == "suite" else ()
    if strange := [line for line in lines if line not in ours and not line.startswith(progress or "\0")]:
        return f"status {ending.status}, a line that is none of ours: {strange[0][:300]!r}"
    if ending.status in (1, 2) and not ours:
        return f"status {ending.status} without a word"
    ours = [line for line in ours if "MuJoCo warns: " not in line]
    if ending.status == 2 and len(ours) > 1 and name not in ("suite", "check"):
        return f"{len(ours)} lines in place of one: {ours[:3]}"
    return ""


def contents(folder: Path, but: Iterable[str] = ()) -> dict[str, Any]:
    """Name of what is in a folder → what would change if somebody wrote to it; without what may change."""
    found: dict[str, Any] = {}
    for place, folders, files in os.walk(folder):
        here = Path(place)
        if here == folder:
            folders[:] = [name for name in folders if name not in but]
        for name in (*folders, *files):
            path = here / name
            if here == folder and name in but:
                continue
            status = path.lstat()
            kept = (status.st_size, status.st_mtime_ns) if name in files else ()
            found[str(path.relative_to(folder))] = (status.st_mode, *kept)
    return found


def surroundings() -> dict[str, Any]:
    """What lies around and belongs to nobody's results: the repository, the home, devices."""
    found: dict[str, Any] = {}
    for name in ("mjcf", "reports", "tests"):
        found |= {f"{name}/{k}": v for k, v in contents(REPOSITORY / name).items() if "__pycache__" not in k}
    found |= {name: Path(name).stat().st_rdev for name in ("/dev/null", "/dev/zero", "/dev/full")}
    found |= {str(path): True for path in Path.home().iterdir()}
    return found
