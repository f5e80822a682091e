"""The compiled core from NumPy: arrays in and out, errors that name the array, the lock, and minimum-norm answers."""

import json
import threading

import numpy as np
import oarlock
import oarlock._core as _core
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oarlock import make_solver
from oarlock._core import ConstrainedSystem, InputError
from oarlock.stepping.solvers import SolverSpec, solver_names
from tolerances import SOLVE_RESIDUAL

A = np.diag([1.0, 2.0, 0.0])
B = np.array([1.0, 4.0, 0.0])


@pytest.fixture(params=solver_names())
def solver(request):
    """Every solver, asked for as much as it can be asked for."""
    tight = {key: 1e-13 for key in ("rtol",) if key in _core.solvers()[request.param][1]}
    return make_solver(request.param, **tight)


def with_entry(array, index, value):
    changed = array.copy()
    changed[index] = value
    return changed


def unaligned(array):
    """The same numbers, one byte off the places that float64 have in memory."""
    moved = np.zeros(array.nbytes + 1, np.uint8)[1:].view(np.float64).reshape(array.shape)
    moved[:] = array
    return moved


def test_registry():
    known = _core.solvers()
    assert {"sr1", "pinv"} <= set(known) == set(solver_names())
    for name, (summary, options) in known.items():
        assert summary
        assert make_solver(name, **options).name == name  # every default is valid
        assert repr(make_solver(name)) == f"<MultiplierSolver {name}>"


def test_answer_and_info(solver):
    x, info = solver.solve(A, B)
    assert (x.shape, x.dtype) == ((3,), np.float64)
    np.testing.assert_allclose(x, [1, 2, 0], rtol=SOLVE_RESIDUAL, atol=SOLVE_RESIDUAL)
    assert info.status == "converged"
    assert info.residual_rel <= SOLVE_RESIDUAL
    assert info.iterations >= 0
    assert info.elapsed_ns > 0
    assert isinstance(info.refreshed, bool)
    assert info.fallbacks == 0
    assert "converged" in repr(info)


def test_pinv_knows_rank_and_inconsistency():
    _, info = make_solver("pinv").solve(A, np.array([1.0, 4.0, 0.5]))
    assert info.rank == 2
    assert info.inconsistency == pytest.approx(0.5, rel=SOLVE_RESIDUAL)


