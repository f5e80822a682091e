"""The pulse of a process at work: whoever waits for it sees that it goes on, however long it takes."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

EVERY_S = 1.0
"""Time between two beats, s: a step takes microseconds, to tell of it more."""


class _Pulse:
    """Whom this process tells that it goes on."""

    def __init__(self):
        self.tell: Callable[[], None] | None = None
        self.due = 0.0


_PULSE = _Pulse()


@contextmanager
def felt_by(tell: Callable[[], None]) -> Iterator[None]:
    """In the block, every ``beat`` of this process is told, one a second at most."""
    before = _PULSE.tell
    _PULSE.tell, _PULSE.due = tell, 0.0
    try:
        yield
    finally:
        _PULSE.tell = before


def beat(_steps: int = 0) -> None:
    """Something of the work was done."""
    if _PULSE.tell is not None and time.monotonic() >= _PULSE.due:
        _PULSE.due = time.monotonic() + EVERY_S
        _PULSE.tell()
