"""Copies of solvers, pickled ones too, go on to the last bit; and one solver serves one thread at a time."""

import copy
import pickle
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import oarlock
import oarlock._core as _core
import pytest
from oarlock._core import ConstrainedSystem, InputError
from oarlock.stepping.solvers import solver_names

SIZE, RANK, STEPS = 6, 3, 8
ROUNDS = 50
"""Of two threads that begin at once: a round in which they miss one another proves nothing, but 50 do not."""

COPIES = {
    "clone": lambda solver: solver.clone(),
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    **{
        f"pickle {protocol}": lambda solver, protocol=protocol: pickle.loads(pickle.dumps(solver, protocol))
        for protocol in range(pickle.HIGHEST_PROTOCOL + 1)
    },
}


def sequence(*, doubled_from: int = 0):
    """A and b of steps that change a little; row 1 is twice row 0 from a step on, as a fold sees it."""
    rng = np.random.default_rng(11)
    rows, change = rng.normal(size=(2, SIZE, RANK))
    steps = []
    for step in range(STEPS):
        moved = rows + 1e-3 * step * change
        if step >= doubled_from:
            moved[1] = 2 * moved[0]
        steps.append((moved @ moved.T, moved @ rng.normal(size=RANK)))
    return steps


def figures(info):
    """Everything that an info says but the time."""
    return {name: getattr(info, name) for name in vars(_core.Info) if name[0] != "_" and name != "elapsed_ns"}


def agree_on(steps, one, other):
    for matrix, b in steps:
        (x, info), (same, again) = one.solve(matrix, b), other.solve(matrix, b)
        np.testing.assert_array_equal(x, same)
        assert figures(info) == figures(again)


@pytest.mark.parametrize("copied", COPIES)
@pytest.mark.parametrize("name", solver_names())
@pytest.mark.parametrize("doubled_from", [0, 2, STEPS])
def test_a_copy_goes_on_to_the_last_bit(name, copied, doubled_from):
    steps = sequence(doubled_from=doubled_from)
    solver = oarlock.make_solver(name)
    for step in steps[:4]:
        solver.solve(*step)
    other = COPIES[copied](solver)
    assert type(other) is _core.MultiplierSolver
    assert other.name == name
    agree_on(steps[4:], solver, other)


def test_a_copy_keeps_a_fold_that_would_not_be_found_again():
    """The class of two rows is planned once: their matrix, not that of the last step, has to come along."""
    steps = [(np.diag([1.0, 2.0, 0.0]) + shift * np.eye(3), np.array([1.0, 4.0, 0.0])) for shift in (0.1, 0.0, 0.0)]
    solver = oarlock.make_solver("pinv")
    for step in steps[:2]:
        solver.solve(*step)
    assert solver.solve(*steps[2])[1].folded == 0
    assert oarlock.make_solver("pinv").solve(*steps[2])[1].folded == 1
    agree_on(steps, solver, pickle.loads(pickle.dumps(solver)))


@pytest.mark.parametrize("copied", COPIES)
def test_a_copy_has_the_options_and_a_life_of_its_own(copied):
    solver = oarlock.make_solver("cg", max_iterations=1, warm=False, rtol=1e-3)
    other = COPIES[copied](solver)
    matrix, b = np.diag([1.0, 2.0, 5.0]), np.ones(3)
    agree_on([(matrix, b)], solver, other)
    assert other.solve(matrix, b)[1].status == "iteration-limit"
    solver, kept = oarlock.make_solver("sr1"), np.eye(3)
    solver.solve(kept, b)
    other, before = COPIES[copied](solver), solver.state()
    other.solve(matrix, b)
    other.reset()
    assert solver.state() == before


def test_a_pickle_that_is_not_whole_is_named():
    solver = oarlock.make_solver("pinv")
    with pytest.raises(InputError, match="state has no 'solver'"):
        solver.__setstate__(({}, np.zeros((0, 0))))
    with pytest.raises(InputError, match="A of the fold has shape 2×3, expected 2×2"):
        solver.__setstate__((solver.state(), np.zeros((2, 3))))


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy])
def test_a_system_is_copied_whole(copied):
    system = ConstrainedSystem()
    system.assemble([[4, 0], [0, 1]], [[1, 1]], [4, 1], [0.5])
    other = copied(system)
    system.assemble([[1]], [[1]], [0], [0])
    np.testing.assert_array_equal(other.matrix, [[1.25]])
    np.testing.assert_array_equal(other.acceleration([3.0]), [[1.75, 4.0], [3.0, 3.0]])


def test_a_system_is_not_pickled():
    with pytest.raises(TypeError, match="ConstrainedSystem cannot be pickled, expected the arrays of its step"):
        pickle.dumps(ConstrainedSystem())


# Threads.


def refusals_of_two(call):
    """Calls from two threads at once, until one is refused; returns the messages of the round."""
    barrier = threading.Barrier(2, timeout=60)

    def attempt():
        barrier.wait()
        try:
            call()
        except InputError as error:
            return str(error)
        return None

    with ThreadPoolExecutor(2) as pool:
        for _ in range(ROUNDS):
            attempts = [pool.submit(attempt) for _ in range(2)]
            refused = [message for one in attempts if (message := one.result(timeout=60))]
            assert len(refused) < 2, "one of two is served"
            if refused:
                return refused
    return []


LARGE = np.eye(200) + np.ones((200, 200))


def test_a_solver_in_two_threads_is_refused_by_name():
    solver = oarlock.make_solver("pinv")
    refused = refusals_of_two(lambda: solver.solve(LARGE, np.ones(200)))
    assert refused == ["solver 'pinv' is in use by another thread, expected one thread at a time (give each its own)"]
    assert solver.solve(LARGE, np.ones(200))[1].status == "converged"


def test_a_system_in_two_threads_is_refused_by_name():
    system = ConstrainedSystem()
    system.assemble(LARGE, LARGE, np.ones(200), np.ones(200))

    def solve():
        oarlock.make_solver("pinv").solve_system(system)

    refused = refusals_of_two(solve)
    assert refused == ["the system is in use by another thread, expected one thread at a time (give each its own)"]
    solve()
