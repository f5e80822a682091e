"""Regenerates reference.csv: the joint P3 of the rectangular Bricard mechanism. No MuJoCo, no oarlock.

The ring closes for q₁ = q₃ = q₅ = a and q₂ = q₄ = b with sin b = −sin a/(1 + sin a), so that P3, the far end
of rod 2, is

    x = cos a/(1 + sin a),   y = −√(1 + 2 sin a)/(1 + sin a),   z = −sin a/(1 + sin a).

What is left is one equation for a. With every rod's velocity a function of a times ȧ, the kinetic energy is ½ I(a) ȧ²:

    I ä = −½ I' ȧ² − V'.

I' comes from a complex step, I'(a) = Im I(a + iε)/ε, which is exact to rounding.

Run: python mjcf/bricard/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

GRAVITY, ACROSS, ALONG = 9.81, 1.01 / 12, 0.02 / 12
DURATION, INTERVAL = 10.0, 0.01
COMPLEX_STEP = 1e-30

AXES = np.eye(3)[[1, 2, 0, 1, 2]]
"""Axes of the joints 1 to 5, in the frame of the rod before."""
RODS = np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1], [-1, 0, 0], [0, 1, 0]], dtype=float)
"""The rods 1 to 5, from joint to joint, in their own frames (m)."""


def rotation(axis, cosine, sine):
    """Rotation matrix about a unit axis (Rodrigues)."""
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + sine * cross + (1 - cosine) * cross @ cross


def chain(a):
    """End of rod 5, I (kg m²) and V' (J/rad) at a (rad), which may be complex."""
    s, c = np.sin(a), np.cos(a)
    root = np.sqrt(1 + 2 * s)
    odd = c, s, 1.0
    even = root / (1 + s), -s / (1 + s), -c / ((1 + s) * root)
    frame, point, omega, velocity = np.eye(3, dtype=complex), *np.zeros((3, 3), dtype=complex)
    inertia, slope = 0.0, 0.0
    for axis, rod, (cosine, sine, rate) in zip(AXES, RODS, (odd, even, odd, even, odd), strict=True):
        omega = omega + rate * (frame @ axis)
        frame = frame @ rotation(axis, cosine, sine)
        arm = frame @ rod
        centre = velocity + np.cross(omega, arm / 2)
        along = omega @ arm
        inertia = inertia + centre @ centre + ACROSS * (omega @ omega) + (ALONG - ACROSS) * along**2
        slope = slope + GRAVITY * centre[1]
        point, velocity = point + arm, velocity + np.cross(omega, arm)
    return point, inertia, slope


def acceleration(a, a_dot):
    """ä (rad/s²) at a (rad) and ȧ (rad/s)."""
    _, inertia, slope = chain(a + 1j * COMPLEX_STEP)
    return (-0.5 * inertia.imag / COMPLEX_STEP * a_dot**2 - slope.real) / inertia.real


def solve(times):
    """Angle a (rad) and ȧ (rad/s) at the times (s), from rest at a = 0."""
    return integrate_second(lambda _, *state: acceleration(*state), (0.0, 0.0), times)


def place(a):
    """P3 (m) at a (rad), and its first and second derivative to a."""

    def slopes(a):
        s, c = np.sin(a), np.cos(a)
        return np.array([-1 / (1 + s), c * s / (np.sqrt(1 + 2 * s) * (1 + s) ** 2), -c / (1 + s) ** 2])

    s = np.sin(a)
    point = np.array([np.cos(a), -np.sqrt(1 + 2 * s), -s]) / (1 + s)
    return point, slopes(a), slopes(a + 1j * COMPLEX_STEP).imag / COMPLEX_STEP


def main():
    """Writes reference.csv beside this file."""
    times, rows = grid(DURATION, INTERVAL), []
    for a, a_dot in solve(times).T:
        point, first, second = place(a)
        rows.append([*point, *(first * a_dot), *(second * a_dot**2 + first * acceleration(a, a_dot))])
    write(__file__, "reduced equation of motion", 2, times, rows)


if __name__ == "__main__":
    main()
