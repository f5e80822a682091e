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

import csv
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

CRANK, ROD, GRAVITY = 0.08, 0.3, 9.81
CRANK_MASS, ROD_MASS, SLIDER_MASS = 0.12, 0.5, 2.0
CRANK_INERTIA, ROD_ALONG, ROD_ACROSS = 1e-4, 4e-4, 4e-3
START, DURATION, INTERVAL = (0.0, 6.0), 5.0, 0.00125
RTOL, ATOL = 1e-13, 1e-14
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


def solve(times, rtol=RTOL, atol=ATOL):
    """Angle θ (rad) and θ̇ (rad/s) at the times (s)."""
    solution = solve_ivp(
        lambda _, y: (y[1], acceleration(*y)),
        (0.0, times[-1]),
        START,
        method="DOP853",
        t_eval=times,
        rtol=rtol,
        atol=atol,
    )
    return solution.y


def main():
    """Writes reference.csv beside this file."""
    times = np.arange(round(DURATION / INTERVAL) + 1) * INTERVAL
    with (Path(__file__).parent / "reference.csv").open("w", encoding="utf-8", newline="") as file:
        file.write(f"# reduced equation of motion, DOP853, rtol {RTOL:g}, atol {ATOL:g}; made by reference.py\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time", "position", "velocity", "acceleration"])
        for time, theta, theta_dot in zip(times, *solve(times), strict=True):
            place, first = geometry(theta)[2:]
            second = geometry(theta + 1j * COMPLEX_STEP)[3].imag / COMPLEX_STEP
            row = place, first * theta_dot, second * theta_dot**2 + first * acceleration(theta, theta_dot)
            writer.writerow([f"{time:.5f}", *(f"{value:.16g}" for value in row)])


if __name__ == "__main__":
    main()
