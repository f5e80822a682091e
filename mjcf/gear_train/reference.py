"""Regenerates reference.csv: the driver's angle from the reduced equation of motion. No MuJoCo, no oarlock.

With the driver's angle x, the follower turns by p(x) and the last wheel by −1.5 p(x), p = x + x²/4 − x³/20 + x⁴/50.
Energy is ½ M(x) ẋ² + V(x), so that M ẍ + ½ M' ẋ² + V' = 0, with

    M = I₀ + (I₁ + 1.5² I₂) p'²,   V = −g (m₀ r₀ cos x + m₁ r₁ cos p − m₂ r₂ sin(−1.5 p)),

the first two weights hanging below their shafts at x = 0, the third standing out to the side.

Run: python mjcf/gear_train/reference.py
"""

import sys
from pathlib import Path

import numpy as np
from numpy.polynomial import Polynomial

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

MASSES, ARMS, INERTIAS = (2.0, 1.5, 0.5), (0.1, 0.08, 0.06), (0.02, 0.015, 0.004)
"""kg; m from the shaft to the centre of mass; kg m² about the centre of mass."""
GRAVITY, RATIO, START = 9.81, -1.5, 1.0
MESH = Polynomial([0.0, 1.0, 0.25, -0.05, 0.02])
DURATION, INTERVAL = 8.0, 0.005

ABOUT_SHAFT = [inertia + mass * arm**2 for mass, arm, inertia in zip(MASSES, ARMS, INERTIAS, strict=True)]
WEIGHTS = [GRAVITY * mass * arm for mass, arm in zip(MASSES, ARMS, strict=True)]
FIRST, SECOND = MESH.deriv(1), MESH.deriv(2)


def acceleration(x, rate):
    """ẍ (rad/s²) at x (rad) and ẋ (rad/s)."""
    angle, slope = MESH(x), FIRST(x)
    coupled = ABOUT_SHAFT[1] + RATIO**2 * ABOUT_SHAFT[2]
    inertia = ABOUT_SHAFT[0] + coupled * slope**2
    inertia_slope = 2.0 * coupled * slope * SECOND(x)
    # The third weight is at height r sin of its angle.
    fall = WEIGHTS[0] * np.sin(x) + slope * (WEIGHTS[1] * np.sin(angle) + WEIGHTS[2] * RATIO * np.cos(RATIO * angle))
    return -(0.5 * inertia_slope * rate**2 + fall) / inertia


def solve(times):
    """Angle x and rate ẋ at the times (s), from rest at x = 1."""
    return integrate_second(lambda _, *state: acceleration(*state), (START, 0.0), times)


def main():
    """Writes reference.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    x, rate = solve(times)
    write(__file__, "reduced equation of motion", 4, times, np.column_stack([x, rate, acceleration(x, rate)]))


if __name__ == "__main__":
    main()
