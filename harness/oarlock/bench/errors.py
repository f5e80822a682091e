"""How far the answers of every method are from the exact ones, at generic, nearly singular and singular states.

A method that carries what it learned is asked at the states that lead to the one that is judged, one by one.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np

from oarlock.base.progress import Progress
from oarlock.bench.families import LEVEL, turned
from oarlock.bench.growth import SOLVERS
from oarlock.bench.oracle import Exact, exact
from oarlock.bench.steps import Track
from oarlock.mechanics.engine_version import full_mass
from oarlock.mechanics.load import quiet_engine
from oarlock.stepping.prepared import Prepared
from oarlock.stepping.question import Answer, Question
from oarlock.stepping.state import State

LEAD = 20
"""States that lead to the one that is judged."""

SAMPLED = (40, 80, 120)
"""Steps of the walk at whose states methods are judged."""

RATE, STEP_S = 3.0, 1e-3
"""rad/s and s: how fast parallel cranks come to their singular pose, and how far apart the states are on the way."""

GENERIC, SINGULAR = "generic", "singular"

DISTANCES = (1e-3, 1e-4, 1e-6, 0.0)
"""rad from the singular pose."""

WALKED = (
    "n_four_bar:N=10",
    "n_four_bar:N=40,connects=2",
    "n_four_bar:N=40,apart=1",
    "net:k=6",
    "net:k=6,tree=1",
    "n_crank:K=11",
    "sarrus:cells=5,apart=1",
    "sarrus:cells=5",
    "tensegrity:cells=5",
    "ring:bodies=100,planar=1",
)
"""Models that are judged on the way of a walk."""

PARALLEL = ("n_four_bar:N=10", "n_four_bar:N=40,connects=2", "n_four_bar:N=10,apart=1")
"""Models of parallel cranks on one line, whose singular pose is known."""

Way = list[tuple[np.ndarray, np.ndarray]]
"""States, qpos (nq) and qvel (nv) each, to be asked one after another; the last is judged."""


@dataclass(frozen=True)
class Place:
    """A state of a model that methods are judged at.

    Attributes:
        model: its name.
        kind: what the state is.
        way: leads to it.
        rank: of A there by structure; None where the pose decides.
    """

    model: str
    kind: str
    way: Way
    rank: int | None = None


def places_of_walk(name: str, sampled: tuple[int, ...] = SAMPLED) -> Iterator[Place]:
    """States of the exact walk of a model at those steps."""
    track = Track(name, max(sampled) + 1)
    run, states = track.free_runs("auto")(track.steps), []
    for _ in range(track.steps):
        qpos, qvel, _ = run.state
        states.append((qpos.copy(), qvel.copy()))
        run.advance(1)
    for step in sampled:
        yield Place(name, GENERIC, states[max(0, step - LEAD) : step + 1], track.rank)


def kind_of(distance: float) -> str:
    """What a state so far from the singular pose, rad, is called."""
    return f"{distance:g} rad from it" if distance else SINGULAR


def places_near_singular(name: str, distances: tuple[float, ...] = DISTANCES) -> Iterator[Place]:
    """States of parallel cranks on the way to their singular pose, at those distances in rad."""
    model = Track(name, 1).model
    for distance in distances:
        angles = [LEVEL - distance - RATE * STEP_S * left for left in reversed(range(LEAD + 1))]
        yield Place(name, kind_of(distance), [turned(model, angle, RATE) for angle in angles])


class _Asked:
    """The question of one state after another."""

    def __init__(self, track: Track):
        prepared: Prepared = track.prepared()
        self._model, self._data = prepared.model, prepared.data()
        self._state = State(self._model, self._data, track.terms)
        self.question = Question(self._state, "hard")

    def read(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        model, data = self._model, self._data
        data.qpos[:], data.qvel[:] = qpos, qvel
        for stage in (mujoco.mj_fwdPosition, mujoco.mj_fwdVelocity, mujoco.mj_fwdActuation, mujoco.mj_fwdAcceleration):
            stage(model, data)
        self._state.read()
        self.question.ask()

    def right(self, rank: int | None) -> Exact:
        """The exact answer at the state where it is."""
        mass = full_mass(self._model, self._data)
        aref, _ = self._state.question("hard")
        return exact(mass, self._state.jacobian, self._state.unconstrained, aref, rank)

    @property
    def unconstrained(self) -> np.ndarray:
        return self._state.unconstrained


def judge(place: Place, solvers: tuple[str, ...] = SOLVERS) -> list[dict[str, Any]]:
    """A row a method: model, state, name, acceleration and multipliers (errors), status, rank and true_rank.

    Errors are relative to the largest acceleration, with or without constraints, and to the largest multiplier. The
    rank is None of a method that does not tell.
    """
    track = Track(place.model, 1)
    asked, own = _Asked(track), {name: track.solver(name) for name in solvers}
    answers: dict[str, Answer] = {}
    for qpos, qvel in place.way:
        asked.read(qpos, qvel)
        answers = {name: asked.question.answer(solver) for name, solver in own.items()}
    right = asked.right(place.rank)
    fastest = np.abs([right.acceleration, asked.unconstrained]).max()
    strongest = np.abs(right.multipliers).max()

    def off(found: np.ndarray, known: np.ndarray, scale: float) -> float | None:
        error = float(np.abs(found - known).max() / scale)
        return error if np.isfinite(error) else None

    return [
        {
            "model": place.model,
            "state": place.kind,
            "name": name,
            "acceleration": off(answer.qacc, right.acceleration, fastest),
            "multipliers": off(answer.multipliers, right.multipliers, strongest),
            "status": answer.info.status,
            "rank": answer.info.rank,
            "true_rank": right.rank,
        }
        for name, answer in answers.items()
    ]


def worst(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row a model, kind of state and method: the largest errors, and any status but converged and any wrong rank.

    An error of None, which is not finite, is the largest.
    """

    def largest(own: list[dict[str, Any]], figure: str) -> float | None:
        errors = [row[figure] for row in own]
        return None if None in errors else max(errors)

    found = []
    for key in dict.fromkeys((row["model"], row["state"], row["name"]) for row in rows):
        own = [row for row in rows if (row["model"], row["state"], row["name"]) == key]
        status = next((row["status"] for row in own if row["status"] != "converged"), "converged")
        off = next((row for row in own if row["rank"] not in (None, row["true_rank"])), own[-1])
        errors = {figure: largest(own, figure) for figure in ("acceleration", "multipliers")}
        ranks = {"rank": off["rank"], "true_rank": off["true_rank"]}
        found.append(
            {"model": key[0], "state": key[1], "name": key[2], "states": len(own), **errors, "status": status, **ranks}
        )
    return found


def bench_errors(
    walked: tuple[str, ...] = WALKED, parallel: tuple[str, ...] = PARALLEL, progress: Progress | None = None
) -> list[dict[str, Any]]:
    """The rows of ``worst`` of all models and states.

    Raises:
        InputError: the native path cannot be taken, or there is no such model.
    """
    progress = progress or Progress()
    ways = [partial(places_of_walk, name) for name in walked] + [
        partial(places_near_singular, name) for name in parallel
    ]
    progress.begin("errors", len(ways))
    rows: list[dict[str, Any]] = []
    with quiet_engine():
        for way in ways:
            for place in way():
                rows += judge(place)
            progress.advance(1)
    return worst(rows)
