"""How the cost of a step grows with the size of a mechanism, and where its time goes, for every method and MuJoCo.

Exact free runs are walked without a clock for their cost, and with looks at the clock between the parts of a step for
their shares; beside them bare ``mj_step`` as in the table of steps. A measurement of one machine.
"""

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import mujoco
import numpy as np

from oarlock.base.errors import InputError, one_line
from oarlock.base.progress import Progress
from oarlock.bench.budget import LEAST, MOST, Budget, steps_for
from oarlock.bench.families import Family, families
from oarlock.bench.steps import BARE, SETTINGS, Runs, Track
from oarlock.mechanics.load import quiet_engine

SOLVERS = ("auto", "dual", "primal", "cholesky", "sr1-tracked", "sr1", "pinv", "cg")
PROFILED = ("auto", "sr1-tracked")
"""Solvers whose steps are taken apart."""

ROUNDS = 5

FASTEST = f"{BARE} at its fastest"

HOPEFUL = 1.5
"""A setting of MuJoCo walks on if its first walk took at most so many times as long as that of the fastest."""

PROBE, TRIES = 3, 3
"""Steps after the first in a walk that tells what another would cost, and such walks at most: one may be disturbed."""

MANY = 10
"""Loops, cells or bodies from which on the exponents of large mechanisms are fitted: below, what every step costs
anyway shows in them."""

STEP = "step"
"""Name of the whole among the parts."""

PARTS = {
    "stages": "MuJoCo's stages",
    "integrator": "MuJoCo's integrator",
    "rows": "J and J̇v",
    "question": "checks, folding and b",
    "matrix": "W = H Jᵀ and A = WᵀW",
    "solve": "solver",
    "force": "Jᵀλ and accelerations",
}
"""Parts of a step of the exact free run → what is done there."""

OWN_PARTS = {
    "constraint": "its solver",
    "rows": "making and projecting rows",
    "position": "other stages of position",
    "rest": "velocity, forces, integrator",
}
"""Parts of ``mj_step`` by MuJoCo's own timers → what is done there."""

COUNTS = ("iterations", "products", "refreshes", "unconverged")
FIGURES = (
    "step_us",
    "first_us",
    "ratio",
    "ratio_to_fastest",
    "profiled_us",
    "looks_us",
    "rows",
    "folded_rows",
    *COUNTS,
)
"""What a row has of one that walks; None of one that is left out."""


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float | None:
    """The p of cost = c · size^p, by least squares of logarithms; None of fewer than two sizes, or of no cost."""
    if len(sizes) < 2 or min(costs) <= 0:
        return None
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def parts_us(profile: dict[str, Any], steps: int) -> dict[str, float]:
    """What a step spends on each part, µs, with what the looks at the clock cost taken off."""
    spent = {part: profile["parts"][part] for part in PARTS}
    return {part: (ns - looks * profile["look_ns"]) / steps / 1e3 for part, (ns, looks) in spent.items()}


def later_step_s(whole_s: float, first_s: float, steps: int) -> float:
    """What each of so many steps after the first took; a first one that took longer than all was disturbed."""
    return (whole_s - first_s) / steps if first_s < whole_s else whole_s / (1 + steps)


@dataclass
class _Walker:
    """One who walks at a size, and the times of every round."""

    runs: Runs
    timers: bool = False
    first_s: float = 0.0
    steps: int = 0
    wholes_s: list[float] = field(default_factory=list)
    profiles: list[dict[str, Any]] = field(default_factory=list)

    def walk_s(self, steps: int) -> float:
        """The time of so many steps from the start, s."""
        run = self.runs(steps)
        began = time.perf_counter()
        run.walk(self.timers)
        return time.perf_counter() - began

    def probe(self, budget: Budget, steps: int) -> str:
        """Measures its first step; gives why it is left out, empty if it walks."""
        try:
            self.first_s = self.walk_s(1)
            if refused := budget.refusal(self.first_s, 0.0, steps):
                return refused
            self.first_s, step_s = min(self.first_s, self.walk_s(1)), np.inf
            for _ in range(TRIES):
                step_s = min(step_s, max(self.walk_s(1 + PROBE) - self.first_s, 0.0) / PROBE)
                if not (refused := budget.refusal(self.first_s, step_s, steps)):
                    break
            else:
                return refused
            self.walk_s(1 + steps)  # whether it arrives
        except InputError as error:
            return f"it ended: {one_line(error)}"
        return ""

    def go(self, steps: int) -> None:
        """Walks, and notes how long; the first step is always the same, so that the least disturbed one counts."""
        self.steps, self.first_s = steps, min(self.first_s, self.walk_s(1))
        self.wholes_s.append(self.walk_s(1 + steps))

    @property
    def step_s(self) -> list[float]:
        """The time of a step after the first in every round, s."""
        return [later_step_s(whole_s, self.first_s, self.steps) for whole_s in self.wholes_s]


