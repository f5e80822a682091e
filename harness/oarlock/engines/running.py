"""Runs a program in a process of its own, which is ended with its children when it is silent for too long."""

import contextlib
import json
import os
import queue
import re
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from oarlock.base.errors import InputError, one_line
from oarlock.base.processes import how_ended
from oarlock.base.pulse import beat
from oarlock.base.scratch import scratch_folder
from oarlock.engines.environments import Environment
from oarlock.engines.registry import LAUNCH, Program

NOT_EXPRESSIBLE = 3
"""Exit status of a program whose engine cannot express the question."""

SILENCE_S = 900.0
"""Time that a program may be silent, s, unless something else is asked for: engines compile for minutes."""

_KEPT = 40
"""Lines of a program's standard error that are kept."""

_RAISED = re.compile(r"[\w.]*(Error|Exception|Interrupt|Exit)\b")
"""Begins the line of a traceback that says what was raised."""

_LOOK_S = 0.5

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class EngineError(InputError):
    """A program failed: it crashed, was silent for too long, or answered what is no answer.

    Attributes:
        tail: the last lines of its standard error.
    """

    def __init__(self, message: str, tail: bytes = b""):
        super().__init__(message)
        self.tail = tail


@dataclass(frozen=True)
class Written:
    """What a program left.

    Attributes:
        files: name → contents, of each question in their order; empty where nothing was written.
        status: its exit status: 0 or ``NOT_EXPRESSIBLE``.
    """

    files: tuple[dict[str, bytes], ...]
    status: int


def run(
    program: Program,
    environment: Environment,
    asks: Sequence[Path],
    silence_s: float = SILENCE_S,
    hear: Callable[[int, int], None] = lambda done, of: None,
) -> Written:
    """Has a program answer some questions, all in one process.

    Args:
        program: the program.
        environment: what runs it.
        asks: folders of the questions; several only of a program that takes several.
        silence_s: time that it may be silent, s; 0 for ever.
        hear: is told how far it says that it is.

    Raises:
        EngineError: it failed; the message has the last line of its standard error.
    """
    with scratch_folder() as folder:
        answers = [folder / f"answer-{number}" for number in range(len(asks))]
        pairs = [str(path) for pair in zip(asks, answers, strict=True) for path in pair]
        for answer in answers:
            answer.mkdir()
        status = _run(program, environment, pairs, folder, silence_s, hear)
        return Written(tuple(map(_read, answers)), status)


def _read(folder: Path) -> dict[str, bytes]:
    names = ("answer.json", "answer.parquet")
    return {name: (folder / name).read_bytes() for name in names if (folder / name).is_file()}


def _run(
    program: Program,
    environment: Environment,
    pairs: list[str],
    folder: Path,
    silence_s: float,
    hear: Callable[[int, int], None],
) -> int:
    own = {"OARLOCK_ENGINE_PATH": os.pathsep.join(environment.first), "OARLOCK_ENGINE_WATCH": "1"}
    # Where packages of this interpreter lie says nothing to another one.
    foreign = () if environment.python == sys.executable else ("PYTHONPATH", "PYTHONHOME")
    inherited = {name: value for name, value in os.environ.items() if name not in foreign}
    # Programs share the cores, as workers do.
    variables = {**dict.fromkeys(_THREADS, "1"), **inherited, **own, "PYTHONUNBUFFERED": "1"}
    command = [environment.python, str(LAUNCH), str(program.path), *pairs]
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=folder,
            env=variables,
            start_new_session=True,
        )
    except OSError as error:
        raise EngineError(f"'{environment.python}' cannot be started: {error.strerror or error}") from None
    try:
        return _attend(process, program.name, silence_s, hear)
    finally:
        end(process)


def _attend(process: "subprocess.Popen[bytes]", name: str, silence_s: float, hear: Callable[[int, int], None]) -> int:
    said: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    complaints: deque[bytes] = deque(maxlen=_KEPT)
    assert process.stdout is not None
    assert process.stderr is not None
    readers = [
        threading.Thread(target=_each_line, args=(process.stdout, said.put), daemon=True),
        threading.Thread(target=_each_line, args=(process.stderr, complaints.append), daemon=True),
    ]
    for reader in readers:
        reader.start()
    due = time.monotonic() + silence_s
    while True:
        try:
            line = said.get(timeout=_LOOK_S)
        except queue.Empty:
            line = b""
        beat()
        if line:
            due = time.monotonic() + silence_s
            _tell(line, hear)
        elif process.poll() is not None:
            break
        elif silence_s and time.monotonic() > due:
            end(process)
            raise EngineError(
                f"{name} was silent for {silence_s:g} s and was ended{_last(complaints)}", b"".join(complaints)
            )
    for reader in readers:
        reader.join(_LOOK_S)
    if process.returncode not in (0, NOT_EXPRESSIBLE):
        raise EngineError(f"{name} ended with {how_ended(process.returncode)}{_last(complaints)}", b"".join(complaints))
    return process.returncode


def _each_line(stream: IO[bytes], take: Callable[[bytes], None]) -> None:
    with contextlib.suppress(OSError, ValueError):  # closed under it
        for line in stream:
            take(line)


def _tell(line: bytes, hear: Callable[[int, int], None]) -> None:
    try:
        told = json.loads(line)
        hear(int(told["done"]), int(told["of"]))
    except (ValueError, KeyError, TypeError):
        pass  # an engine's own words


def _last(complaints: "deque[bytes]") -> str:
    lines = [one_line(line.decode(errors="replace").strip()) for line in list(complaints)]
    lines = [line for line in lines if line]
    # What comes after an exception explains it, or says how to see more.
    raised = [line for line in lines if _RAISED.match(line)]
    return f": {(raised or lines)[-1][:300]}" if lines else ""


def end(process: "subprocess.Popen[bytes]") -> None:
    """Ends a process that leads a session, and all that belong to it."""
    if hasattr(os, "killpg"):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    elif process.poll() is None:
        process.kill()
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(10.0)
    for stream in (process.stdin, process.stdout, process.stderr):
        if stream is not None:
            with contextlib.suppress(OSError):
                stream.close()
