"""Regenerates reference.csv: a finger bent against a limit, and stretched again. No MuJoCo, no oarlock.

The crossed cable makes the distal angle ρ φ of the proximal one φ, with ρ = 0.8. A double pendulum without gravity is
left with the inertia m(φ), and the equation of motion

    m φ̈ = −½ m' φ̇² − k₁ (φ − φ₀) − ρ k₂ (ρ φ − φ₀) − c (1 + ρ²) φ̇ + (r₁ + ρ r₂) P(t) − Σ jᵢ fᵢ

with the pull P of the winch and the forces f of two limits, of the distal angle (j = ρ) and of the flexor's stop
(j = −r₁ − ρ r₂). Their law is that of MuJoCo's documentation (Computation, "Solver parameters"): with the depth
s = j φ − bound

    f = D max(0, B ṡ + K d(s) s + s̈),   D = d/(1 − d)/w,

d(s) is the impedance of solimp, K and B are those of solref, w is J M⁻¹ Jᵀ of the limit's row in the stretched finger,
of two free phalanges. In φ̈ that is linear. Where a limit begins and ceases to push is located as an event.

Run: python mjcf/cable_finger/reference.py
"""

import sys
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import ATOL, RTOL, grid, write

DENSITY, WIDTH = 2700.0, 0.01
LENGTHS = np.array([0.05, 0.04])
MASSES = DENSITY * WIDTH**2 * LENGTHS
INERTIAS = MASSES * (LENGTHS**2 + WIDTH**2) / 12
RATIO, ARMS = 0.8, np.array([0.01, 0.006])
SPRINGS, RELAXED, DAMPING = np.array([0.04, 0.02]), -0.5, 0.0005
PULL = 5.0
START = 0.05
DURATION, INTERVAL = 1.0, 0.0005

TIME_CONSTANT, DAMPING_RATIO, SOFTEST, HARDEST = 0.01, 0.7, 0.8, 0.95
K = 1 / (HARDEST * TIME_CONSTANT * DAMPING_RATIO) ** 2
B = 2 / (HARDEST * TIME_CONSTANT)


def inertia(distal):
    """Mass matrix (2, 2) of the two phalanges at a distal angle (rad)."""
    tip = INERTIAS[1] + MASSES[1] * LENGTHS[1] ** 2 / 4
    mixed = MASSES[1] * LENGTHS[0] * LENGTHS[1] / 2 * np.cos(distal)
    root = INERTIAS[0] + MASSES[0] * LENGTHS[0] ** 2 / 4 + MASSES[1] * LENGTHS[0] ** 2 + tip + 2 * mixed
    return np.array([[root, tip + mixed], [tip + mixed, tip]])


BEND = np.array([1.0, RATIO])
FREE = np.linalg.inv(inertia(0.0))


class Limit:
    """A limit: its row (2) of the joints, its bound, and the reach of its impedance."""

    def __init__(self, row, bound, reach):
        self.lever, self.bound, self.reach, self.weight = row @ BEND, bound, reach, row @ FREE @ row

    def depth(self, phi):
        """How far beyond the bound, rad or m."""
        return self.lever * phi - self.bound

    def law(self, phi, phi_dot):
        """D and what is asked of it, B ṡ + K d s."""
        x = min(abs(self.depth(phi)) / self.reach, 1.0)
        d = SOFTEST + (HARDEST - SOFTEST) * (2 * x**2 if x <= 0.5 else 1 - 2 * (1 - x) ** 2)
        return d / (1 - d) / self.weight, B * self.lever * phi_dot + K * d * self.depth(phi)


LIMITS = (Limit(np.array([0.0, 1.0]), 1.2, 0.02), Limit(-ARMS, 0.0, 0.0002))


def pull(time):
    """The winch's pull (N) at t (s)."""
    return PULL * (1 - np.cos(2 * np.pi * time))


