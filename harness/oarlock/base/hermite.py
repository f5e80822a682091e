"""Quintic Hermite polynomials: a curve through knots that also has the given first and second derivatives there."""

import numpy as np


class QuinticHermite:
    """Interpolates on every interval by the quintic with the value, velocity and acceleration of both ends.

    The polynomials are in Bernstein's basis. The ends give its coefficients in closed form, and these are of the size
    of the curve's own values, so that nothing large cancels. Horner's scheme uses sums and products only, so the result
    is the same on every machine.

    Args:
        knots: rising places (n,).
        values: value and first two derivatives at the knots (n, 3, components).
    """

    def __init__(self, knots: np.ndarray, values: np.ndarray):
        self._knots = knots
        self._widths = np.diff(knots)
        width = self._widths[:, None]
        position, velocity, acceleration = values[:-1].swapaxes(0, 1)
        c0 = position
        c1 = c0 + velocity / 5 * width
        c2 = 2 * c1 - c0 + acceleration / 20 * width**2
        position, velocity, acceleration = values[1:].swapaxes(0, 1)
        c5 = position
        c4 = c5 - velocity / 5 * width
        c3 = 2 * c4 - c5 + acceleration / 20 * width**2
        self._terms = (c0, 5 * c1, 10 * c2, 10 * c3, 5 * c4, c5)

    def __call__(self, at: np.ndarray) -> np.ndarray:
        """Evaluates the curve (m, components) at m places between the first and the last knot."""
        interval = np.clip(self._knots.searchsorted(at, side="right") - 1, 0, len(self._widths) - 1)
        share = ((at - self._knots[interval]) / self._widths[interval])[:, None]
        value, rest, power = self._terms[0][interval], 1 - share, share
        for term in self._terms[1:]:
            value = value * rest + term[interval] * power
            power = power * share
        return value
