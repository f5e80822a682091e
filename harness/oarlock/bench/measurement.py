"""All that the page of a growth is made of: costs, errors, memory, and what they were measured with."""

import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco

from oarlock.base import core
from oarlock.base.progress import Progress
from oarlock.bench.budget import Budget
from oarlock.bench.errors import PARALLEL, WALKED, bench_errors
from oarlock.bench.families import Family
from oarlock.bench.growth import ROUNDS, bench_growth
from oarlock.bench.memory import bench_memory


def measure(
    chosen: Sequence[Family] | None = None,
    rounds: int = ROUNDS,
    budget: Budget | None = None,
    progress: Progress | None = None,
    judged: tuple[tuple[str, ...], tuple[str, ...]] = (WALKED, PARALLEL),
) -> dict[str, Any]:
    """What ``bench_growth`` gives, with ``errors``, ``memory`` and ``inputs``.

    Args:
        chosen: families; all if left out.
        rounds: interleaved rounds, of which the median counts.
        budget: what a walk may cost.
        progress: listens.
        judged: models whose answers are held against exact ones, on a walk and near a singular pose.

    Raises:
        InputError: the native path cannot be taken.
    """
    growth = bench_growth(chosen, rounds, budget, progress)
    return {
        **growth,
        "errors": bench_errors(*judged, progress),
        "memory": bench_memory(growth, progress),
        "inputs": _inputs(),
    }


def _inputs() -> dict[str, Any]:
    """Versions and kind of machine."""
    return {
        "oarlock": core.VERSION,
        "core_profile": core.BUILD_PROFILE,
        "python": platform.python_version(),
        "mujoco": mujoco.__version__,
        "platform": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
    }


def _processor() -> str:
    """Its name, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or "unknown")
