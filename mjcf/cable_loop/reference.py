"""Regenerates reference.csv: the arm's angle from its reduced equation of motion. No MuJoCo, no oarlock.

About the drum's centre the right end of the arm has the polar coordinates ρ, α. The cable goes round the drum
clockwise and leaves it straight down at angle 0, so its length between the arm's end and there is

    L = √(ρ² − r²) + r (α − arccos(r/ρ)),

and the first weight stands at L(θ) − L(0). The left cable is D(θ) long between the arm's end and the ring; at two to
one the second weight stands at 2 (D(θ) − D(0)). With u = L and w = 2 D as functions of θ,

    (I + m₁ u'² + m₂ w'²) θ̈ + (m₁ u' u'' + m₂ w' w'') θ̇² + g (m c sin θ + m₁ u' + m₂ w') = 0.

Run: python mjcf/cable_loop/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

RIGHT, LEFT = 0.5, 0.4
DRUM, RADIUS, RING = (0.9, 0.9), 0.15, (-0.7, 0.8)
ARM_MASS, ARM_CENTRE, ARM_INERTIA = 2.0, 0.1, 0.28
MASSES, GRAVITY, START = (1.6, 1.0), 9.81, 0.5
DURATION, INTERVAL = 8.0, 0.005


def _end(theta, arm, centre):
    """The end of an arm seen from a centre: x, z and their first two derivatives by θ."""
    x, z = arm * np.cos(theta), arm * np.sin(theta)
    return (x - centre[0], -z, -x), (z - centre[1], x, -z)


def _distance(x, z):
    """√(x² + z²) and its first two derivatives."""
    rho = np.hypot(x[0], z[0])
    first = (x[0] * x[1] + z[0] * z[1]) / rho
    second = (x[1] ** 2 + x[0] * x[2] + z[1] ** 2 + z[0] * z[2] - first**2) / rho
    return rho, first, second


def over_drum(theta):
    """L (m) and its first two derivatives by θ."""
    x, z = _end(theta, RIGHT, DRUM)
    rho, rho1, rho2 = _distance(x, z)
    free = np.sqrt(rho**2 - RADIUS**2)
    alpha = np.arctan2(z[0], x[0]) % (2 * np.pi)
    alpha1 = (x[0] * z[1] - z[0] * x[1]) / rho**2
    alpha2 = (x[0] * z[2] - z[0] * x[2]) / rho**2 - 2 * alpha1 * rho1 / rho
    length = free + RADIUS * (alpha - np.arccos(RADIUS / rho))
    first = free / rho * rho1 + RADIUS * alpha1
    second = free / rho * rho2 + RADIUS**2 / (rho**2 * free) * rho1**2 + RADIUS * alpha2
    return length, first, second


def to_ring(theta):
    """D (m) and its first two derivatives by θ."""
    return _distance(*_end(theta, -LEFT, RING))


def weights(theta):
    """Heights of the two weights above where they stand at θ = 0, m."""
    return over_drum(theta)[0] - over_drum(0.0)[0], 2 * (to_ring(theta)[0] - to_ring(0.0)[0])


def acceleration(theta, rate):
    """θ̈ (rad/s²) at θ (rad) and θ̇ (rad/s)."""
    _, u1, u2 = over_drum(theta)
    _, w1, w2 = (2 * value for value in to_ring(theta))
    m1, m2 = MASSES
    inertia = ARM_INERTIA + ARM_MASS * ARM_CENTRE**2 + m1 * u1**2 + m2 * w1**2
    weight = GRAVITY * (ARM_MASS * ARM_CENTRE * np.sin(theta) + m1 * u1 + m2 * w1)
    return -((m1 * u1 * u2 + m2 * w1 * w2) * rate**2 + weight) / inertia


def solve(times):
    """θ and θ̇ at the times (s), from rest at θ = 0.5."""
    return integrate_second(lambda _, *state: acceleration(*state), (START, 0.0), times)


def main():
    """Writes reference.csv beside this file, and prints the start of case.toml."""
    times = grid(DURATION, INTERVAL)
    theta, rate = solve(times)
    rows = np.column_stack([theta, rate, acceleration(theta, rate)])
    write(__file__, "reduced equation of motion", 4, times, rows)
    first, second = weights(START)
    print(f"arm = {START:g}, weight = {first:.16g}, counterweight = {second:.16g}")


if __name__ == "__main__":
    main()
