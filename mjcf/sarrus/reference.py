"""Regenerates reference-legs=*-cells=1.csv: the angle of Sarrus's lower links. No MuJoCo, no oarlock.

By symmetry every lower link is at one angle φ over the horizontal and every upper one at π − φ, so that the platform is
at z = 2 l sin φ and does not turn. The centres of a leg's links are at (½ l cos φ, ½ l sin φ) and
(½ l cos φ, 3/2 l sin φ) from its base hinge, and both links turn with φ̇. With n legs

    I(φ) = n (½ m l² + 2 m l² cos² φ + 2 J) + 4 M l² cos² φ,
    V(φ) = g (2 n m + 2 M) l sin φ + ½ n k (φ − φ₀)²,
    I φ̈ = −½ I' φ̇² − V'.

Run: python mjcf/sarrus/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

GRAVITY, LINK, WIDTH, LINK_MASS, PLATFORM_MASS = 9.81, 0.5, 0.04, 1.0, 2.0
STIFFNESS, SPRING_ANGLE, START = 60.0, 1.0, 0.4
LINK_INERTIA = LINK_MASS * (LINK**2 + WIDTH**2) / 12
LEGS, DURATION, INTERVAL = (2, 3), 5.0, 0.0025


def acceleration(legs, phi, phi_dot):
    """φ̈ (rad/s²) at φ (rad) and φ̇ (rad/s)."""
    sine, cosine = np.sin(phi), np.cos(phi)
    swept = 2 * LINK**2 * (legs * LINK_MASS + 2 * PLATFORM_MASS)
    inertia = legs * (LINK_MASS * LINK**2 / 2 + 2 * LINK_INERTIA) + swept * cosine**2
    weight = 2 * GRAVITY * (legs * LINK_MASS + PLATFORM_MASS) * LINK * cosine
    spring = legs * STIFFNESS * (phi - SPRING_ANGLE)
    return (swept * cosine * sine * phi_dot**2 - weight - spring) / inertia


def solve(legs, times):
    """Angle φ (rad) and φ̇ (rad/s) at the times (s), from rest."""
    return integrate_second(lambda _, *state: acceleration(legs, *state), (START, 0.0), times)


def main():
    """Writes the two tables beside this file."""
    times = grid(DURATION, INTERVAL)
    for legs in LEGS:
        phi, phi_dot = solve(legs, times)
        rows = np.column_stack([phi, phi_dot, acceleration(legs, phi, phi_dot)])
        write(__file__, "reduced equation of motion", 4, times, rows, name=f"reference-legs={legs}-cells=1.csv")


if __name__ == "__main__":
    main()
