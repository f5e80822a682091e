"""Regenerates reference.csv: Andrews' mechanism in the seven angles and with the formulas of the literature. No MuJoCo.

    M(q) q̈ = f(q, q̇) − Gᵀλ,   G q̈ = −Ġ q̇,   G = ∂g/∂q

is solved for q̈ and λ at every evaluation (index 1), and integrated by DOP853. M, f, g and the numbers are those of the
IVP test set (F. Mazzia and C. Magherini, release 2.4, "Andrews' squeezing mechanism"), after E. Hairer and G. Wanner,
Solving ordinary differential equations II, §VII.7. Two checks: nothing holds g = 0 and the energy
½ q̇ᵀM q̇ + ½ c₀ (L − l₀)² − mom β, which both must stay where they are.

Run: python mjcf/andrews_squeezer/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate, write

M1, M2, M3, M4, M5, M6, M7 = 0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498
I1, I2, I3, I4, I5, I6, I7 = 2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5
XA, YA, XB, YB, XC, YC = -0.06934, -0.00227, -0.03635, 0.03273, 0.014, 0.072
STIFFNESS, REST, MOMENT = 4530.0, 0.07785, 0.033
D, DA, E, EA, RR, RA = 0.028, 0.0115, 0.02, 0.01421, 0.007, 0.00092
SS, SA, SB, SC, SD = 0.035, 0.01874, 0.01043, 0.018, 0.02
TA, TB, U, UA, UB = 0.02308, 0.00916, 0.04, 0.01228, 0.00449
ZF, ZT, FA = 0.02, 0.04, 0.01421

BETA, THETA, GAMMA, PHI, DELTA, OMEGA, EPSILON = range(7)
START = np.array(
    [
        -0.0617138900142764496,
        0.0,
        0.455279819163070380,
        0.222668390165885885,
        0.487364979543842550,
        -0.222668390165885885,
        1.230547444549821192,
    ]
)
DURATION, INTERVAL = 0.03, 2.5e-5
ATOL = 1e-13
OPEN = 1e-13
"""m. What the loops may stand open at the end: the integration's own error, times lengths of centimetres."""
LOST = 1e-11
"""Of the energy, over the largest kinetic energy."""


def mass(q):
    """M(q), 7×7, kg m²."""
    m = np.zeros((7, 7))
    cos_theta, sin_phi, sin_omega = np.cos(q[THETA]), np.sin(q[PHI]), np.sin(q[OMEGA])
    m[0, 0] = M1 * RA**2 + M2 * (RR**2 - 2 * DA * RR * cos_theta + DA**2) + I1 + I2
    m[1, 0] = M2 * (DA**2 - DA * RR * cos_theta) + I2
    m[1, 1] = M2 * DA**2 + I2
    m[2, 2] = M3 * (SA**2 + SB**2) + I3
    m[3, 3] = M4 * (E - EA) ** 2 + I4
    m[4, 3] = M4 * ((E - EA) ** 2 + ZT * (E - EA) * sin_phi) + I4
    m[4, 4] = M4 * (ZT**2 + 2 * ZT * (E - EA) * sin_phi + (E - EA) ** 2) + M5 * (TA**2 + TB**2) + I4 + I5
    m[5, 5] = M6 * (ZF - FA) ** 2 + I6
    m[6, 5] = M6 * ((ZF - FA) ** 2 - U * (ZF - FA) * sin_omega) + I6
    m[6, 6] = M6 * ((ZF - FA) ** 2 - 2 * U * (ZF - FA) * sin_omega + U**2) + M7 * (UA**2 + UB**2) + I6 + I7
    return m + np.tril(m, -1).T


def spring(q):
    """End of the spring on K3 relative to its other end (2), and its length, m."""
    sin, cos = np.sin(q[GAMMA]), np.cos(q[GAMMA])
    arm = np.array([SD * cos + SC * sin + XB - XC, SD * sin - SC * cos + YB - YC])
    return arm, np.hypot(*arm)


