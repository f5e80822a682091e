"""The processor cores that this process may use, and that it should."""

import os
from contextlib import AbstractContextManager


def cores() -> int:
    """Returns the number of cores that this process may use, at least 1."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def one_thread() -> AbstractContextManager[object]:
    """Keeps BLAS from using threads of its own in the block.

    Matrices are small: its threads wait for one another longer than they work, and for whatever else runs.
    """
    from threadpoolctl import threadpool_limits  # it looks at every library that is loaded

    return threadpool_limits(1, user_api="blas")
