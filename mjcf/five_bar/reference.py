"""Regenerates reference.csv: the five-bar's tool from the equations of motion in its two motor angles. No MuJoCo.

The tool is where the circles of the forearms about the elbows meet. Differentiating (P − E)·(P − E) = const twice gives
the Jacobian of P with respect to q = (q₁, q₂) and its bias J̇q̇:

    (P − E)·(J_P − J_E) = 0,   (P − E)·(J̇_P q̇ − J̇_E q̇) = −|Ṗ − Ė|²   for either elbow E,

and with them those of the bars' centres and angles. With all of them in one Jacobian J and masses and inertias in D:

    (Jᵀ D J) q̈ = τ − Jᵀ (D J̇q̇ + weights),   τ = kp (u(t) − q) − kv q̇.

Run: python mjcf/five_bar/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate, write

PIVOTS = np.array([[-0.06, 0.0], [0.06, 0.0]])
ARMS = np.array([[-0.12, 0.16], [0.12, 0.16]])
FOREARM = 0.3
DENSITY, WIDTH, GRAVITY = 2700.0, 0.012, 9.81
STIFFNESS, DAMPING = 50.0, 1.0
AMPLITUDES, RATES = np.array([0.25, 0.3]), 2 * np.pi * np.array([1.0, 1.5])
DURATION, INTERVAL = 2.0, 0.002


class Point:
    """A point (x, z): position (2,), Jacobian (2, 2) with respect to the motor angles, bias J̇q̇ (2,)."""

    def __init__(self, position, jacobian, bias):
        self.position, self.jacobian, self.bias = position, jacobian, bias


def turned(v):
    """A vector (x, z) turned by +90°."""
    return np.array([-v[1], v[0]])


def elbow(motor, q, q_dot):
    """The end of a driven arm."""
    cos, sin = np.cos(q[motor]), np.sin(q[motor])
    arm = np.array([[cos, -sin], [sin, cos]]) @ ARMS[motor]
    jacobian = np.zeros((2, 2))
    jacobian[:, motor] = turned(arm)
    return Point(PIVOTS[motor] + arm, jacobian, -(q_dot[motor] ** 2) * arm)


def tool(left, right, q_dot):
    """Where the equal forearms from the two elbows meet, to the left of left → right."""
    along = right.position - left.position
    distance = np.hypot(*along)
    height = np.sqrt(FOREARM**2 - distance**2 / 4)
    position = (left.position + right.position) / 2 + height / distance * turned(along)
    ends = (left, right)
    bars = np.array([position - end.position for end in ends])
    jacobian = np.linalg.solve(bars, [bar @ end.jacobian for bar, end in zip(bars, ends, strict=True)])
    rates = [(jacobian - end.jacobian) @ q_dot for end in ends]
    curvature = [bar @ end.bias - rate @ rate for bar, end, rate in zip(bars, ends, rates, strict=True)]
    return Point(position, jacobian, np.linalg.solve(bars, curvature))


def points(q, q_dot):
    """Both pivots, both elbows, the tool."""
    pivots = [Point(pivot, np.zeros((2, 2)), np.zeros(2)) for pivot in PIVOTS]
    left, right = (elbow(motor, q, q_dot) for motor in (0, 1))
    return *pivots, left, right, tool(left, right, q_dot)


def target(time):
    """The motors' commanded angles (rad)."""
    return AMPLITUDES * (1 - np.cos(RATES * time))


def acceleration(time, q, q_dot):
    """q̈ (rad/s²) at time (s), q (rad) and q̇ (rad/s)."""
    pivot1, pivot2, elbow1, elbow2, tip = points(q, q_dot)
    inertia = np.zeros((2, 2))
    force = STIFFNESS * (target(time) - q) - DAMPING * q_dot
    for a, b in [(pivot1, elbow1), (pivot2, elbow2), (elbow1, tip), (elbow2, tip)]:
        along = b.position - a.position
        length = np.hypot(*along)
        mass = DENSITY * WIDTH**2 * length
        moment = mass * (length**2 + WIDTH**2) / 12
        centre = (a.jacobian + b.jacobian) / 2
        angle = turned(along) @ (b.jacobian - a.jacobian) / length**2
        angle_bias = turned(along) @ (b.bias - a.bias) / length**2
        inertia += mass * centre.T @ centre + moment * np.outer(angle, angle)
        force -= mass * ((a.bias + b.bias) / 2 + [0, GRAVITY]) @ centre + moment * angle_bias * angle
    return np.linalg.solve(inertia, force)


def solve(times):
    """Angles and rates, (q, q̇) as (4, times), at the times (s), from rest at q = 0."""
    return integrate(lambda t, y: np.concatenate([y[2:], acceleration(t, y[:2], y[2:])]), np.zeros(4), times)


def tool_path(time, q, q_dot):
    """Place, velocity and acceleration of the tool, (3, 2) in m, at time (s), q (rad) and q̇ (rad/s)."""
    tip = points(q, q_dot)[-1]
    return np.array([tip.position, tip.jacobian @ q_dot, tip.jacobian @ acceleration(time, q, q_dot) + tip.bias])


def main():
    """Writes reference.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    paths = [tool_path(time, state[:2], state[2:]) for time, state in zip(times, solve(times).T, strict=True)]
    rows = [np.insert(path, 1, 0.0, axis=1).ravel() for path in paths]
    write(__file__, "tool, equations of motion", 3, times, rows)


if __name__ == "__main__":
    main()
