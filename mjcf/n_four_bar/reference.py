"""Regenerates reference-N=*.csv: the top of the first crank, from the equation of one crank. No MuJoCo, no oarlock.

On the parallelogram branch all cranks turn alike, by θ from the upright to the right, and the couplers stay level.
With rods of length l = 1 m and mass m = 1 kg the N + 1 cranks have ⅓ m l² each about their pivots, and each of the N
couplers moves as a point at a crank's top:

    (⅓ (N + 1) + N) θ̈ = g (½ (N + 1) + N) sin θ,     θ(0) = 0,   θ̇(0) = 1 /s.

Its energy integral θ̇² = 1 + 2k (1 − cos θ) is the check: the integration must hold it. The place of the top is
(sin θ, cos θ, 0).

Run: python mjcf/n_four_bar/reference.py
"""

import csv
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

LOOPS = (1, 2, 10, 40)
GRAVITY, RATE = 9.81, 1.0
DURATION, INTERVAL = 10.0, 0.01
RTOL, ATOL = 1e-13, 1e-14
HELD = 1e-10
"""Of the energy integral, 1/s², where θ̇² reaches 46: what RTOL leaves over 10 s, with room."""
COLUMNS = ["time", "x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az"]


def factor(loops):
    """The k of θ̈ = k sin θ, 1/s²."""
    return GRAVITY * ((loops + 1) / 2 + loops) / ((loops + 1) / 3 + loops)


def solve(loops, times, rtol=RTOL, atol=ATOL):
    """θ (rad) and θ̇ (rad/s) at the times (s)."""
    k = factor(loops)
    solution = solve_ivp(
        lambda t, y: (y[1], k * np.sin(y[0])),
        (0.0, times[-1]),
        (0.0, RATE),
        method="DOP853",
        t_eval=times,
        rtol=rtol,
        atol=atol,
    )
    return solution.y


def rows(loops, times):
    """Time, place, velocity and acceleration of the top, (n, 10), in s and m."""
    theta, rate = solve(loops, times)
    k, sin, cos, flat = factor(loops), np.sin(theta), np.cos(theta), np.zeros_like(theta)
    held = np.abs(rate**2 - RATE**2 - 2 * k * (1 - cos)).max()
    if held > HELD:
        raise ArithmeticError(f"energy integral off by {held:.2e} for N = {loops}, expected at most {HELD:g}")
    place = [sin, cos, flat]
    velocity = [rate * cos, -rate * sin, flat]
    acceleration = [k * sin * cos - rate**2 * sin, -k * sin * sin - rate**2 * cos, flat]
    return np.column_stack([times, *place, *velocity, *acceleration])


def main():
    """Writes reference-N=*.csv beside this file."""
    times = np.arange(round(DURATION / INTERVAL) + 1) * INTERVAL
    for loops in LOOPS:
        path = Path(__file__).parent / f"reference-N={loops}.csv"
        with path.open("w", encoding="utf-8", newline="") as file:
            file.write(f"# θ'' = k sin θ, DOP853, rtol {RTOL:g}, atol {ATOL:g}; made by reference.py\n")
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(COLUMNS)
            for row in rows(loops, times):
                writer.writerow([f"{row[0]:.2f}", *(f"{value:.16g}" for value in row[1:])])


if __name__ == "__main__":
    main()