def test_inputs_are_not_written_and_answers_not_shared(solver):
    a, b = A.copy(), B.copy()
    a.flags.writeable = b.flags.writeable = False
    first, _ = solver.solve(a, b)
    kept = first.copy()
    second, _ = solver.solve(2 * A, B)
    np.testing.assert_array_equal(first, kept)
    assert not np.shares_memory(first, second)
    np.testing.assert_array_equal(a, A)


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (A, B[:2], "A has shape 3×3, expected 2×2"),
        (A[:2], B, "A has shape 2×3, expected 3×3"),
        (np.zeros((0, 0)), np.zeros(0), "empty"),
        (with_entry(A, (1, 1), np.nan), B, r"A\[4\] = NaN"),
        (with_entry(A, (0, 2), np.inf), B, r"A\[2\] = inf"),
        (A, with_entry(B, 1, np.nan), r"b\[1\] = NaN"),
        (A, with_entry(B, 2, -np.inf), r"b\[2\] = -inf"),
        (with_entry(A, (0, 1), 1.0), B, r"A\[(0,1|1,0)\] and A\[(0,1|1,0)\] differ by 1e0"),
        (with_entry(A, (2, 2), -1.0), B, "not positive semidefinite: smallest eigenvalue -1"),
        (np.array([[0.0, 1.0], [1.0, 0.0]]), np.ones(2), "not positive semidefinite: smallest eigenvalue -1"),
        (
            1.9 * np.eye(3) - 0.9,
            np.array([1.0, -1.0, 0.0]),
            "semidefinite: smallest eigenvalue -8",
        ),  # b does not see it
        (np.array([[-2.0]]), np.ones(1), "semidefinite: smallest eigenvalue -2"),
        (with_entry(A, (1, 1), 1e200), B, r"A\[4\] = 1e200, expected numbers up to 1e150"),
        (A, with_entry(B, 0, -1e200), r"b\[0\] = -1e200, expected numbers up to 1e150"),
        (A.astype(complex), B, "A has dtype complex128, expected a 3×3 matrix of real numbers"),
        (A.astype(object), B, "A has dtype object, expected a 3×3 matrix"),
        (A.astype(bool), B, "A has dtype bool, expected a 3×3 matrix"),
        (np.ma.masked_equal(A, 0), B, "A is a masked array, expected a 3×3 matrix"),
        (A.ravel(), B, "A is a vector of 9, expected a 3×3 matrix"),
        (A[None], B, "A is of shape 1×3×3, expected a 3×3 matrix"),
        ([[1.0, 2.0], [3.0]], B, r"A is no array \(.*inhomogeneous.*\), expected a 3×3 matrix"),
        (np.array(1.0), B, "A is a single number, expected a 3×3 matrix"),
        (A.astype(np.float32) * np.float32(np.nan), B, r"A\[0\] = NaN"),
        (A, B[:, None], "b is of shape 3×1, expected a vector"),
        (A, 1.0, "b is a single number, expected a vector"),
        (A, None, "b is of type NoneType, expected a vector of real numbers"),
        (A, {"x": 1.0}, "b is of type dict, expected a vector"),
        (A, "three", "b has dtype <U5, expected a vector"),
        (A, ["1", "4", "0"], "b has dtype <U1, expected a vector"),
        (A, [1.0, None, 0.0], "b has dtype object, expected a vector"),
        (A, [10**30, 4, 0], "b has dtype object, expected a vector"),
        (A, np.array(["2020", "2021", "2022"], "M8[Y]"), r"b has dtype datetime64\[Y\], expected a vector"),
        (A, [1, np.nan, 0], r"b\[1\] = NaN"),
        (A, [], "b is empty|A has shape 3×3, expected 0×0"),
    ],
)
def test_bad_arrays_are_named(solver, a, b, message):
    with pytest.raises(InputError, match=message):
        solver.solve(a, b)
    x, _ = solver.solve(A, B)  # the failure left nothing behind
    np.testing.assert_allclose(x, [1, 2, 0], rtol=SOLVE_RESIDUAL, atol=SOLVE_RESIDUAL)


KINDS = {
    "list": np.ndarray.tolist,
    "tuple": lambda array: tuple(array.tolist()),
    "int": lambda array: array.astype(int),
    "list of int": lambda array: array.astype(int).tolist(),
    "float16": lambda array: array.astype(np.float16),
    "float32": lambda array: array.astype(np.float32),
    "longdouble": lambda array: array.astype(np.longdouble),
    "big-endian": lambda array: array.astype(">f8"),
    "Fortran order": np.asfortranarray,
    "every other": lambda array: np.repeat(array, 2, axis=-1)[..., ::2],
    "backwards": lambda array: np.flip(np.flip(array).copy()),
    "unaligned": unaligned,
}


@pytest.mark.parametrize("kind", KINDS)
def test_real_numbers_of_any_kind_and_order_are_taken(solver, kind):
    """Converted, they are the same float64 numbers: the answer is the same to the last bit."""
    matrix = with_entry(A, (0, 1), 1.0) + with_entry(A, (1, 0), 1.0)
    expected, _ = solver.clone().solve(matrix, B)
    x, _ = solver.solve(KINDS[kind](matrix), KINDS[kind](B))
    np.testing.assert_array_equal(x, expected)


def test_subclasses_of_arrays_are_read_as_arrays(solver):
    class Labelled(np.ndarray):
        pass

    x, _ = solver.solve(A.view(Labelled), B.view(Labelled))
    assert type(x) is np.ndarray
    np.testing.assert_allclose(x, [1, 2, 0], rtol=SOLVE_RESIDUAL, atol=SOLVE_RESIDUAL)


def test_an_answer_that_overflows_is_refused(solver):
    tiny, large = np.full((1, 1), 1e-300), np.full(1, 1e100)
    with pytest.raises(InputError, match=r"multipliers\[0\] = \S+, expected finite numbers"):
        solver.solve(tiny, large)
    assert solver.solve(A, B)[1].status == "converged"


