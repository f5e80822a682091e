"""Regenerates reference.csv: toe of Jansen's leg, by its reduced equation of motion. No MuJoCo, no oarlock.

Every joint of the leg is where two circles meet whose centres are known by then, so its place follows from the crank
angle φ in closed form. First and second derivatives with respect to φ follow from (P − A)·(P − A) = const:

    (P − A)·(P' − A') = 0,   (P − A)·(P'' − A'') = −|P' − A'|²,   and the same with the other centre.

They give those of the bars' centres c and angles θ, and these the reduced inertia and the equation of motion:

    m(φ) = Σ mᵢ |c'ᵢ|² + Iᵢ θ'ᵢ²,   m φ̈ = τ − Σ (mᵢ c'ᵢ·c''ᵢ + Iᵢ θ'ᵢ θ''ᵢ) φ̇² − Σ mᵢ g c'ᵢ,z,   τ = kv (ω − φ̇).

Run: python mjcf/jansen_leg/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

# Jansen's lengths, here in cm, by his letters.
CM = dict(zip("abcdefghijklm", (38, 41.5, 39.3, 40.1, 55.8, 39.4, 36.7, 65.7, 49, 50, 61.9, 7.8, 15), strict=True))
LENGTH = {name: 0.01 * length for name, length in CM.items()}
DENSITY, WIDTH, GRAVITY = 700.0, 0.03, 9.81
SPEED, DAMPING = 2 * np.pi, 2.0
DURATION, INTERVAL = 2.0, 0.002

# The bars: every side of a triangle is one.
BARS = ["OM", "MU", "MV", "PU", "PW", "UW", "PV", "WX", "VX", "XY", "VY"]


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


def points(phi):
    """The joints of the leg and its foot Y at a crank angle (rad): name → position (m) and its derivatives, (3, 2)."""
    out = np.array([np.cos(phi), np.sin(phi)])
    o = np.zeros((3, 2))
    p = np.array([[-LENGTH["a"], -LENGTH["l"]], [0, 0], [0, 0]])
    m = LENGTH["m"] * np.array([out, turned(out), -out])
    u = dyad(p, m, LENGTH["b"], LENGTH["j"])
    v = dyad(m, p, LENGTH["k"], LENGTH["c"])
    w = dyad(p, u, LENGTH["d"], LENGTH["e"])
    x = dyad(v, w, LENGTH["g"], LENGTH["f"])
    y = dyad(v, x, LENGTH["i"], LENGTH["h"])
    return {"O": o, "M": m, "P": p, "U": u, "V": v, "W": w, "X": x, "Y": y}


def acceleration(phi, phi_dot):
    """φ̈ (rad/s²) at φ (rad) and φ̇ (rad/s)."""
    place = points(phi)
    inertia, force = 0.0, DAMPING * (SPEED - phi_dot)
    for start, end in BARS:
        a, b = place[start], place[end]
        along, centre = b - a, (a + b) / 2
        length = np.hypot(*along[0])
        mass = DENSITY * WIDTH**2 * length
        moment = mass * (length**2 + WIDTH**2) / 12
        # d = length (cos θ, sin θ): θ' = n·d' and θ'' = n·d'' with n = d⊥/length².
        _, angle1, angle2 = along @ turned(along[0]) / length**2
        inertia += mass * centre[1] @ centre[1] + moment * angle1**2
        force -= (mass * centre[1] @ centre[2] + moment * angle1 * angle2) * phi_dot**2 + mass * GRAVITY * centre[1, 1]
    return force / inertia


def solve(times):
    """φ and φ̇ at the times (s), from rest at φ = 0."""
    return integrate_second(lambda _, *state: acceleration(*state), (0.0, 0.0), times)


def toe(phi, phi_dot):
    """Place, velocity and acceleration of the toe Y, (3, 2) in m, at φ (rad) and φ̇ (rad/s)."""
    place, first, second = points(phi)["Y"]
    return np.array([place, first * phi_dot, second * phi_dot**2 + first * acceleration(phi, phi_dot)])


def main():
    """Writes reference.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    rows = [np.insert(toe(*state), 1, 0.0, axis=1).ravel() for state in solve(times).T]
    write(__file__, "toe, reduced equation of motion", 3, times, rows)


if __name__ == "__main__":
    main()
