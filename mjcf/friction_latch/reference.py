"""Regenerates reference.csv: the handle of a latch whose bolts stick and slip. No MuJoCo, no oarlock.

The right bolt is at x(φ) = √(l² − r² cos² φ) − r sin φ, the left one at −x. Handle, rods and bolts leave a reduced
inertia m(φ), and the equation of motion is, with the handle's spring and the friction f of each bolt,

    m φ̈ = τ(t) − k φ − ½ m'(φ) φ̇² + 2 x' f.

Friction loss is what MuJoCo's documentation has it (Computation, "Solver parameters"; the position of such a row is 0):

    f = −D (B ẋ + ẍ), but not beyond ±η,   D = d/(1 − d) · bolt's mass,   d = solimp's,   B = 2/(d timeconst).

It is linear in φ̈ where the bolts stick, and a constant where they slip. Where one turns into the other is an event.

Run: python mjcf/friction_latch/reference.py
"""

import sys
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import ATOL, RTOL, grid, write

PIN, REACH, HANDLE, BOLT = 0.05, 0.12, 0.3, 0.3
DENSITY, WIDTH = 2700.0, 0.01
LOSS, IMPEDANCE, TIME_CONSTANT = 5.0, 0.95, 0.005
STIFF = IMPEDANCE / (1 - IMPEDANCE) * BOLT
DAMPING = 2 / (IMPEDANCE * TIME_CONSTANT)
TORQUE, OMEGA, SPRING = 0.3, 2 * np.pi, 0.6
DURATION, INTERVAL = 1.5, 0.0005

ROD = np.hypot(PIN, REACH)
HANDLE_MASS, ROD_MASS = (DENSITY * WIDTH**2 * length for length in (HANDLE, ROD))
HANDLE_INERTIA = HANDLE_MASS * (HANDLE**2 + WIDTH**2) / 12
ROD_INERTIA = ROD_MASS * (ROD**2 + WIDTH**2) / 12


def bolt(phi):
    """Place of the right bolt (m) and its first two derivatives by φ."""
    sin, cos = np.sin(phi), np.cos(phi)
    root = np.sqrt(ROD**2 - (PIN * cos) ** 2)
    first = PIN**2 * sin * cos / root
    second = PIN**2 * (cos**2 - sin**2) / root - first**2 / root
    return root - PIN * sin, first - PIN * cos, second + PIN * sin


def reduced(phi, phi_dot, time):
    """Inertia m and force without friction at φ (rad), φ̇ (rad/s) and t (s)."""
    sin, cos = np.sin(phi), np.cos(phi)
    _, x1, x2 = bolt(phi)
    # The rod's middle is between pin (−r sin φ, r cos φ) and bolt (x, 0); its slope ψ has l sin ψ = r cos φ.
    middle1 = np.array([x1 - PIN * cos, -PIN * sin]) / 2
    middle2 = np.array([x2 + PIN * sin, -PIN * cos]) / 2
    root = np.sqrt(ROD**2 - (PIN * cos) ** 2)
    slope1 = -PIN * sin / root
    slope2 = -PIN * cos / root + PIN * sin * (PIN**2 * sin * cos / root) / root**2
    inertia = HANDLE_INERTIA + 2 * (ROD_MASS * middle1 @ middle1 + ROD_INERTIA * slope1**2 + BOLT * x1**2)
    change = 2 * (ROD_MASS * middle1 @ middle2 + ROD_INERTIA * slope1 * slope2 + BOLT * x1 * x2)
    return inertia, TORQUE * (1 - np.cos(OMEGA * time)) - SPRING * phi - change * phi_dot**2


def stuck(time, phi, phi_dot):
    """φ̈ (rad/s²) where the bolts stick, and the friction (N) of each that it takes."""
    inertia, force = reduced(phi, phi_dot, time)
    _, x1, x2 = bolt(phi)
    asked = DAMPING * x1 * phi_dot + x2 * phi_dot**2
    acceleration = (force - 2 * x1 * STIFF * asked) / (inertia + 2 * STIFF * x1**2)
    return acceleration, -STIFF * (asked + x1 * acceleration)


def excess(time, state):
    """How much more friction sticking would take than there is, N."""
    return abs(stuck(time, *state)[1]) - LOSS


def acceleration(time, phi, phi_dot):
    """φ̈ (rad/s²) at t (s), φ (rad) and φ̇ (rad/s)."""
    found, friction = stuck(time, phi, phi_dot)
    if abs(friction) <= LOSS:
        return found
    return slipping(time, phi, phi_dot, np.sign(friction))


def slipping(time, phi, phi_dot, sign):
    """φ̈ (rad/s²) where the bolts slip, with friction of a sign."""
    inertia, force = reduced(phi, phi_dot, time)
    return (force + 2 * bolt(phi)[1] * sign * LOSS) / inertia


def turn(direction):
    """The event that ends a piece: the bolts begin (1) or cease (−1) to slip."""

    def event(time, state):
        return excess(time, state)

    vars(event).update(terminal=True, direction=direction)  # what solve_ivp asks of an event
    return event


def solve(times):
    """φ and φ̇ (2, times) at the times (s), and the times at which the bolts begin and cease to slip, in turn."""
    states, turns = np.zeros((2, len(times))), [0.0]
    state, slips = np.zeros(2), False
    while turns[-1] < times[-1]:
        span = turns[-1], times[-1]
        sign = np.sign(stuck(span[0], *state)[1])

        def law(t, y, slips=slips, sign=sign):
            return y[1], slipping(t, y[0], y[1], sign) if slips else stuck(t, y[0], y[1])[0]

        piece = solve_ivp(
            law,
            span,
            state,
            "DOP853",
            rtol=RTOL,
            atol=ATOL,
            events=turn(-1 if slips else 1),
            max_step=1e-3,
            dense_output=True,
        )
        inside = (times >= span[0]) & (times <= piece.t[-1])
        if inside.any():
            states[:, inside] = piece.sol(times[inside])
        turns.append(piece.t[-1])
        state, slips = piece.y[:, -1], not slips
    return states, turns[1:-1]


def main():
    """Writes reference.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    states, turns = solve(times)
    print("slips begin and cease, s:", *turns)
    rows = [(*state, acceleration(time, *state)) for time, state in zip(times, states.T, strict=True)]
    write(__file__, "equation of motion by pieces", 4, times, rows)


if __name__ == "__main__":
    main()
