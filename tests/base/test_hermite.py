"""Quintic Hermite polynomials against SciPy's, and against polynomials that they must give back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oarlock.base.hermite import QuinticHermite
from oarlock.cases.case import MODELS
from scipy.interpolate import BPoly
from tolerances import HERMITE

TABLES = sorted(MODELS.glob("*/reference*.csv"))


def apart(curve, expected, scale):
    return np.abs(curve - expected).max() / scale


@pytest.mark.parametrize("path", TABLES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_values_are_scipys(path):
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line[0] in "0123456789-"]
    table = np.loadtxt(lines, delimiter=",")
    knots, values = table[:, 0], table[:, 1:].reshape(len(table), 3, -1)
    at = np.sort(np.random.default_rng(0).uniform(knots[0], knots[-1], 10_000))
    expected = BPoly.from_derivatives(knots, values)(at)
    scale = np.abs(values[:, 0]).max() or 1.0  # what rests at 0 is as good as a length of 1
    assert apart(QuinticHermite(knots, values)(at), expected, scale) <= HERMITE


def test_knots_come_back_exactly():
    rng = np.random.default_rng(1)
    knots, values = np.cumsum(rng.uniform(0.1, 2.0, 50)), rng.normal(size=(50, 3, 3))
    np.testing.assert_array_equal(QuinticHermite(knots, values)(knots), values[:, 0])


finite = st.floats(-10, 10, allow_subnormal=False)


@given(
    coefficients=st.lists(finite, min_size=6, max_size=6),
    begin=st.floats(-5, 5),
    widths=st.lists(st.floats(0.01, 2), min_size=1, max_size=5),
)
def test_polynomials_of_degree_five_are_given_back(coefficients, begin, widths):
    polynomial = np.polynomial.Polynomial(coefficients)
    knots = np.cumsum([begin, *widths])
    values = np.stack([polynomial(knots), polynomial.deriv()(knots), polynomial.deriv(2)(knots)], axis=1)[:, :, None]
    at = np.linspace(knots[0], knots[-1], 101)
    reach = np.abs(knots).max() + 1.0
    # What the terms add up to before they cancel.
    scale = 1.0 + sum(abs(factor) * reach**power for power, factor in enumerate(coefficients))
    assert apart(QuinticHermite(knots, values)(at)[:, 0], polynomial(at), scale) <= HERMITE


def test_velocity_and_acceleration_at_the_knots_are_those_given():
    rng = np.random.default_rng(2)
    knots, values = np.arange(4.0), rng.normal(size=(4, 3, 2))
    curve, h = QuinticHermite(knots, values), 1e-3
    for knot, (position, velocity, acceleration) in zip(knots[:-1], values[:-1], strict=True):
        expected = position + velocity * h + acceleration * h**2 / 2
        np.testing.assert_allclose(curve(np.array([knot + h]))[0], expected, atol=1e-7)  # the rest is of h³
    for knot, (position, velocity, acceleration) in zip(knots[1:], values[1:], strict=True):
        expected = position - velocity * h + acceleration * h**2 / 2
        np.testing.assert_allclose(curve(np.array([knot - h]))[0], expected, atol=1e-7)


def test_the_last_knot_belongs_to_the_last_interval():
    curve = QuinticHermite(np.array([0.0, 1.0]), np.array([[[0.0], [1.0], [0.0]], [[1.0], [1.0], [0.0]]]))
    np.testing.assert_allclose(curve(np.array([0.0, 0.25, 1.0]))[:, 0], [0.0, 0.25, 1.0], rtol=0, atol=HERMITE)
    assert np.isnan(curve(np.array([np.nan]))).all()
