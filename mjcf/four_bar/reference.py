"""Regenerates reference.csv: the four-bar's crank angle from its reduced equation of motion. No MuJoCo, no oarlock.

With crank and coupler end A on its circle, the pin B is where the circle of the coupler about A meets that of the
rocker about its pivot C. The first and second derivatives of B with respect to the crank angle φ follow from

    (B − A)·(B' − A') = 0,   (B − A)·(B'' − A'') = −|B' − A'|²,   and the same with C for A.

They give those of the bars' centres c and angles θ, and these the reduced inertia and the equation of motion:

    m(φ) = Σ mᵢ |c'ᵢ|² + Iᵢ θ'ᵢ²,   m φ̈ = −Σ (mᵢ c'ᵢ·c''ᵢ + Iᵢ θ'ᵢ θ''ᵢ) φ̇² − Σ mᵢ g c'ᵢ,z.

Run: python mjcf/four_bar/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

PIVOT = np.array([0.8, 0.0])
CRANK, COUPLER, ROCKER = 0.3, np.hypot(0.8, 0.3), 0.6
DENSITY, WIDTH, GRAVITY = 2700.0, 0.02, 9.81
START_SPEED = 12.0
DURATION, INTERVAL = 2.0, 0.001


def turned(v):
    """A vector (x, z) turned by +90°."""
    return np.array([-v[1], v[0]])


def dyad(a, b, length_a, length_b):
    """Where two bars from the points a and b meet, to the left of a → b; each point a position with two derivatives."""
    along = b[0] - a[0]
    distance = np.hypot(*along)
    foot = (distance**2 + length_a**2 - length_b**2) / (2 * distance)
    position = a[0] + (foot * along + np.sqrt(length_a**2 - foot**2) * turned(along)) / distance
    bars = np.array([position - a[0], position - b[0]])
    first = np.linalg.solve(bars, [bars[0] @ a[1], bars[1] @ b[1]])
    squares = [(first - a[1]) @ (first - a[1]), (first - b[1]) @ (first - b[1])]
    second = np.linalg.solve(bars, [bars[0] @ a[2] - squares[0], bars[1] @ b[2] - squares[1]])
    return np.array([position, first, second])


def bar(a, b):
    """Mass, inertia, centre (3, 2) and the angle's two derivatives of a square bar between two points."""
    along = b - a
    length = np.hypot(*along[0])
    mass = DENSITY * WIDTH**2 * length
    normal = turned(along[0]) / length**2
    # θ' = n·d' for d = length·(cos θ, sin θ) and n = d⊥/length²; the part of d'' along d⊥ is length² θ''.
    return mass, mass * (length**2 + WIDTH**2) / 12, (a + b) / 2, normal @ along[1], normal @ along[2]


def bars(phi):
    """The three bars at a crank angle (rad) from upright."""
    out = np.array([-np.sin(phi), np.cos(phi)])
    ground, pivot = np.zeros((3, 2)), np.array([PIVOT, [0, 0], [0, 0]])
    a = CRANK * np.array([out, turned(out), -out])
    b = dyad(a, pivot, COUPLER, ROCKER)
    return [bar(ground, a), bar(a, b), bar(pivot, b)]


def acceleration(phi, phi_dot):
    """φ̈ (rad/s²) at φ (rad) and φ̇ (rad/s)."""
    inertia = force = 0.0
    for mass, moment, centre, angle1, angle2 in bars(phi):
        inertia += mass * centre[1] @ centre[1] + moment * angle1**2
        force -= (mass * centre[1] @ centre[2] + moment * angle1 * angle2) * phi_dot**2 + mass * GRAVITY * centre[1, 1]
    return force / inertia


def solve(times):
    """φ and φ̇ at the times (s), from φ = 0 at START_SPEED."""
    return integrate_second(lambda _, *state: acceleration(*state), (0.0, START_SPEED), times)


def main():
    """Writes reference.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    rows = [(*state, acceleration(*state)) for state in solve(times).T]
    write(__file__, "reduced equation of motion", 3, times, rows)


if __name__ == "__main__":
    main()