def forced(limit, time, phi, phi_dot):
    """φ̈ (rad/s²) with a limit's law in force, or without for None; and the limit's force, pulling where negative."""
    mass = BEND @ inertia(RATIO * phi) @ BEND
    change = -MASSES[1] * LENGTHS[0] * LENGTHS[1] * RATIO * (1 + RATIO) * np.sin(RATIO * phi)
    force = -change / 2 * phi_dot**2 - SPRINGS * BEND @ (BEND * phi - RELAXED)
    force += -DAMPING * BEND @ BEND * phi_dot + ARMS @ BEND * pull(time)
    if limit is None:
        return force / mass, 0.0
    stiff, asked = limit.law(phi, phi_dot)
    acceleration = (force - limit.lever * stiff * asked) / (mass + stiff * limit.lever**2)
    return acceleration, stiff * (asked + limit.lever * acceleration)


def contact(limit, time, state):
    """Positive where a limit pushes."""
    return min(limit.depth(state[0]), forced(limit, time, *state)[1])


def acceleration(time, phi, phi_dot):
    """φ̈ (rad/s²) at t (s), φ (rad) and φ̇ (rad/s)."""
    pushing = [limit for limit in LIMITS if contact(limit, time, (phi, phi_dot)) > 0]
    return forced(pushing[0] if pushing else None, time, phi, phi_dot)[0]


def pushed(limit, time, state):
    """The force of a limit, N m or N."""
    return max(forced(limit, time, *state)[1], 0.0) if limit.depth(state[0]) > 0 else 0.0


def turn(limit, direction):
    """The event that ends a piece: a limit begins (1) or ceases (−1) to push."""

    def event(time, state):
        return contact(limit, time, state)

    vars(event).update(terminal=True, direction=direction)  # what solve_ivp asks of an event
    return event


def solve(times):
    """φ and φ̇ (2, times) at the times (s), and the times at which a limit begins and ceases to push, in turn."""
    states, turns = np.zeros((2, len(times))), [0.0]
    state, pushing = np.array([START, 0.0]), None
    while turns[-1] < times[-1]:
        events = [turn(limit, 1) for limit in LIMITS] if pushing is None else [turn(pushing, -1)]
        span = turns[-1], times[-1]
        piece = solve_ivp(
            lambda t, y, limit=pushing: (y[1], forced(limit, t, *y)[0]),
            span,
            state,
            "DOP853",
            rtol=RTOL,
            atol=ATOL,
            events=events,
            max_step=1e-3,
            dense_output=True,
        )
        inside = (times >= span[0]) & (times <= piece.t[-1])
        if inside.any():
            states[:, inside] = piece.sol(times[inside])
        turns.append(piece.t[-1])
        state = piece.y[:, -1]
        if pushing is None:
            pushing = next((limit for limit, when in zip(LIMITS, piece.t_events, strict=True) if len(when)), None)
        else:
            pushing = None
    return states, turns[1:-1]


def rest(limit, time):
    """Angle (rad) and the limit's force at which everything balances, with the pull of a time (s)."""
    phi = brentq(lambda phi: forced(limit, time, phi, 0.0)[0], -0.2, 2.0, xtol=1e-15)
    return phi, forced(limit, time, phi, 0.0)[1]


def main():
    """Writes reference.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    states, turns = solve(times)
    rows = [(*state, acceleration(time, *state)) for time, state in zip(times, states.T, strict=True)]
    closer = grid(DURATION, INTERVAL / 20)
    moments = list(zip(closer, solve(closer)[0].T, strict=True))
    largest = [max(pushed(limit, *moment) for moment in moments) for limit in LIMITS]
    print("pushes begin and end, s:", *turns)
    print("largest forces, N m and N:", *largest)
    print("statics, rad and N m or N: limit", *rest(LIMITS[0], 0.5), "stop", *rest(LIMITS[1], 0.0))
    write(__file__, "equation of motion by pieces", 4, times, rows)


if __name__ == "__main__":
    main()
