"""Regenerates reference.csv: the slider's place from the reduced equation of motion. No MuJoCo, no oarlock.

With B = (0, 0.1 − r sin θ, 0.12 + r cos θ) the end of the crank and l the rod's length, the slider is at

    s = √(l² − B_y² − B_z²),

and the rod runs along u = (B − (s, 0, 0))/l. The universal joint has its first axis e along the slide and its second
across e and u: ω = α̇ e + β̇ e × u/|e × u|, so that α̇ = u̇·(e × u)/|e × u|², and the rod spins about itself with α̇ e·u.
All velocities are functions of θ times θ̇; with the kinetic energy ½ I(θ) θ̇²,

    I θ̈ = −½ I' θ̇² − V'.

I' comes from a complex step, I'(θ) = Im I(θ + iε)/ε, which is exact to rounding.

Run: python mjcf/spatial_slider_crank/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

CRANK, ROD, GRAVITY = 0.08, 0.3, 9.81
CRANK_MASS, ROD_MASS, SLIDER_MASS = 0.12, 0.5, 2.0
CRANK_INERTIA, ROD_ALONG, ROD_ACROSS = 1e-4, 4e-4, 4e-3
START, DURATION, INTERVAL = (0.0, 6.0), 5.0, 0.00125
COMPLEX_STEP = 1e-30

SLIDE = np.array([1.0, 0.0, 0.0])


def geometry(theta):
    """B (m), its derivative, s (m) and its derivative, at θ (rad)."""
    sine, cosine = np.sin(theta), np.cos(theta)
    end = np.array([0.0, 0.1 - CRANK * sine, 0.12 + CRANK * cosine])
    slope = np.array([0.0, -CRANK * cosine, -CRANK * sine])
    place = np.sqrt(ROD**2 - end @ end)
    return end, slope, place, -(end @ slope) / place


def inertia(theta):
    """I (kg m²) at θ."""
    end, end_slope, place, place_slope = geometry(theta)
    direction = (end - place * SLIDE) / ROD
    turning = (end_slope - place_slope * SLIDE) / ROD
    across = np.cross(SLIDE, direction)
    spin = (turning @ across) / (across @ across) * (SLIDE @ direction)
    centre = (end_slope + place_slope * SLIDE) / 2
    return (
        CRANK_INERTIA
        + CRANK_MASS * (CRANK / 2) ** 2
        + SLIDER_MASS * place_slope**2
        + ROD_MASS * (centre @ centre)
        + ROD_ACROSS * (turning @ turning)
        + ROD_ALONG * spin**2
    )


def acceleration(theta, theta_dot):
    """θ̈ (rad/s²) at θ (rad) and θ̇ (rad/s)."""
    shifted = inertia(theta + 1j * COMPLEX_STEP)
    weight = -GRAVITY * (CRANK_MASS + ROD_MASS) * CRANK / 2 * np.sin(theta)
    return (-0.5 * shifted.imag / COMPLEX_STEP * theta_dot**2 - weight) / shifted.real


def solve(times):
    """Angle θ (rad) and θ̇ (rad/s) at the times (s)."""
    return integrate_second(lambda _, *state: acceleration(*state), START, times)


def main():
    """Writes reference.csv beside this file."""
    times, rows = grid(DURATION, INTERVAL), []
    for theta, theta_dot in solve(times).T:
        place, first = geometry(theta)[2:]
        second = geometry(theta + 1j * COMPLEX_STEP)[3].imag / COMPLEX_STEP
        rows.append([place, first * theta_dot, second * theta_dot**2 + first * acceleration(theta, theta_dot)])
    write(__file__, "reduced equation of motion", 5, times, rows)


if __name__ == "__main__":
    main()