class _Size:
    """A mechanism of one size: who walks at it, who is left out and why."""

    def __init__(self, family: Family, size: int, budget: Budget, left_out: dict[str, str]):
        self._family, self._size, self.name = family, size, family.model_at(size)
        track = Track(self.name, MOST, family.start)
        self._track, self._model = track, track.model
        bare = _Walker(track.bare_runs(), True)
        bare.walk_s(1 + LEAST)
        self.steps = track.steps = steps_for(bare.walk_s(1 + LEAST) / (1 + LEAST))
        bare.first_s = bare.walk_s(1)
        self._walkers = {BARE: bare, **self._settings(budget)}
        self.left_out: dict[str, str] = {}
        for solver in SOLVERS:
            walker = _Walker(track.free_runs(solver))
            refused = left_out.get(solver) or walker.probe(budget, self.steps)
            if refused:
                self.left_out[solver] = refused
            else:
                self._walkers[solver] = walker
        self._profiles = {solver: track.profile(solver) for solver in SOLVERS if solver in self._walkers}

    def _settings(self, budget: Budget) -> dict[str, _Walker]:
        """The settings of MuJoCo that may be its fastest."""
        walkers = {
            name: _Walker(self._track.bare_runs(jacobian, switches.get("islands", True)), switches.get("timers", True))
            for name, (jacobian, switches) in SETTINGS.items()
        }
        took_s = {}
        for name, walker in walkers.items():
            if not walker.probe(budget, self.steps):
                took_s[name] = walker.walk_s(1 + self.steps)
        return {name: walkers[name] for name in took_s if took_s[name] <= HOPEFUL * min(took_s.values())}

    def round(self, number: int) -> None:
        """Everyone walks once, in every other round in reverse: whom one comes after decides, too."""
        walkers = list(self._walkers.values())
        for walker in walkers if number % 2 == 0 else reversed(walkers):
            walker.go(self.steps)
        for solver, once in self._profiles.items():
            if number == 0 or solver in PROFILED:
                self._walkers[solver].profiles.append(once())

    def rows(self) -> list[dict[str, Any]]:
        """A row a contender, those that are left out among them, without figures."""
        settings = [name for name in self._walkers if name in SETTINGS] or [BARE]
        fastest = min((*settings, BARE), key=lambda name: statistics.median(self._walkers[name].step_s))
        rows = [self._row(BARE, BARE, fastest), {**self._row(FASTEST, fastest, fastest), "setting": fastest}]
        rows[0]["parts_us"] = own_parts_us(self._track, self.steps, rows[0]["step_us"])
        for solver in SOLVERS:
            if solver in self._walkers:
                rows.append(self._row(solver, solver, fastest))
            else:
                rows.append(self._nothing(solver) | {"left_out": self.left_out[solver]})
        return rows

    def _nothing(self, name: str) -> dict[str, Any]:
        return {
            "family": self._family.name,
            "model": self.name,
            "size": self._size,
            "count": self._family.count(self._size),
            "velocities": self._model.nv,
            "sparse": bool(mujoco.mj_isSparse(self._model)),
            "steps": self.steps,
            "name": name,
            "left_out": "",
            "setting": "",
            "parts_us": {},
            **dict.fromkeys(FIGURES),
        }

    def _row(self, name: str, whose: str, fastest: str) -> dict[str, Any]:
        walker = self._walkers[whose]

        def ratio(over: str) -> float:
            pairs = zip(walker.step_s, self._walkers[over].step_s, strict=True)
            return statistics.median(own / other for own, other in pairs)

        times = {
            "step_us": 1e6 * statistics.median(walker.step_s),
            "first_us": 1e6 * walker.first_s,
            "ratio": ratio(BARE),
            "ratio_to_fastest": ratio(fastest),
        }
        return self._nothing(name) | times | self._of_profiles(walker.profiles)

    def _of_profiles(self, profiles: list[dict[str, Any]]) -> dict[str, Any]:
        if not profiles:
            return {}
        last = profiles[-1]  # every round counts the same
        shares = [parts_us(profile, self.steps) for profile in profiles]
        looks = [sum(looks for _, looks in profile["parts"].values()) * profile["look_ns"] for profile in profiles]
        return {
            "parts_us": {part: statistics.median(share[part] for share in shares) for part in shares[0]},
            "profiled_us": statistics.median(profile["whole_ns"] for profile in profiles) / self.steps / 1e3,
            "looks_us": statistics.median(looks) / self.steps / 1e3,
            "rows": last["rows"],
            "folded_rows": last["folded_rows"],
            **{name: last[name] / last["solves"] for name in COUNTS},
        }


