"""Regenerates reference.csv: the crank angle of the triple crank, which is a pendulum. No MuJoCo, no oarlock.

The plate translates on its cranks, so every point of it moves as the end of a crank does: the three cranks and the
plate, together at their common end, are one pendulum. With φ from upright, M the plate's and m a crank's mass, square
bars of length r and width w:

    I φ̈ = (3 m r/2 + M r) g sin φ,   I = 3 m (r²/3 + w²/12) + M r².

Run: python mjcf/triple_crank/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

RADIUS = 0.2
EDGES = 0.6 + np.hypot(0.4, 0.3) + np.hypot(0.2, 0.3)
DENSITY, WIDTH, GRAVITY = 2700.0, 0.02, 9.81
START_SPEED = 8.0
DURATION, INTERVAL = 5.0, 0.0025

CRANK_MASS, PLATE_MASS = DENSITY * WIDTH**2 * RADIUS, DENSITY * WIDTH**2 * EDGES
INERTIA = 3 * CRANK_MASS * (RADIUS**2 / 3 + WIDTH**2 / 12) + PLATE_MASS * RADIUS**2
WEIGHT = (1.5 * CRANK_MASS + PLATE_MASS) * RADIUS * GRAVITY


def acceleration(phi):
    """φ̈ (rad/s²) at φ (rad)."""
    return WEIGHT / INERTIA * np.sin(phi)


def solve(times):
    """φ and φ̇ at the times (s), from φ = 0 at START_SPEED."""
    return integrate_second(lambda _, phi, __: acceleration(phi), (0.0, START_SPEED), times)


def main():
    """Writes reference.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    phi, phi_dot = solve(times)
    write(__file__, "pendulum equation", 4, times, np.column_stack([phi, phi_dot, acceleration(phi)]))


if __name__ == "__main__":
    main()
