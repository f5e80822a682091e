"""Regenerates reference.csv: the box between the fingers stays in the middle. Prints the forces. No MuJoCo, no oarlock.

Gripper, box, floor and drive are mirror images of themselves at all times: the gears make the left finger the mirror
image of the right one, whatever each touches. So the box never moves sideways.

At rest nothing rubs: friction loss and friction of contacts are forces in proportion to rates, in MuJoCo, up to their
greatest. The floor carries the box, and at each tip the virtual work of half the motor's torque τ, of the finger's
weight and of the tip's normal force N vanishes, with derivatives by the crank angle φ as in ../gripper/reference.py:

    τ/2 − Σ mᵢ g c'ᵢ,z + N x'_T = 0   where   x_T(φ) = half the box + the pad's radius − how deep the pad is pressed in.

Run: python mjcf/gripping_gripper/reference.py
"""

import csv
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import JOINT, SUMS, sums_of

PIVOT, A, B, C, T = np.array([[0.13, 0.0], [0.17, -0.08], [0.13, -0.10], [0.10, -0.01], [0.10, -0.19]])
"""m, (x, z), of the right finger at φ = 0."""
DENSITY, WIDTH, GRAVITY = 2700.0, 0.01, 9.81
PAD, HALF, BOX = 0.008, 0.055, 0.2
TORQUE = -4.0
DURATION = 1.5


def turned(v):
    """A vector (x, z) turned by +90°."""
    return np.array([-v[1], v[0]])


def points(phi):
    """O, A, B, T and C at a crank angle (rad), each a position with its derivative, (2, 2)."""
    ground = np.zeros(2)
    out = np.cos(phi) * (A - PIVOT) + np.sin(phi) * turned(A - PIVOT)
    a = np.array([PIVOT + out, turned(out)])
    along = C - a[0]
    distance, coupler, rocker = np.hypot(*along), np.hypot(*(B - A)), np.hypot(*(B - C))
    foot = (distance**2 + coupler**2 - rocker**2) / (2 * distance)
    pin = a[0] + (foot * along + np.sqrt(coupler**2 - foot**2) * turned(along)) / distance
    b = np.array([pin, np.linalg.solve([pin - a[0], pin - C], [(pin - a[0]) @ a[1], 0.0])])
    drawn, tip = B - A, T - A
    way, across = tip @ drawn / (drawn @ drawn), tip @ turned(drawn) / (drawn @ drawn)
    t = np.array([p + way * d + across * turned(d) for p, d in zip(a, b - a, strict=True)])
    return np.array([PIVOT, ground]), a, b, t, np.array([C, ground])


def weight(phi):
    """Σ mᵢ g c'ᵢ,z of one finger, N m."""
    o, a, b, t, c = points(phi)
    bars = [(o, a), (a, b), (b, t), (c, b)]
    return sum(DENSITY * WIDTH**2 * np.hypot(*(q - p)[0]) * GRAVITY * (p + q)[1, 1] / 2 for p, q in bars)


def grip(depth=0.0):
    """Crank angle (rad) and normal force of a tip (N) that is pressed into the box by a depth (m)."""
    phi = brentq(lambda phi: points(phi)[3][0, 0] - HALF - PAD + depth, -0.7, 0.0, xtol=1e-15)
    return phi, -(TORQUE / 2 - weight(phi)) / points(phi)[3][1, 0]


def main():
    """Writes reference.csv beside this file."""
    for depth in (0.0, 5e-4):
        phi, normal = grip(depth)
        total = 2 * normal + BOX * GRAVITY
        print(f"pressed in by {depth:g} m: φ {phi:.6f} rad, a tip {normal:.6f} N, all contacts {total:.6f} N")
    script = Path(__file__)
    with script.with_name("reference.csv").open("w", encoding="utf-8", newline="") as file:
        file.write("# the box stays in the middle; made by reference.py\n")
        csv.writer(file, lineterminator="\n").writerows([JOINT, ["0.0", 0, 0, 0], [f"{DURATION}", 0, 0, 0]])
    script.with_name(SUMS).write_text("".join(f"{s}  {n}\n" for n, s in sums_of(script).items()), encoding="utf-8")


if __name__ == "__main__":
    main()
