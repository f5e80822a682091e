"""Processes: which one something belongs to, whether it still lives, and workers that end with the one that asked."""

import ctypes
import hashlib
import multiprocessing
import os
import re
import signal
import sys
import threading
import time
from dataclasses import dataclass
from functools import cache
from multiprocessing.connection import wait
from pathlib import Path

_LOOK_S = 0.5
"""Time between two looks of a worker at its parent, s."""

_PR_SET_PDEATHSIG = 1
_STATE, _STARTED = 0, 19
"""Fields of ``/proc/PID/stat``, counted from behind the name of the program."""


@dataclass(frozen=True)
class Owner:
    """A process, so that it is not taken for a later one of the same number.

    Attributes:
        pid: its number.
        started: when it was started, in ticks since the system was; 0 where the system does not tell.
        host: identifies what numbers it, a machine or a container.
    """

    pid: int
    started: int
    host: str

    PATTERN = r"\d+-\d+-[0-9a-f]{8}"
    """What ``str`` of an owner looks like."""

    def __str__(self) -> str:
        return f"{self.pid}-{self.started}-{self.host}"

    @classmethod
    def parse(cls, text: str) -> "Owner | None":
        """Reads what ``str`` of an owner gave; None if it is something else."""
        if not re.fullmatch(cls.PATTERN, text, re.ASCII):
            return None
        pid, started, host = text.split("-")
        return cls(int(pid), int(started), host)

    @property
    def here(self) -> bool:
        """Whether it is a process of this machine, of which can be said whether it lives."""
        return self.host == _host()

    @property
    def dead(self) -> bool:
        """Whether it is certain that it has ended; never of a process of another machine."""
        if not self.here or self.pid <= 0:
            return False
        try:
            os.kill(self.pid, 0) if os.name == "posix" else None
        except (ProcessLookupError, OverflowError):
            return True
        except OSError:
            pass  # somebody else's
        state, started = _stat(self.pid)
        return state in ("Z", "X") or (started != self.started and 0 not in (started, self.started))


def myself() -> Owner:
    """Returns this process."""
    return Owner(os.getpid(), _stat(os.getpid())[1], _host())


@cache
def _host() -> str:
    """Identifies what numbers the processes: the machine and, of a container, its numbering."""
    try:
        numbering = os.readlink("/proc/self/ns/pid")
    except OSError:
        numbering = ""
    return hashlib.sha256(f"{host_name()} {numbering}".encode()).hexdigest()[:8]


def host_name() -> str:
    """Returns the name of this machine."""
    import socket  # whoever has no folder to own needs none

    return socket.gethostname()


def _stat(pid: int) -> tuple[str, int]:
    """Returns state and start of a process; ``("", 0)`` where the system does not tell."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()
        return fields[_STATE], int(fields[_STARTED])
    except (OSError, ValueError, IndexError):
        return "", 0


def end_with_parent(parent: int, *, from_main_thread: bool) -> None:
    """Sees to it that this process ends when the one that started it does, whatever ended that.

    A thread watches, and on Linux the kernel does as well: it also ends a process that is stopped or held up.

    Args:
        parent: number of the process that started this one.
        from_main_thread: whether its main thread did. The kernel counts the end of any other thread as the parent's.
    """
    if sys.platform == "linux" and from_main_thread:
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    threading.Thread(target=_watch, args=(parent,), name="oarlock-parent", daemon=True).start()


def _watch(parent: int) -> None:
    started_by = multiprocessing.parent_process()
    while os.getppid() == parent:
        if started_by is None:
            time.sleep(_LOOK_S)
        elif wait([started_by.sentinel], _LOOK_S):
            break
    os._exit(1)  # nobody is left to hear of it


def how_ended(code: int) -> str:
    """How a process ended, by its return code: its status, or the signal that ended it."""
    if code >= 0:
        return f"status {code}"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
