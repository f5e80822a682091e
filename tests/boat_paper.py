"""The boat by the formulas of the paper (V. N. Ivanov): no MuJoCo, no oarlock.

q = (φ, ψ2, θ2, ψ3, θ3); every function takes arrays of five. Rows: three an oar.
"""

import numpy as np

R0, RH, J1, J2, MASS, CENTRE, GRAVITY = 0.5, 1.0, 1.0, 13.0, 4.0, 1.25, 9.81
STIFFNESS, DAMPING, STROKE, OMEGA = 10_000.0, 100.0, 0.7, 2 * np.pi / 5.0

START = np.array([0.0, 0.0, np.pi / 6, 0.0, np.pi / 6])

MIRROR = np.array([1.0, 1.0, 1.0, 1.0, -1.0, 1.0])
"""MuJoCo's row = this × the paper's: the y axis of oar 3 points the other way on the mirrored side."""


def _oars(q):
    return (q[1:3], slice(0, 3), slice(1, 3)), (q[3:5], slice(3, 6), slice(3, 5))


def mass(q):
    return np.diag([J1, J2 * np.cos(q[2]) ** 2, J2, J2 * np.cos(q[4]) ** 2, J2])


def constraints(q):
    rows = np.zeros(6)
    for (psi, theta), row, _ in _oars(q):
        rows[row] = (
            R0 * np.sin(q[0]) + RH * np.cos(theta) * np.sin(psi),
            RH * np.sqrt(1 - (R0 / RH) ** 2) - RH * np.cos(psi) * np.cos(theta),
            R0 * np.cos(q[0]) - RH * np.sin(theta),
        )
    return rows


def jacobian(q):
    matrix = np.zeros((6, 5))
    for (psi, theta), row, column in _oars(q):
        matrix[row, 0] = R0 * np.cos(q[0]), 0.0, -R0 * np.sin(q[0])
        matrix[row, column] = [
            [RH * np.cos(theta) * np.cos(psi), -RH * np.sin(theta) * np.sin(psi)],
            [RH * np.sin(psi) * np.cos(theta), RH * np.cos(psi) * np.sin(theta)],
            [0.0, -RH * np.cos(theta)],
        ]
    return matrix


def curvature(q, v):
    """J̇v: the second derivative of the constraints along a motion without acceleration."""
    rows = np.zeros(6)
    for ((psi, theta), row, _), (yaw, pitch) in zip(_oars(q), (v[1:3], v[3:5]), strict=True):
        square, product = yaw**2 + pitch**2, 2 * yaw * pitch
        rows[row] = (
            -R0 * np.sin(q[0]) * v[0] ** 2
            - RH * (square * np.cos(theta) * np.sin(psi) + product * np.sin(theta) * np.cos(psi)),
            RH * (square * np.cos(psi) * np.cos(theta) - product * np.sin(psi) * np.sin(theta)),
            -R0 * np.cos(q[0]) * v[0] ** 2 + RH * np.sin(theta) * pitch**2,
        )
    return rows


def force(time, q, v):
    """Motor, gravity and the velocity forces."""
    target = OMEGA * time - STROKE * np.sin(OMEGA * time)
    target_dot = OMEGA * (1 - STROKE * np.cos(OMEGA * time))
    result = np.zeros(5)
    result[0] = -STIFFNESS * (q[0] - target) - DAMPING * (v[0] - target_dot)
    for (_, theta), _, column in _oars(q):
        yaw, pitch = v[column]
        result[column] = (
            J2 * yaw * pitch * np.sin(2 * theta),
            MASS * GRAVITY * CENTRE * np.cos(theta) - 0.5 * J2 * yaw**2 * np.sin(2 * theta),
        )
    return result


def acceleration(time, q, v):
    """Index-1 form, without stabilisation: a = M⁻¹(f − Gᵀμ), A μ = G M⁻¹ f + Ġv."""
    inverse, g = np.diag(1 / np.diag(mass(q))), jacobian(q)
    smooth = inverse @ force(time, q, v)
    multipliers = np.linalg.pinv(g @ inverse @ g.T, rcond=1e-9, hermitian=True) @ (g @ smooth + curvature(q, v))
    return smooth - inverse @ g.T @ multipliers