@pytest.mark.parametrize("scale", [1e-70, 1e-8, 1.0, 1e8, 1e70])
def test_scales_and_one_by_one(solver, scale):
    x, info = solver.solve(np.full((1, 1), scale), np.full(1, 3 * scale))
    np.testing.assert_allclose(x, 3, rtol=SOLVE_RESIDUAL)
    assert info.status == "converged"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"solver": "gauss"}, "cannot take the state: it is that of solver 'gauss'"),
        ({"solver": 3}, r"state\['solver'\] = 3, expected the name of a solver"),
        ({"size": -1}, r"state\['size'\] = -1, expected a whole number"),
        ({"size": 1.5}, r"state\['size'\] = 1.5, expected a whole number"),
        ({"size": 10**30}, r"state\['size'\] = 10{30}, expected a whole number"),
        ({"fields": []}, r"state\['fields'\] = \[\], expected lists of numbers by name"),
        ({"fields": {"x": "three"}}, r"state\['fields'\] = \{'x': 'three'\}, expected lists of numbers by name"),
        ({"fields": {"later": [1.0]}}, "cannot take the state: "),
        ({"version": 2}, r"state has the keys \['solver', 'size', 'fields', 'version'\], expected"),
    ],
)
def test_bad_states_are_named(solver, change, message):
    solver.solve(A, B)
    state = solver.state()
    with pytest.raises(InputError, match=message):
        solver.restore({**state, **change})
    for key in state:
        with pytest.raises(InputError, match=f"state has no '{key}'"):
            solver.restore({name: value for name, value in state.items() if name != key})
    solver.restore(json.loads(json.dumps(state)))
    x, _ = solver.solve(A, B)
    np.testing.assert_allclose(x, [1, 2, 0], rtol=SOLVE_RESIDUAL, atol=SOLVE_RESIDUAL)


def test_a_size_without_fields_takes_no_memory(solver):
    solver.restore({"solver": solver.name, "size": 10**15, "fields": {}})
    assert solver.solve(A, B)[1].status == "converged"


def test_size_may_change_between_solves(solver):
    for n in (3, 1, 7, 3):
        x, info = solver.solve(np.eye(n), np.ones(n))
        np.testing.assert_allclose(x, np.ones(n), rtol=SOLVE_RESIDUAL)
        assert info.status == "converged"


def test_reset_forgets(solver):
    first, info = solver.solve(A, B)
    solver.solve(A + 0.1 * np.eye(3), B)
    solver.reset()
    again, info_again = solver.solve(A, B)
    # The fold stays that of the matrix in between, which has no zero row: the same numbers by another route.
    np.testing.assert_allclose(again, first, rtol=SOLVE_RESIDUAL, atol=SOLVE_RESIDUAL)
    assert info_again.iterations == info.iterations


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("gauss", {}, "unknown solver 'gauss', expected one of: .*sr1"),
        ("", {}, "unknown solver ''"),
        ("pinv", {"eps_abs": 1.0}, "'pinv' has no option 'eps_abs'"),
        ("sr1", {"eps_abs": 0.0}, "eps_abs = 0 of solver 'sr1', expected a finite number > 0"),
        ("sr1", {"eps_abs": float("nan")}, "eps_abs = NaN"),
        ("sr1", {"max_iterations": 2.5}, "max_iterations = 2.5"),
        ("pinv", {"rank_cut": 1.0}, "rank_cut = 1"),
    ],
)
def test_bad_options_are_named(name, options, message):
    with pytest.raises(InputError, match=message):
        make_solver(name, **options)


@pytest.mark.parametrize("value", ["small", None, [1e-7], 1j])
def test_options_are_numbers(value):
    with pytest.raises(InputError, match=r"option eps_abs = .* of solver 'sr1', expected a number or a switch"):
        make_solver("sr1", eps_abs=value)


@pytest.mark.parametrize(
    ("method", "arguments", "message"),
    [
        ("solve_system", (None,), "system is of type NoneType, expected a ConstrainedSystem"),
        ("solve_system", (ConstrainedSystem(), 3), "wanted is of type int, expected a string"),
        ("solve_system", (ConstrainedSystem(), "all"), "wanted = 'all', expected one of: multipliers, acceleration"),
        ("restore", (None,), "state is of type NoneType, expected a dictionary"),
    ],
)
def test_arguments_of_another_type_are_named(solver, method, arguments, message):
    with pytest.raises(InputError, match=message):
        getattr(solver, method)(*arguments)


def test_a_name_is_a_string():
    with pytest.raises(InputError, match="name is of type int, expected a string"):
        make_solver(3)  # pyright: ignore[reportArgumentType]


