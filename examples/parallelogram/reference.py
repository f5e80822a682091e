"""Writes reference.csv: the parallelogram's angle, from the pendulum that it is. No MuJoCo, no oarlock.

Two rods turn by φ about their upper ends and the third goes along without turning, each of mass m and length l:

    (⅓ + ⅓ + 1) m l² φ̈ = −(½ + ½ + 1) m g l sin φ,   so that   φ̈ = −1.2 (g/l) sin φ.

Run: python examples/parallelogram/reference.py
"""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

GRAVITY, LENGTH, START = 9.81, 1.0, 1.2
DURATION, INTERVAL = 5.0, 0.002


def acceleration(angle):
    """Of the pendulum, rad/s²."""
    return -1.2 * GRAVITY / LENGTH * np.sin(angle)


times = np.arange(round(DURATION / INTERVAL) + 1) * INTERVAL
found = solve_ivp(
    lambda _, y: [y[1], acceleration(y[0])], (0, DURATION), [START, 0], "DOP853", times, rtol=1e-13, atol=1e-13
)
table = np.column_stack([times, found.y[0], found.y[1], acceleration(found.y[0])])
np.savetxt(
    Path(__file__).with_name("reference.csv"),
    table,
    fmt="%.17g",
    delimiter=",",
    header="time,position,velocity,acceleration",
    comments="",
)