def force(q, v):
    """f(q, q̇), 7, N m."""
    arm, length = spring(q)
    fx, fy = -STIFFNESS * (length - REST) / length * arm
    sin, cos = np.sin(q), np.cos(q)
    return np.array(
        [
            MOMENT - M2 * DA * RR * v[THETA] * (v[THETA] + 2 * v[BETA]) * sin[THETA],
            M2 * DA * RR * v[BETA] ** 2 * sin[THETA],
            fx * (SC * cos[GAMMA] - SD * sin[GAMMA]) + fy * (SD * cos[GAMMA] + SC * sin[GAMMA]),
            M4 * ZT * (E - EA) * v[DELTA] ** 2 * cos[PHI],
            -M4 * ZT * (E - EA) * v[PHI] * (v[PHI] + 2 * v[DELTA]) * cos[PHI],
            -M6 * U * (ZF - FA) * v[EPSILON] ** 2 * cos[OMEGA],
            M6 * U * (ZF - FA) * v[OMEGA] * (v[OMEGA] + 2 * v[EPSILON]) * cos[OMEGA],
        ]
    )


# Every term of g is a length times the sine or cosine of a sum of angles: (row, length, angles, quarter turns), with
# cos(x − k π/2), so that derivatives need no formula of their own. x-rows; a y-row is a quarter turn further.
_TERMS = [
    (0, RR, (BETA,), 0),
    (0, -D, (BETA, THETA), 0),
    (0, -SS, (GAMMA,), 1),
    (2, RR, (BETA,), 0),
    (2, -D, (BETA, THETA), 0),
    (2, -E, (PHI, DELTA), 1),
    (2, -ZT, (DELTA,), 0),
    (4, RR, (BETA,), 0),
    (4, -D, (BETA, THETA), 0),
    (4, -ZF, (OMEGA, EPSILON), 0),
    (4, -U, (EPSILON,), 1),
]
_ROWS = np.array([row + axis for axis in (0, 1) for row, *_ in _TERMS])
_LENGTHS = np.array([length for _ in (0, 1) for _, length, *_ in _TERMS])
_TURNS = np.array([(turns + axis) * np.pi / 2 for axis in (0, 1) for *_, turns in _TERMS])
_ANGLES = np.array([[float(k in angles) for k in range(7)] for _ in (0, 1) for _, _, angles, _ in _TERMS])
_GROUND = np.array([XB, YB, XA, YA, XA, YA])


def gaps(q):
    """g(q), 6, m."""
    return np.bincount(_ROWS, _LENGTHS * np.cos(_ANGLES @ q - _TURNS)) - _GROUND


def jacobian(q):
    """G(q), 6×7, m."""
    slopes = -_LENGTHS * np.sin(_ANGLES @ q - _TURNS)
    found = np.zeros((6, 7))
    np.add.at(found, _ROWS, slopes[:, None] * _ANGLES)
    return found


def curvature(q, v):
    """Ġ q̇, 6, m/s²."""
    return np.bincount(_ROWS, -_LENGTHS * np.cos(_ANGLES @ q - _TURNS) * (_ANGLES @ v) ** 2)


def solve_state(q, v):
    """q̈ (7, rad/s²) and λ (6, N)."""
    g = jacobian(q)
    matrix = np.block([[mass(q), g.T], [g, np.zeros((6, 6))]])
    solution = np.linalg.solve(matrix, np.concatenate([force(q, v), -curvature(q, v)]))
    return solution[:7], solution[7:]


def energies(q, v):
    """Total and kinetic energy, J; the total counts the moment's work."""
    kinetic = 0.5 * v @ mass(q) @ v
    return kinetic + 0.5 * STIFFNESS * (spring(q)[1] - REST) ** 2 - MOMENT * q[BETA], kinetic


def solve(times):
    """Angles and rates at the times (s), (n, 7) each, from rest."""
    solution = integrate(
        lambda t, y: np.concatenate([y[7:], solve_state(y[:7], y[7:])[0]]),
        np.concatenate([START, np.zeros(7)]),
        times,
        atol=ATOL,
    )
    q, v = solution[:7].T, solution[7:].T
    opened = max(np.abs(gaps(x)).max() for x in q)
    total, kinetic = np.array([energies(*state) for state in zip(q, v, strict=True)]).T
    lost = np.abs(total - total[0]).max() / kinetic.max()
    if opened > OPEN or lost > LOST:
        raise ArithmeticError(f"loops open by {opened:.1e} m, energy off by {lost:.1e}: expected {OPEN:g}, {LOST:g}")
    return q, v


def main():
    """Writes reference.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    q, v = solve(times)
    rows = [(x[BETA], rate[BETA], solve_state(x, rate)[0][BETA]) for x, rate in zip(q, v, strict=True)]
    write(__file__, "seven angles and six multipliers", 6, times, rows, atol=ATOL)


if __name__ == "__main__":
    main()