def test_defaults_are_of_the_kinds_of_their_options():
    expected = {"max_iterations": 500, "rank_cut": 1e-10, "rtol": 1e-10, "warm": True}
    defaults = _core.solvers()["cg"][1]
    assert defaults == expected
    assert {option: type(value) for option, value in defaults.items()} == {
        option: type(value) for option, value in expected.items()
    }


@pytest.mark.parametrize(
    "options", [{"max_iterations": 7, "warm": False}, {"max_iterations": 7.0, "warm": 0}, {"rtol": 1, "warm": 1.0}]
)
def test_numbers_may_be_of_another_kind(options):
    assert make_solver("cg", **options).name == "cg"


@pytest.mark.parametrize(("option", "value"), [("rtol", True), ("max_iterations", True), ("warm", 2)])
def test_a_switch_is_no_number(option, value):
    with pytest.raises(InputError, match=f"option {option} = {str(value).lower()} of solver 'cg', expected a "):
        make_solver("cg", **{option: value})


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("sr1-tracked:predict=5", "sr1-tracked:predict=5"),
        ("sr1-tracked:predict=5.0,rtol=1", "sr1-tracked:predict=5,rtol=1.0"),
        ("cg:max_iterations=1e2,warm=true", "cg:max_iterations=100,warm=1"),
        ("cg:warm=0", "cg:warm=0"),
        ("cg:warm=false", "cg:warm=0"),
    ],
)
def test_a_solver_is_called_the_same_however_its_options_are_written(text, name):
    assert str(SolverSpec.parse(text)) == name
    assert SolverSpec.parse(name) == SolverSpec.parse(text)


def test_one_exception_catches_all_bad_input():
    """What the package calls InputError must also be what its own make_solver and run raise."""
    assert issubclass(oarlock.InputError, ValueError)
    with pytest.raises(oarlock.InputError):
        oarlock.make_solver("gauss")


# A step's own matrices.


def assembled(**changes):
    arrays = {
        "mass": np.diag([2.0, 4.0]),
        "jacobian": np.array([[1.0, 1.0]]),
        "force": np.array([2.0, 4.0]),
        "aref": np.array([0.5]),
    }
    system = ConstrainedSystem()
    system.assemble(**{**arrays, **changes})
    return system


def test_system_forms_its_parts():
    """A = J M⁻¹ Jᵀ + R, b = aref − J M⁻¹ f, and back to accelerations: by hand."""
    system = assembled(regularisation=np.array([0.25]))
    np.testing.assert_allclose(system.matrix, [[1 / 2 + 1 / 4 + 1 / 4]], rtol=SOLVE_RESIDUAL)
    np.testing.assert_allclose(system.rhs, [0.5 - (1 + 1)], rtol=SOLVE_RESIDUAL)
    qacc, qfrc = system.acceleration(np.array([3.0]))
    np.testing.assert_allclose(qfrc, [3, 3], rtol=SOLVE_RESIDUAL)
    np.testing.assert_allclose(qacc, [1 + 3 / 2, 1 + 3 / 4], rtol=SOLVE_RESIDUAL)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mass": np.eye(3)}, "mass has shape 3×3, expected 2×2"),
        ({"jacobian": np.ones((2, 2))}, "jacobian has shape 2×2, expected 1×2"),
        ({"mass": np.diag([1.0, 0.0])}, "mass matrix is not positive definite"),
        ({"mass": np.diag([1.0, -1.0])}, "mass matrix is not positive definite"),
        ({"force": np.array([1.0, np.nan])}, r"force\[1\] = NaN"),
        ({"aref": np.array([np.inf])}, r"aref\[0\] = inf"),
        ({"jacobian": np.array([[np.nan, 0.0]])}, r"jacobian\[0\] = NaN"),
        ({"regularisation": np.array([-1.0])}, r"regularisation\[0\] = -1"),
        ({"regularisation": np.ones(2)}, "regularisation"),
        ({"aref": np.zeros(0), "jacobian": np.zeros((0, 2))}, "empty"),
        ({"mass": [[1.0, 0.0], [0.0, 1j]]}, "mass has dtype complex128, expected a 2×2 matrix of real numbers"),
        ({"jacobian": [1.0, 1.0]}, "jacobian is a vector of 2, expected a 1×2 matrix"),
        ({"force": [[2.0], [4.0]]}, "force is of shape 2×1, expected a vector"),
        ({"aref": 0.5}, "aref is a single number, expected a vector"),
        ({"regularisation": "soft"}, "regularisation has dtype <U4, expected a vector"),
    ],
)
def test_bad_systems_are_named(changes, message):
    with pytest.raises(InputError, match=message):
        assembled(**changes)


