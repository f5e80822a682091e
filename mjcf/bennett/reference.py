"""Regenerates reference.csv: the first angle of the Bennett linkage. No MuJoCo, no oarlock.

With a/sin α = b/sin β the ring closes for θ₃ = −θ₁, θ₄ = −θ₂ and

    tan(θ₁/2) tan(θ₂/2) = κ = sin((β + α)/2)/sin((β − α)/2),   dθ₂/dθ₁ = −κ/(sin²(θ₁/2) + κ² cos²(θ₁/2)).

Every link's velocity is a function of θ₁ times its rate. With the kinetic energy ½ I(θ₁) θ̇₁² one equation is left:

    I θ̈₁ = −½ I' θ̇₁² − V'.

I' comes from a complex step, I'(θ) = Im I(θ + iε)/ε, which is exact to rounding.

Run: python mjcf/bennett/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

LENGTHS, TWISTS = (0.5, 1.0, 0.5), (np.pi / 6, np.pi / 2, np.pi / 6)
MASSES, WIDTH, GRAVITY = (1.0, 2.0, 1.0), 0.04, 9.81
START, DURATION, INTERVAL = (np.pi / 2, 3.0), 10.0, 0.005
COMPLEX_STEP = 1e-30

RATIO = np.sin((TWISTS[1] + TWISTS[0]) / 2) / np.sin((TWISTS[1] - TWISTS[0]) / 2)


def turn(cosine, sine):
    """Rotation matrix about z."""
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])


def twist(angle):
    """Rotation matrix about x."""
    return np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])


def joints(theta):
    """Cosine, sine and rate (to θ₁) of the first three joints at θ₁ (rad), which may be complex."""
    sine, cosine = np.sin(theta / 2), np.cos(theta / 2)
    square = sine**2 + RATIO**2 * cosine**2
    first = np.cos(theta), np.sin(theta)
    second = (sine**2 - RATIO**2 * cosine**2) / square, 2 * RATIO * sine * cosine / square
    return (*first, 1.0), (*second, -RATIO / square), (first[0], -first[1], -1.0)


def chain(theta):
    """Where link 3 ends (m), the direction of joint 4 there, I (kg m²) and V' (J/rad) at θ₁."""
    frame, point, omega, velocity = np.eye(3, dtype=complex), *np.zeros((3, 3), dtype=complex)
    inertia, slope = 0.0, 0.0
    for (cosine, sine, rate), length, angle, mass in zip(joints(theta), LENGTHS, TWISTS, MASSES, strict=True):
        omega = omega + rate * frame[:, 2]
        frame = frame @ turn(cosine, sine)
        arm = length * frame[:, 0]
        centre = velocity + np.cross(omega, arm / 2)
        along, around = omega @ frame[:, 0], omega @ omega
        across = mass * (length**2 + WIDTH**2) / 12
        inertia = inertia + mass * (centre @ centre) + across * (around - along**2) + mass * WIDTH**2 / 6 * along**2
        slope = slope + GRAVITY * mass * centre[2]
        point, velocity = point + arm, velocity + np.cross(omega, arm)
        frame = frame @ twist(angle)
    return point, frame[:, 2], inertia, slope


def acceleration(theta, theta_dot):
    """Second derivative of θ₁ (rad/s²) at θ₁ (rad) and its rate (rad/s)."""
    *_, inertia, slope = chain(theta + 1j * COMPLEX_STEP)
    return (-0.5 * inertia.imag / COMPLEX_STEP * theta_dot**2 - slope.real) / inertia.real


def solve(times):
    """Angle θ₁ (rad) and its rate (rad/s) at the times (s)."""
    return integrate_second(lambda _, *state: acceleration(*state), START, times)


def main():
    """Writes reference.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    rows = [(*state, acceleration(*state)) for state in solve(times).T]
    write(__file__, "reduced equation of motion", 4, times, rows)


if __name__ == "__main__":
    main()
