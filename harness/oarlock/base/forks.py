"""Processes that were forked: threads do not come along, and polars would wait for its own for ever."""

import os
import re
import sys
from pathlib import Path

from oarlock.base.errors import InputError

_THREADS = re.compile(r"polars-\d")
"""Begins the names of the threads of polars that compute. They are started when it computes for the first time; others,
such as ``polars-ooc-cleaner``, as soon as it is imported."""


class _Forks:
    """Looks at this process whenever it is forked."""

    def __init__(self):
        self.computing = False
        """Whether polars had its threads when this process was forked from another one."""
        self._seen = False
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(before=self._look, after_in_child=self._note)

    def _look(self) -> None:
        self._seen = _computing()

    def _note(self) -> None:
        self.computing |= self._seen


def _computing() -> bool:
    """Whether polars has its threads; where the system does not tell, whether it may."""
    if "polars" not in sys.modules:
        return False
    try:
        tasks = list(Path("/proc/self/task").iterdir())
    except OSError:
        return True
    return any(_THREADS.match(_name(task)) for task in tasks)


def _name(task: Path) -> str:
    try:
        return (task / "comm").read_text()
    except OSError:  # it has ended
        return ""


_FORKS = _Forks()


def require_threads() -> None:
    """Refuses to begin what would never end.

    Raises:
        InputError: this process was forked from one in which polars had computed.
    """
    if _FORKS.computing:
        raise InputError(
            "this process was forked from one in which polars had computed, and would wait for threads that did not "
            "come along; expected one started with multiprocessing's 'spawn' or 'forkserver', or forked before"
        )
