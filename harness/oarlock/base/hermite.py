"""Quintic Hermite polynomials: a curve through knots that has their first two derivatives too."""

import numpy as np


class QuinticHermite:
    """On every interval the polynomial of degree five that has value, velocity and acceleration of both its ends.

    In Bernstein's basis, whose coefficients the ends give in closed form, all of the size of the curve's own values:
    nothing large cancels. Evaluated by Horner's scheme, of sums and products only, it is the same on every machine.

    Args:
        knots: (n,), rising.
        values: (n, derivative 0 to 2, component).
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
        """The curve at n points between the first and the last knot, (n, component)."""
        interval = np.clip(self._knots.searchsorted(at, side="right") - 1, 0, len(self._widths) - 1)
        share = ((at - self._knots[interval]) / self._widths[interval])[:, None]
        value, rest, power = self._terms[0][interval], 1 - share, share
        for term in self._terms[1:]:
            value = value * rest + term[interval] * power
            power = power * share
        return value
