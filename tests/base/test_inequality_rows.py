"""Inequality rows beside equality rows, against an independent answer in forty digits."""

import mpmath
import numpy as np
import pytest
from inequality_cases import Step, answer, random_step
from oarlock.base import core
from tolerances import WHOLE_ANSWER

_mp = mpmath.MPContext()
_mp.dps = 40

STEPS = 80
"""Newton steps of the oracle at most."""


def matrix(values: np.ndarray):
    return _mp.matrix(np.atleast_2d(values).tolist())


def column(values: np.ndarray):
    return _mp.matrix(values.tolist())


def independent(rows: np.ndarray) -> list[int]:
    """Numbers of rows that span all of them, which are sums of others in exact arithmetic or clearly not."""
    kept: list[int] = []
    for index in range(len(rows)):
        if np.linalg.matrix_rank(rows[[*kept, index]], tol=1e-9) > len(kept):
            kept.append(index)
    return kept


def law(step: Step, x):
    """Cost, gradient (m) and Hessian (m, m) of all inequality rows at x, each written out from its formula."""
    rows, m = step.rows, len(step.rows.aref)
    cost, gradient, hessian, row = _mp.mpf(0), _mp.zeros(m, 1), _mp.zeros(m), 0
    for dim, mu, friction in zip(rows.dims, rows.mu, rows.friction, strict=True):
        d = _mp.mpf(rows.stiffness[row])
        if dim < 2:
            loss = _mp.mpf(rows.loss[row])
            if dim == 0 and abs(d * x[row]) >= loss:
                cost += loss * abs(x[row]) - loss**2 / (2 * d)
                gradient[row] = loss * _mp.sign(x[row])
            elif dim == 0 or x[row] < 0:
                cost, gradient[row], hessian[row, row] = cost + d * x[row] ** 2 / 2, d * x[row], d
            row += 1
            continue
        mu = _mp.mpf(mu)
        scales = [mu, *(_mp.mpf(one) for one in friction[: dim - 1])]
        u = [scale * x[row + j] for j, scale in enumerate(scales)]
        tangent = _mp.sqrt(sum(one**2 for one in u[1:]))
        first, second = [_mp.mpf(0)] * dim, _mp.zeros(dim)
        if u[0] < mu * tangent and mu * u[0] + tangent <= 0:
            weight = d / mu**2
            cost += weight * sum(one**2 for one in u) / 2
            first, second = [weight * one for one in u], weight * _mp.eye(dim)
        elif u[0] < mu * tangent:
            weight, depth = d / (mu**2 * (1 + mu**2)), u[0] - mu * tangent
            cost += weight * depth**2 / 2
            normal = [_mp.mpf(1), *(-mu * one / tangent for one in u[1:])]
            first = [weight * depth * one for one in normal]
            for i in range(dim):
                for j in range(dim):
                    second[i, j] = weight * normal[i] * normal[j]
                    if i > 0 and j > 0:
                        across = (_mp.mpf(i == j) - u[i] * u[j] / tangent**2) / tangent
                        second[i, j] -= weight * depth * mu * across
        for i in range(dim):
            gradient[row + i] = scales[i] * first[i]
            for j in range(dim):
                hessian[row + i, row + j] = scales[i] * scales[j] * second[i, j]
        row += dim
    return cost, gradient, hessian


