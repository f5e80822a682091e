"""How the cost of a step grows with the number of loops, and where its time goes: four-bars in a chain, N = 1 to 40.

The exact free run is walked without a clock for its cost, and with looks at the clock between the parts of a step for
their shares; beside it bare ``mj_step`` as in the table of steps. A measurement of one machine, as ``stepping_bench``.
"""

import platform
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from oarlock.base import core
from oarlock.bench.steps import BARE, Track

MODEL = "n_four_bar:N={},connects=2"
LOOPS = (1, 2, 5, 10, 20, 40)
SOLVERS = ("auto", "sr1-tracked")
STEPS = 2000
ROUNDS = 9

MANY = 10
"""Loops from which on the exponents of large mechanisms are fitted: below, what every step costs anyway shows."""

STEP = "step"
"""Name of the whole among the parts."""

PARTS = {
    "stages": "MuJoCo's stages",
    "integrator": "MuJoCo's integrator",
    "rows": "J and J̇v",
    "question": "checks, folding and b",
    "whitening": "W = H Jᵀ",
    "matrix": "A = WᵀW",
    "solve": "solver",
    "force": "Jᵀλ and accelerations",
}
"""Parts of a step of the exact free run → what is done there."""


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float | None:
    """The p of cost = c · size^p, by least squares of logarithms; None of fewer than two sizes, or of no cost."""
    if len(sizes) < 2 or min(costs) <= 0:
        return None
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def parts_us(profile: dict[str, Any], steps: int) -> dict[str, float]:
    """What a step spends on each part, µs, with what the looks at the clock cost taken off."""
    spent = {part: profile["parts"][part] for part in PARTS}
    return {part: (ns - looks * profile["look_ns"]) / steps / 1e3 for part, (ns, looks) in spent.items()}


class _Size:
    """A number of loops, who is timed at it, and the times of every round."""

    def __init__(self, loops: int, steps: int):
        self._loops, self._steps, self._name = loops, steps, MODEL.format(loops)
        track = Track(self._name, steps)
        self._model = track.model
        self._walks = {BARE: track.bare(), **{solver: track.free(solver) for solver in SOLVERS}}
        self._profiles = {solver: track.profile(solver) for solver in SOLVERS}
        self._times_s: dict[str, list[float]] = {name: [] for name in self._walks}
        self._profiled: dict[str, list[dict[str, Any]]] = {solver: [] for solver in SOLVERS}

    def round(self) -> None:
        for name, once in self._walks.items():
            self._times_s[name].append(once())
        for solver, once in self._profiles.items():
            self._profiled[solver].append(once())

    def rows(self) -> list[dict[str, Any]]:
        """A row a contender."""
        bare_s = self._times_s[BARE]
        return [
            {
                "model": self._name,
                "loops": self._loops,
                "velocities": self._model.nv,
                "sparse": bool(mujoco.mj_isSparse(self._model)),
                "name": name,
                "step_us": 1e6 * statistics.median(times_s),
                "ratio": statistics.median(own / bare for own, bare in zip(times_s, bare_s, strict=True)),
                **self._of_profiles(self._profiled.get(name, [])),
            }
            for name, times_s in self._times_s.items()
        ]

    def _of_profiles(self, profiles: list[dict[str, Any]]) -> dict[str, Any]:
        counts = ("rows", "folded_rows", "iterations", "products", "refreshes", "unconverged")
        if not profiles:
            return {"parts_us": {}, "profiled_us": None, "looks_us": None, **dict.fromkeys(counts)}
        last = profiles[-1]  # every round counts the same
        shares = [parts_us(profile, self._steps) for profile in profiles]
        looks = [sum(looks for _, looks in profile["parts"].values()) * profile["look_ns"] for profile in profiles]
        return {
            "parts_us": {part: statistics.median(share[part] for share in shares) for part in shares[0]},
            "profiled_us": statistics.median(profile["whole_ns"] for profile in profiles) / self._steps / 1e3,
            "looks_us": statistics.median(looks) / self._steps / 1e3,
            "rows": last["rows"],
            "folded_rows": last["folded_rows"],
            **{name: last[name] / last["solves"] for name in counts[2:]},
        }


def exponents(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row a contender and part, its whole step first: ``name``, ``part``, and the exponents ``all`` and ``many``.

    ``many`` is fitted over the sizes from ``MANY`` loops on; None for what takes no time, or for fewer than two sizes.
    """
    fitted = []
    for name in dict.fromkeys(row["name"] for row in rows):
        own = [row for row in rows if row["name"] == name]
        for part in (STEP, *own[0]["parts_us"]):
            costs = [(row["loops"], row["step_us"] if part == STEP else row["parts_us"][part]) for row in own]
            large = [(loops, cost) for loops, cost in costs if loops >= MANY]
            fits = {
                which: exponent([loops for loops, _ in some], [cost for _, cost in some])
                for which, some in (("all", costs), ("many", large))
            }
            fitted.append({"name": name, "part": part, **fits})
    return fitted


def bench_growth(loops: Sequence[int] | None = None, rounds: int = ROUNDS, steps: int | None = None) -> dict[str, Any]:
    """The measurement: ``rows`` (a size and contender each), ``exponents``, and what it was made with.

    A row has model, loops, velocities, sparse (MuJoCo's own choice of Jacobian), name, step_us (median, without clocks)
    and ratio to bare ``mj_step``. Rows of exact runs also have the rows of J and those that folding leaves, parts_us
    (medians, the looks at the clock taken off), profiled_us (the step with them), looks_us (what they cost), and
    iterations, products, refreshes and unconverged a solve. All sizes take part in every round.

    Raises:
        InputError: the native path cannot be taken.
    """
    steps = steps or STEPS
    sizes = [_Size(count, steps) for count in loops or LOOPS]
    for number in range(rounds):
        # There and back: whom one comes after decides, too.
        for size in sizes if number % 2 == 0 else reversed(sizes):
            size.round()
    rows = [row for size in sizes for row in size.rows()]
    return {
        "inputs": _inputs(),
        "model": MODEL.format("…"),
        "rounds": rounds,
        "steps": steps,
        "rows": rows,
        "exponents": exponents(rows),
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
