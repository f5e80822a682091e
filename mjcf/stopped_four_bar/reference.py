"""Regenerates reference.csv: the crank angle of a four-bar that falls against a stop. No MuJoCo, no oarlock.

The loop and its reduced equation of motion, m φ̈ = Q, are those of ../four_bar/reference.py. The stop pushes on the
rocker's angle ρ(φ) where it is beyond the limit, as MuJoCo's documentation has it (Computation, "Solver parameters"):
with the distance r = limit − ρ and its acceleration a = −(ρ' φ̈ + ρ'' φ̇²) the force f is

    f = D max(0, aref − a),   aref = B ρ̇ − K d(r) r,   D = d/(1 − d) · I.

The impedance d(r) is that of solimp, K and B are those of solref, and I is the rocker's own inertia about its pivot. In
φ̈ that is linear, so that it comes in closed form. Where the stop begins and ceases to push is located as an event.

Run: python mjcf/stopped_four_bar/reference.py
"""

import sys
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import ATOL, RTOL, grid, write

PIVOT = np.array([0.8, 0.0])
CRANK, COUPLER, ROCKER = 0.3, np.hypot(0.8, 0.3), 0.6
DENSITY, WIDTH, GRAVITY = 2700.0, 0.02, 9.81
START_SPEED = 1.0
DURATION, INTERVAL = 1.5, 0.0005

LIMIT = 0.35
TIME_CONSTANT, DAMPING_RATIO = 0.05, 0.3
SOFTEST, HARDEST, REACH = 0.8, 0.95, 0.02
STIFFNESS = 1 / (HARDEST * TIME_CONSTANT * DAMPING_RATIO) ** 2
DAMPING = 2 / (HARDEST * TIME_CONSTANT)
MASS = DENSITY * WIDTH**2 * ROCKER
INERTIA = MASS * (ROCKER**2 + WIDTH**2) / 12 + MASS * ROCKER**2 / 4


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
    """Mass, inertia, centre (3, 2), and angle from upright with two derivatives, of a square bar between two points."""
    along = b - a
    length = np.hypot(*along[0])
    mass = DENSITY * WIDTH**2 * length
    normal = turned(along[0]) / length**2
    angle = np.arctan2(-along[0, 0], along[0, 1]), normal @ along[1], normal @ along[2]
    return mass, mass * (length**2 + WIDTH**2) / 12, (a + b) / 2, angle


def bars(phi):
    """The three bars at a crank angle (rad) from upright, the rocker last."""
    out = np.array([-np.sin(phi), np.cos(phi)])
    ground, pivot = np.zeros((3, 2)), np.array([PIVOT, [0, 0], [0, 0]])
    a = CRANK * np.array([out, turned(out), -out])
    b = dyad(a, pivot, COUPLER, ROCKER)
    return [bar(ground, a), bar(a, b), bar(pivot, b)]


def reduced(phi, phi_dot):
    """Inertia m, force Q, and the rocker's angle with two derivatives, at φ (rad) and φ̇ (rad/s)."""
    inertia = force = 0.0
    rocker = (0.0, 0.0, 0.0)
    for mass, moment, centre, rocker in bars(phi):
        inertia += mass * centre[1] @ centre[1] + moment * rocker[1] ** 2
        force -= (mass * centre[1] @ centre[2] + moment * rocker[1] * rocker[2]) * phi_dot**2
        force -= mass * GRAVITY * centre[1, 1]
    return inertia, force, rocker


def impedance(depth):
    """The impedance d at a depth (rad): two parabolas between its least and its most."""
    x = min(abs(depth) / REACH, 1.0)
    return SOFTEST + (HARDEST - SOFTEST) * (2 * x**2 if x <= 0.5 else 1 - 2 * (1 - x) ** 2)


def push(phi, phi_dot):
    """φ̈ (rad/s²) with the stop's law in force, and its torque (N m), which is pulling where negative."""
    inertia, force, (rho, rho1, rho2) = reduced(phi, phi_dot)
    d = impedance(rho - LIMIT)
    stiff = d / (1 - d) * INERTIA
    asked = DAMPING * rho1 * phi_dot + STIFFNESS * d * (rho - LIMIT) + rho2 * phi_dot**2
    acceleration = (force - rho1 * stiff * asked) / (inertia + stiff * rho1**2)
    return acceleration, stiff * (asked + rho1 * acceleration)


def contact(_, state):
    """Positive where the stop pushes: beyond the limit (rad), and not so fast on the way back that it would pull."""
    return min(reduced(*state)[2][0] - LIMIT, push(*state)[1])


def pushed_on(phi, phi_dot):
    """φ̈ (rad/s²) while the stop pushes."""
    return push(phi, phi_dot)[0]


def free(phi, phi_dot):
    """φ̈ (rad/s²) without the stop."""
    inertia, force, _ = reduced(phi, phi_dot)
    return force / inertia


def acceleration(phi, phi_dot):
    """φ̈ (rad/s²) at φ (rad) and φ̇ (rad/s)."""
    return push(phi, phi_dot)[0] if contact(0.0, (phi, phi_dot)) > 0 else free(phi, phi_dot)


def turn(direction):
    """The event that ends a piece: the stop begins (1) or ceases (−1) to push."""

    def event(time, state):
        return contact(time, state)

    vars(event).update(terminal=True, direction=direction)  # what solve_ivp asks of an event
    return event


def solve(times):
    """φ and φ̇ (2, times) at the times (s), and the times at which the stop begins and ceases to push, in turn."""
    states, turns = np.zeros((2, len(times))), [0.0]
    state, pushed = np.array([0.0, START_SPEED]), False
    while turns[-1] < times[-1]:
        law, event = (pushed_on, turn(-1)) if pushed else (free, turn(1))
        span = turns[-1], times[-1]
        piece = solve_ivp(
            lambda _, y, law=law: (y[1], law(*y)),
            span,
            state,
            "DOP853",
            rtol=RTOL,
            atol=ATOL,
            events=event,
            max_step=1e-3,
            dense_output=True,
        )
        inside = (times >= span[0]) & (times <= piece.t[-1])
        states[:, inside] = piece.sol(times[inside])
        turns.append(piece.t[-1])
        state, pushed = piece.y[:, -1], not pushed
    return states, turns[1:-1]


def rest():
    """The crank angle (rad) at which the stop carries the weight: m φ̈ = 0 with φ̇ = 0."""
    return brentq(lambda phi: push(phi, 0.0)[0], 0.3, 1.5, xtol=1e-15)


def main():
    """Writes reference.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    states, turns = solve(times)
    print("pushes begin and end, s:", *turns, "rest, rad:", rest(), "torque, N m:", push(rest(), 0.0)[1])
    write(__file__, "equation of motion by pieces", 4, times, [(*state, acceleration(*state)) for state in states.T])


if __name__ == "__main__":
    main()
