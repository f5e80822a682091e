"""Regenerates reference-N=*-apart=0.csv: the first crank's top, by the equation of one crank. No MuJoCo, no oarlock.

On the parallelogram branch all cranks turn alike, by θ from the upright to the right, and the couplers stay level.
With rods of length l = 1 m and mass m = 1 kg the N + 1 cranks have ⅓ m l² each about their pivots, and each of the N
couplers moves as a point at a crank's top:

    (⅓ (N + 1) + N) θ̈ = g (½ (N + 1) + N) sin θ,     θ(0) = 0,   θ̇(0) = 1 /s.

Its energy integral θ̇² = 1 + 2k (1 − cos θ) is the check: the integration must hold it. The place of the top is
(sin θ, cos θ, 0).

Run: python mjcf/n_four_bar/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

LOOPS = (1, 2, 10, 40)
GRAVITY, RATE = 9.81, 1.0
DURATION, INTERVAL = 10.0, 0.01
HELD = 1e-10
"""Of the energy integral, 1/s², where θ̇² reaches 46: what the tolerances leave over 10 s, with room."""


def factor(loops):
    """The k of θ̈ = k sin θ, 1/s²."""
    return GRAVITY * ((loops + 1) / 2 + loops) / ((loops + 1) / 3 + loops)


def solve(loops, times):
    """θ (rad) and θ̇ (rad/s) at the times (s)."""
    k = factor(loops)
    return integrate_second(lambda _, theta, __: k * np.sin(theta), (0.0, RATE), times)


def rows(loops, times):
    """Place, velocity and acceleration of the top, (n, 9), in m, at the times (s)."""
    theta, rate = solve(loops, times)
    k, sin, cos, flat = factor(loops), np.sin(theta), np.cos(theta), np.zeros_like(theta)
    held = np.abs(rate**2 - RATE**2 - 2 * k * (1 - cos)).max()
    if held > HELD:
        raise ArithmeticError(f"energy integral off by {held:.2e} for N = {loops}, expected at most {HELD:g}")
    place = [sin, cos, flat]
    velocity = [rate * cos, -rate * sin, flat]
    acceleration = [k * sin * cos - rate**2 * sin, -k * sin * sin - rate**2 * cos, flat]
    return np.column_stack([*place, *velocity, *acceleration])


def main():
    """Writes reference-N=*-apart=0.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    for loops in LOOPS:
        write(__file__, "θ'' = k sin θ", 2, times, rows(loops, times), name=f"reference-N={loops}-apart=0.csv")


if __name__ == "__main__":
    main()