def test_systems_take_what_is_no_array():
    system, listed = assembled(), ConstrainedSystem()
    listed.assemble([[2, 0], [0, 4]], [[1, 1]], [2, 4], [0.5])
    np.testing.assert_array_equal(listed.matrix, system.matrix)
    np.testing.assert_array_equal(listed.rhs, system.rhs)
    np.testing.assert_array_equal(listed.acceleration([3]), system.acceleration(np.array([3.0])))
    np.testing.assert_array_equal(listed.force([3]), system.force(np.array([3.0])))
    with pytest.raises(InputError, match="multipliers is of shape 1×1, expected a vector"):
        listed.force([[3.0]])
    with pytest.raises(InputError, match="whitened is of type NoneType, expected a 1×2 matrix"):
        listed.assemble_factored(None, [[1, 1]], [2, 4], [0.5])  # pyright: ignore[reportArgumentType]


def test_unassembled_systems_are_refused(solver):
    with pytest.raises(InputError):
        solver.solve_system(ConstrainedSystem())
    with pytest.raises(InputError, match="multipliers"):
        assembled().acceleration(np.ones(2))


def test_system_may_be_assembled_anew():
    system = assembled()
    with pytest.raises(InputError):
        system.assemble(np.eye(1), np.ones((1, 1)), np.ones(1), np.array([np.nan]))
    system.assemble(np.eye(3), np.eye(3), np.zeros(3), np.ones(3))
    np.testing.assert_array_equal(system.matrix, np.eye(3))


# Threads.


def test_solves_run_side_by_side():
    """The lock is released: many solves in two threads end, each with its own answer."""
    rng = np.random.default_rng(5)
    factors = [rng.normal(size=(40, 40)) for _ in range(2)]
    results = [np.zeros(40), np.zeros(40)]

    def work(index):
        solver, matrix = make_solver("pinv"), factors[index] @ factors[index].T
        for _ in range(20):
            results[index] = solver.solve(matrix, matrix @ np.ones(40))[0]

    threads = [threading.Thread(target=work, args=(index,), daemon=True) for index in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=60)
    assert not any(thread.is_alive() for thread in threads)
    for result in results:
        np.testing.assert_allclose(result, np.ones(40), rtol=1e6 * SOLVE_RESIDUAL)  # condition of a random square


# Minimum norm.


@st.composite
def singular_systems(draw):
    """A PSD matrix of random size and rank with eigenvalues over three decades, and a b that need not fit."""
    size = draw(st.integers(1, 12))
    rank = draw(st.integers(0, size))
    scale = 10.0 ** draw(st.integers(-6, 6))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    basis = np.linalg.qr(rng.normal(size=(size, size)))[0][:, :rank]
    values = scale * 10 ** rng.uniform(-3, 0, rank)
    matrix = (basis * values) @ basis.T
    return (matrix + matrix.T) / 2, rng.normal(size=size), basis, values


@settings(max_examples=200, deadline=None, derandomize=True)
@given(singular_systems())
def test_pinv_is_the_minimum_norm_least_squares_solution(system):
    matrix, b, basis, values = system
    x, info = make_solver("pinv").solve(matrix, b)
    fitting = basis @ (basis.T @ b)
    expected = basis @ ((basis.T @ b) / values)
    size = float(np.linalg.norm(b))
    assert info.rank == len(values)
    assert np.linalg.norm(matrix @ x - fitting) <= SOLVE_RESIDUAL * size
    assert np.linalg.norm(x - basis @ (basis.T @ x)) <= SOLVE_RESIDUAL * np.linalg.norm(x)
    assert np.linalg.norm(x - expected) <= 1e3 * SOLVE_RESIDUAL * np.linalg.norm(expected)
    assert info.inconsistency == pytest.approx(np.linalg.norm(b - fitting), abs=SOLVE_RESIDUAL * size)


def test_core_says_how_it_was_built():
    assert _core.BUILD_PROFILE in ("release", "debug")
    assert oarlock.__version__ == _core.VERSION
