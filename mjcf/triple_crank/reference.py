"""Regenerates reference.csv: the crank angle of the triple crank, which is a pendulum. No MuJoCo, no oarlock.

The plate translates on its cranks, so every point of it moves as the end of a crank does: the three cranks and the
plate, together at their common end, are one pendulum. With φ from upright, M the plate's and m a crank's mass, square
bars of length r and width w:

    I φ̈ = (3 m r/2 + M r) g sin φ,   I = 3 m (r²/3 + w²/12) + M r².

Run: python mjcf/triple_crank/reference.py
"""

import csv
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

RADIUS = 0.2
EDGES = 0.6 + np.hypot(0.4, 0.3) + np.hypot(0.2, 0.3)
DENSITY, WIDTH, GRAVITY = 2700.0, 0.02, 9.81
START_SPEED = 8.0
DURATION, INTERVAL = 5.0, 0.0025
RTOL, ATOL = 1e-13, 1e-14

CRANK_MASS, PLATE_MASS = DENSITY * WIDTH**2 * RADIUS, DENSITY * WIDTH**2 * EDGES
INERTIA = 3 * CRANK_MASS * (RADIUS**2 / 3 + WIDTH**2 / 12) + PLATE_MASS * RADIUS**2
WEIGHT = (1.5 * CRANK_MASS + PLATE_MASS) * RADIUS * GRAVITY


def acceleration(phi):
    """φ̈ (rad/s²) at φ (rad)."""
    return WEIGHT / INERTIA * np.sin(phi)


def solve(times, rtol=RTOL, atol=ATOL):
    """φ and φ̇ at the times (s), from φ = 0 at START_SPEED."""
    solution = solve_ivp(
        lambda _, y: (y[1], acceleration(y[0])),
        (0.0, times[-1]),
        (0.0, START_SPEED),
        method="DOP853",
        t_eval=times,
        rtol=rtol,
        atol=atol,
    )
    return solution.y


def main():
    """Writes reference.csv beside this file."""
    times = np.arange(round(DURATION / INTERVAL) + 1) * INTERVAL
    phi, phi_dot = solve(times)
    with (Path(__file__).parent / "reference.csv").open("w", encoding="utf-8", newline="") as file:
        file.write(f"# pendulum equation, DOP853, rtol {RTOL:g}, atol {ATOL:g}; made by reference.py\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time", "position", "velocity", "acceleration"])
        for time, *values in zip(times, phi, phi_dot, acceleration(phi), strict=True):
            writer.writerow([f"{time:.4f}", *(f"{value:.16g}" for value in values)])


if __name__ == "__main__":
    main()
