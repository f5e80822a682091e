"""The exact answers of a growth, and how far methods are from them at generic, nearly singular and singular states."""

import numpy as np
import pytest
from oarlock.bench import memory
from oarlock.bench.errors import (
    GENERIC,
    LEAD,
    SINGULAR,
    bench_errors,
    judge,
    kind_of,
    places_near_singular,
    places_of_walk,
    worst,
)
from oarlock.bench.families import families
from oarlock.bench.growth import SOLVERS
from oarlock.bench.memory import WALKERS, bench_memory, peak_mb
from oarlock.bench.oracle import exact
from oarlock.bench.steps import BARE
from random_mechanisms.oracle import exact as exact_by_eigenvectors

DIRECT = ("auto", "dual", "primal", "cholesky", "pinv")

ROUNDING = 1e-9
"""Of a direct solver at a state 1e-3 rad from a singular pose: A has a condition of 1e6 there, and rows of it a few
hundred times the 1e-16 of doubles."""

KEPT = 1e-6
"""What ``converged`` promises of accelerations."""


def chain(rank, seed, spread=1.0):
    """M of seven coordinates and five rows J of a rank, one of them nearly in the others if spread is small."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(7, 7))
    basis = rng.normal(size=(rank, 7))
    basis[-1] = basis[0] + spread * basis[-1]
    weights = rng.integers(-2, 3, (5 - rank, rank)).astype(float)
    jacobian = np.concatenate([basis, weights @ basis])
    return root @ root.T + np.eye(7), jacobian, rng.normal(size=7), rng.normal(size=5)


@pytest.mark.parametrize(("rank", "spread"), [(5, 1.0), (3, 1.0), (5, 1e-6), (3, 1e-6)])
def test_two_oracles_agree(rank, spread):
    """Pivots here, eigenvectors there. What doubles leave of a repeated row, 1e-16, turns ranges by that much."""
    mass, jacobian, free, aref = chain(rank, 3, spread)
    mine, theirs = exact(mass, jacobian, free, aref), exact_by_eigenvectors(mass, jacobian, free, aref, rank)
    assert mine.rank == rank
    assert mine.multipliers == pytest.approx(
        theirs.multipliers, rel=1e-14, abs=1e-14 * np.abs(theirs.multipliers).max()
    )
    assert mine.acceleration == pytest.approx(theirs.acceleration, rel=1e-13, abs=1e-13)


def test_a_rank_is_kept_where_rows_are_nearly_the_same():
    """Two rows 1e-9 apart are one by structure: what was asked of both is asked of their middle."""
    rows = np.array([[1.0, 0.0], [1.0, 1e-9]])
    held, free = (exact(np.eye(2), rows, np.zeros(2), np.array([1.0, 2.0]), rank) for rank in (1, None))
    assert (held.rank, free.rank) == (1, 2)
    assert held.acceleration == pytest.approx([1.5, 0.0], abs=1e-8)
    assert free.acceleration == pytest.approx([1.0, 1e9])


def test_an_oracle_of_nothing_is_the_free_motion():
    found = exact(np.eye(2), np.zeros((3, 2)), np.array([1.0, -2.0]), np.ones(3))
    assert found.rank == 0
    assert found.acceleration.tolist() == [1.0, -2.0]
    assert found.multipliers.tolist() == [0.0] * 3


@pytest.fixture(scope="module")
def judged():
    rows = bench_errors(("net:k=2", "n_crank:K=4"), ("n_four_bar:N=2,connects=2",))
    return {(row["model"], row["state"], row["name"]): row for row in rows}


def test_a_row_a_model_state_and_method(judged):
    near = [(kind_of(distance), 1) for distance in (1e-3, 1e-4, 1e-6, 0.0)]
    assert near[-1][0] == SINGULAR
    states = [
        ("net:k=2", GENERIC, 3),
        ("n_crank:K=4", GENERIC, 3),
        *(("n_four_bar:N=2,connects=2", *one) for one in near),
    ]
    assert list(judged) == [(model, state, name) for model, state, _ in states for name in SOLVERS]
    counts = {(model, state): count for model, state, count in states}
    assert all(row["states"] == counts[model, state] for (model, state, _), row in judged.items())
    ranks = {(model, state): row["true_rank"] for (model, state, _), row in judged.items()}
    assert list(ranks.values()) == [8, 4, 4, 4, 4, 2]


def test_direct_solvers_are_right_to_rounding_away_from_singular_poses(judged):
    own = [row for row in judged.values() if row["name"] in DIRECT and row["state"] in (GENERIC, "0.001 rad from it")]
    assert len(own) == 3 * len(DIRECT)
    for row in own:
        assert row["status"] == "converged"
        assert row["rank"] == row["true_rank"]
        assert row["acceleration"] < ROUNDING
        assert row["multipliers"] < ROUNDING


def test_what_converged_keeps_its_promise_but_below_the_rank_cut(judged):
    """At 1e-6 rad the cut of 1e-10 takes ranks away, and the error is what that leaves out."""
    kept = [row for row in judged.values() if row["status"] == "converged" and row["rank"] in (None, row["true_rank"])]
    assert len(kept) > 5 * len(DIRECT)
    assert [row for row in kept if not row["acceleration"] < KEPT] == []
    cut = [judged["n_four_bar:N=2,connects=2", "1e-06 rad from it", name] for name in DIRECT]
    assert {row["rank"] for row in cut} == {2}
    assert min(row["multipliers"] for row in cut) > 0.1


def test_the_worst_of_states_counts():
    row = {"model": "m", "state": "s", "name": "n", "acceleration": 1e-9, "multipliers": 1e-3, "status": "converged"}
    row |= {"rank": 2, "true_rank": 2}
    (found,) = worst([row, row | {"acceleration": 1e-5, "status": "breakdown"}, row | {"rank": 1}])
    assert (found["states"], found["acceleration"], found["multipliers"]) == (3, 1e-5, 1e-3)
    assert (found["status"], found["rank"], found["true_rank"]) == ("breakdown", 1, 2)
    (found,) = worst([row, row | {"acceleration": None}])
    assert found["acceleration"] is None


def test_places_are_led_to():
    places = list(places_of_walk("n_crank:K=4", (5, LEAD + 5)))
    assert [len(place.way) for place in places] == [6, LEAD + 1]
    assert {place.rank for place in places} == {4}
    assert {place.rank for place in places_near_singular("n_four_bar:N=2")} == {None}
    assert not np.array_equal(places[0].way[-1][0], places[0].way[-2][0])
    rows = judge(places[0], ("pinv",))
    assert [row["name"] for row in rows] == ["pinv"]
    assert rows[0]["acceleration"] < ROUNDING


def test_memory_is_that_of_a_process_of_its_own():
    """A block of 64 MB that this process let go is in its own peak, and in no other's."""
    held = bytearray(64 << 20)
    here = peak_mb()
    if here is None:
        pytest.skip("the system does not tell the peak of a process")
    del held
    own = [{"family": "chain", "model": "n_four_bar:N=2", "size": 2, "name": name, "left_out": ""} for name in WALKERS]
    own[-1]["left_out"] = "too long"
    growth = {"families": [{"name": "chain"}], "rows": own}
    rows = bench_memory(growth, steps=5)
    assert [row["name"] for row in rows] == list(WALKERS[:-1])
    for row in rows:
        assert 10 < row["before_mb"] <= row["peak_mb"] < here
        assert row["steps"] == 5


def test_a_walk_that_fails_is_named(monkeypatch):
    monkeypatch.setattr(memory, "WALKERS", ("nobody",))
    row = {"family": "chain", "model": "n_four_bar:N=2", "size": 2, "name": "nobody", "left_out": ""}
    with pytest.raises(memory.InputError, match="walk of n_four_bar:N=2 by nobody failed: "):
        bench_memory({"families": [{"name": "chain"}], "rows": [row]}, steps=5)


def test_walks_of_a_child_are_those_of_its_arguments(capsys):
    memory.main(["chain-singular", "2", BARE, "5"])
    assert '"peak_mb"' in capsys.readouterr().out
    assert families(["chain-singular"])[0].start is not None