def oracle(step: Step) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations and forces of inequality rows: Newton's method on accelerations and multipliers, in forty digits.

    Its answer is proved by what is left of the stationarity conditions, whatever the way was.
    """
    M, f = matrix(step.mass), column(step.force)
    kept = independent(step.equalities) if step.softness is None else range(len(step.equalities))
    Je, wanted = matrix(step.equalities[list(kept)]), column(step.wanted[list(kept)])
    Ji, aref = matrix(step.rows.jacobian), column(step.rows.aref)
    nv, n = M.rows, Je.rows
    R = _mp.zeros(n) if step.softness is None else _mp.diag([_mp.mpf(one) for one in step.softness])

    def kkt(hessian):
        system = _mp.zeros(nv + n)
        system[:nv, :nv] = M + Ji.T * hessian * Ji
        system[:nv, nv:], system[nv:, :nv], system[nv:, nv:] = Je.T, Je, -R
        return system

    def solve(system, top, bottom):
        right = _mp.zeros(nv + n, 1)
        right[:nv], right[nv:] = top, bottom
        found = _mp.lu_solve(system, right)
        return found[:nv], found[nv:]

    # The equality answer first, on which every step then stays.
    a, λ = solve(kkt(_mp.zeros(Ji.rows)), f, wanted)

    def merit(a):
        cost, gradient, hessian = law(step, Ji * a - aref)
        away = M * a - f
        energy = (a.T * M * a)[0] / 2 - (a.T * f)[0]
        if step.softness is not None:
            gap = Je * a - wanted
            energy += sum(gap[i] ** 2 / R[i, i] for i in range(n)) / 2
        return energy + cost, away + Ji.T * gradient, gradient, hessian

    for _ in range(STEPS):
        value, slope, gradient, hessian = merit(a)
        down, λ = solve(kkt(hessian), -slope, wanted - Je * a)
        left = slope + M * down + Ji.T * hessian * Ji * down + Je.T * λ
        assert _mp.norm(left) < _mp.mpf(10) ** -30 * (1 + _mp.norm(slope))
        if _mp.norm(down) < _mp.mpf(10) ** -30 * (1 + _mp.norm(a)):
            return np.array([float(one) for one in a]), np.array([-float(one) for one in gradient])
        length = _mp.mpf(1)
        # Near the end the merit is rounding, and whole steps are right.
        far = _mp.norm(down) > _mp.mpf(10) ** -12 * (1 + _mp.norm(a))
        while far and merit(a + length * down)[0] > value and length > _mp.mpf(10) ** -20:
            length /= 2
        a += length * down
    raise AssertionError("the oracle did not end")


@pytest.mark.parametrize("hard", [True, False])
@pytest.mark.parametrize("seed", range(20))
def test_the_answer_is_that_of_forty_digits(seed: int, hard: bool):
    step = random_step(seed, hard=hard)
    whole, (acceleration, forces) = answer(step), oracle(step)
    assert whole.report.status == "converged"
    assert whole.certificate.holds
    for got, right in ((whole.acceleration, acceleration), (whole.forces, forces)):
        np.testing.assert_allclose(got, right, rtol=0, atol=WHOLE_ANSWER * max(1.0, float(np.abs(right).max())))


@pytest.mark.parametrize("solver", ["pinv", "svd", "sr1-tracked", "cg"])
def test_every_equality_solver_answers_beside_them(solver: str):
    for seed in range(20):
        step = random_step(seed, hard=True)
        whole, right = answer(step, solver), answer(step)
        assert whole.certificate.holds or solver in ("sr1-tracked", "cg")
        scale = max(1.0, float(np.abs(right.acceleration).max()))
        # What `converged` promises of a solver that iterates.
        np.testing.assert_allclose(whole.acceleration, right.acceleration, rtol=0, atol=1e-6 * scale)


def test_what_is_no_number_is_named():
    step, inequalities = random_step(0, hard=True), core.Inequalities()
    system = core.ConstrainedSystem()
    system.assemble(step.mass, step.equalities, step.force, step.wanted)
    nv = len(step.force)
    row, one, five = np.ones((1, nv)), np.ones(1), np.ones((1, 5))
    with pytest.raises(core.InputError, match=r"inequality aref\[0\] = NaN, expected finite numbers"):
        inequalities.solve(system, row, row, [np.nan], one, one, [1], one, five)
    with pytest.raises(core.InputError, match=r"stiffness\[0\] = 0, expected a number > 0"):
        inequalities.solve(system, row, row, one, [0.0], one, [1], one, five)
    with pytest.raises(core.InputError, match=r"dim\[0\] = 7, expected 2 to 6 rows of a cone"):
        inequalities.solve(system, row, row, one, one, one, [7], one, five)
    with pytest.raises(core.InputError, match="rows of the groups has shape 1 entries, expected 2"):
        inequalities.solve(system, np.ones((2, nv)), np.ones((2, nv)), [1, 1], [1, 1], [1, 1], [1], one, five)
    with pytest.raises(core.InputError, match="friction is a vector of 1, expected a 1×5 matrix"):
        inequalities.solve(system, row, row, one, one, one, [1], one, one)
    with pytest.raises(core.InputError, match="unconstrained"):
        system.renew(np.full(nv, np.inf), step.wanted)
