"""Regenerates reference.csv: the gripper's crank angle from its reduced equation of motion. No MuJoCo, no oarlock.

Both fingers mirror one another at all times, so that one crank angle φ says where everything is: the gripper is two
equal fingers, each with half the motor's torque τ(t). The coupler's end B is where the circle of the coupler about A
meets that of the rocker about its pivot C; its first and second derivatives by φ follow from

    (B − A)·(B' − A') = 0,   (B − A)·(B'' − A'') = −|B' − A'|²,   and the same with C for A.

The fingertip T is fixed to the coupler. The derivatives of the bars' centres c and angles θ give

    m(φ) = Σ mᵢ |c'ᵢ|² + Iᵢ θ'ᵢ²,   m φ̈ = τ/2 − Σ (mᵢ c'ᵢ·c''ᵢ + Iᵢ θ'ᵢ θ''ᵢ) φ̇² − Σ mᵢ g c'ᵢ,z

with the sums over the four bars of one finger.

Run: python mjcf/gripper/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

PIVOT, A, B, C, T = np.array([[0.13, 0.0], [0.17, -0.08], [0.13, -0.10], [0.10, -0.01], [0.10, -0.19]])
"""m, (x, z), of the right finger at φ = 0."""
DENSITY, WIDTH, GRAVITY = 2700.0, 0.01, 9.81
TORQUE, OMEGA = 0.004, 4.0 * np.pi
DURATION, INTERVAL = 4.0, 0.004


def turned(v):
    """A vector (x, z) turned by +90°."""
    return np.array([-v[1], v[0]])


def coupler_end(a):
    """B from A, each a position with its two derivatives, (3, 2)."""
    along = C - a[0]
    distance = np.hypot(*along)
    coupler, rocker = np.hypot(*(B - A)), np.hypot(*(B - C))
    foot = (distance**2 + coupler**2 - rocker**2) / (2 * distance)
    position = a[0] + (foot * along + np.sqrt(coupler**2 - foot**2) * turned(along)) / distance
    bars = np.array([position - a[0], position - C])
    first = np.linalg.solve(bars, [bars[0] @ a[1], 0.0])
    second = np.linalg.solve(bars, [bars[0] @ a[2] - (first - a[1]) @ (first - a[1]), -first @ first])
    return np.array([position, first, second])


def fingertip(a, b):
    """T, which stands to B − A as it does in the drawing."""
    drawn, tip = B - A, T - A
    along, across = tip @ drawn / (drawn @ drawn), tip @ turned(drawn) / (drawn @ drawn)
    return np.array([start + along * way + across * turned(way) for start, way in zip(a, b - a, strict=True)])


def bar(a, b):
    """Mass, inertia, centre (3, 2) and the angle's two derivatives of a square bar between two points."""
    along = b - a
    length = np.hypot(*along[0])
    mass = DENSITY * WIDTH**2 * length
    normal = turned(along[0]) / length**2
    # θ' = n·d' for d = length·(cos θ, sin θ) and n = d⊥/length²; the part of d'' along d⊥ is length² θ''.
    return mass, mass * (length**2 + WIDTH**2) / 12, (a + b) / 2, normal @ along[1], normal @ along[2]


def bars(phi):
    """The four bars of a finger at a crank angle (rad)."""
    ground = np.zeros((2, 2))
    o, c = np.array([PIVOT, *ground]), np.array([C, *ground])
    out = np.cos(phi) * (A - PIVOT) + np.sin(phi) * turned(A - PIVOT)
    a = np.array([PIVOT + out, turned(out), -out])
    b = coupler_end(a)
    return [bar(o, a), bar(a, b), bar(b, fingertip(a, b)), bar(c, b)]


def acceleration(time, phi, phi_dot):
    """φ̈ (rad/s²) at t (s), φ (rad) and φ̇ (rad/s)."""
    inertia, force = 0.0, TORQUE / 2 * np.sin(OMEGA * time)
    for mass, moment, centre, angle1, angle2 in bars(phi):
        inertia += mass * centre[1] @ centre[1] + moment * angle1**2
        force -= (mass * centre[1] @ centre[2] + moment * angle1 * angle2) * phi_dot**2 + mass * GRAVITY * centre[1, 1]
    return force / inertia


def solve(times):
    """φ and φ̇ at the times (s), from rest at φ = 0."""
    return integrate_second(acceleration, (0.0, 0.0), times)


def main():
    """Writes reference.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    rows = [(*state, acceleration(time, *state)) for time, state in zip(times, solve(times).T, strict=True)]
    write(__file__, "reduced equation of motion", 3, times, rows)


if __name__ == "__main__":
    main()