def own_parts_us(track: Track, steps: int, step_us: float) -> dict[str, float]:
    """What ``mj_step`` spends on each of its own parts, µs: shares by its own timers, of a step of ``step_us``."""
    prepared = track.prepared()
    data = prepared.data()
    mujoco.mj_step(prepared.model, data, steps)
    timer = mujoco.mjtTimer
    whole, position, constraint, make, project = (
        data.timer[one].duration
        for one in (
            timer.mjTIMER_STEP,
            timer.mjTIMER_POSITION,
            timer.mjTIMER_CONSTRAINT,
            timer.mjTIMER_POS_MAKE,
            timer.mjTIMER_POS_PROJECT,
        )
    )
    rows = make + project
    spent = {
        "constraint": constraint,
        "rows": rows,
        "position": position - rows,
        "rest": whole - position - constraint,
    }
    return {part: step_us * time / whole for part, time in spent.items()}


def exponents(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row a family, contender and part, its whole step first: ``family``, ``name``, ``part``, ``all`` and ``many``.

    The exponents are fitted over the sizes that were walked; ``many`` over those from ``MANY`` on. None for what takes
    no time, or for fewer than two sizes.
    """
    fitted = []
    for family, name in dict.fromkeys((row["family"], row["name"]) for row in rows):
        own = [row for row in rows if (row["family"], row["name"]) == (family, name) and row["step_us"] is not None]
        for part in (STEP, *(own[0]["parts_us"] if own else ())):
            costs = [(row["count"], row["step_us"] if part == STEP else row["parts_us"][part]) for row in own]
            large = [(count, cost) for count, cost in costs if count >= MANY]
            fits = {
                which: exponent([count for count, _ in some], [cost for _, cost in some])
                for which, some in (("all", costs), ("many", large))
            }
            fitted.append({"family": family, "name": name, "part": part, **fits})
    return fitted


def grow(
    family: Family,
    rounds: int,
    budget: Budget,
    sizes: Sequence[int] | None = None,
    tick: Callable[[], None] | None = None,
) -> list[dict[str, Any]]:
    """The rows of a family: a size and contender each. All sizes take part in every round.

    A method that is left out at a size is not tried at a larger one.
    """
    made: list[_Size] = []
    left_out: dict[str, str] = {}
    with quiet_engine():
        for size in sizes or family.sizes:
            made.append(_Size(family, size, budget, left_out))
            for solver, _ in made[-1].left_out.items():
                left_out.setdefault(solver, f"left out at {made[-1].name} already")
        for number in range(rounds):
            for one in made if number % 2 == 0 else reversed(made):
                one.round(number)
                if tick:
                    tick()
        return [row for one in made for row in one.rows()]


def bench_growth(
    chosen: Sequence[Family] | None = None,
    rounds: int = ROUNDS,
    budget: Budget | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """The measurement: ``families``, ``rows`` (a size and contender each), ``exponents``, and what it was made with.

    A row has family, model, size, count (of loops, cells or bodies), velocities, sparse (MuJoCo's own choice of
    Jacobian), steps, name, step_us (median, without clocks), first_us (of its first step, in which what holds for all
    steps is found), ratio to bare ``mj_step``, ratio_to_fastest, to its fastest setting, and parts_us. Rows of exact
    runs also have the rows of J and those that folding leaves, profiled_us (the step with clocks), looks_us (what those
    cost), and iterations, products, refreshes and unconverged a solve. One that is left out says why in left_out.

    Raises:
        InputError: the native path cannot be taken.
    """
    chosen, budget, progress = tuple(chosen or families()), budget or Budget(), progress or Progress()
    rows: list[dict[str, Any]] = []
    progress.begin("growth", rounds * sum(len(family.sizes) for family in chosen))
    for family in chosen:
        began = time.monotonic()
        rows += grow(family, rounds, budget, tick=partial(progress.advance, 1))
        progress.finished(family.name, time.monotonic() - began)
    return {
        "families": [
            {"name": family.name, "title": family.title, "model": family.model, "counted": family.counted}
            for family in chosen
        ],
        "rounds": rounds,
        "budget_s": budget.walk_s,
        "rows": rows,
        "exponents": exponents(rows),
    }
