"""Regenerates claims.json: what the paper says of its boat, held against its own formulas. No MuJoCo, no oarlock.

Rows of an oar (ψ, θ), two oars; G is their Jacobian in q = (φ, ψ₂, θ₂, ψ₃, θ₃), and M the mass matrix:

    g₁ = r₀ sin φ + r_h cos θ sin ψ,   g₂ = √(r_h² − r₀²) − r_h cos ψ cos θ,   g₃ = r₀ cos φ − r_h sin θ.

Run: python mjcf/boat/claims.py
"""

import json
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from reference import CRANK_INERTIA, CRANK_RADIUS, DURATION, HANDLE_RADIUS, OAR_INERTIA, RATIO, solve

TIMESTEP = 1e-3
ZERO = 1e-9
"""A singular value of G below this part of the largest is zero: the others are a tenth of it or more."""

STATES, SEED, DIFFERENCE = 1000, 1, 1e-6
"""Random states off the motion, and the step of central differences (rad), whose error is its square."""


def constraints(q):
    """Rows g (…, 6) in m at states q (…, 5) in rad."""
    phi, oars = q[..., 0], (q[..., 1:3], q[..., 3:5])
    rows = []
    for psi, theta in ((oar[..., 0], oar[..., 1]) for oar in oars):
        rows += [
            CRANK_RADIUS * np.sin(phi) + HANDLE_RADIUS * np.cos(theta) * np.sin(psi),
            np.sqrt(HANDLE_RADIUS**2 - CRANK_RADIUS**2) - HANDLE_RADIUS * np.cos(psi) * np.cos(theta),
            CRANK_RADIUS * np.cos(phi) - HANDLE_RADIUS * np.sin(theta),
        ]
    return np.stack(rows, axis=-1)


def differences(q):
    """G (…, 6, 5) at states q (…, 5), by central differences of the rows."""
    steps = DIFFERENCE * np.eye(5)
    columns = [(constraints(q + step) - constraints(q - step)) / (2 * DIFFERENCE) for step in steps]
    return np.stack(columns, axis=-1)


def jacobian(q):
    """G (…, 6, 5) at states q (…, 5)."""
    matrix = np.zeros((*q.shape[:-1], 6, 5))
    for row, column in ((0, 1), (3, 3)):
        psi, theta = q[..., column], q[..., column + 1]
        matrix[..., row, 0] = CRANK_RADIUS * np.cos(q[..., 0])
        matrix[..., row + 2, 0] = -CRANK_RADIUS * np.sin(q[..., 0])
        matrix[..., row, column] = HANDLE_RADIUS * np.cos(theta) * np.cos(psi)
        matrix[..., row, column + 1] = -HANDLE_RADIUS * np.sin(theta) * np.sin(psi)
        matrix[..., row + 1, column] = HANDLE_RADIUS * np.sin(psi) * np.cos(theta)
        matrix[..., row + 1, column + 1] = HANDLE_RADIUS * np.cos(psi) * np.sin(theta)
        matrix[..., row + 2, column + 1] = -HANDLE_RADIUS * np.cos(theta)
    return matrix


def mass(q):
    """Diagonal of M (…, 5)."""
    crank, oar = np.full(q.shape[:-1], CRANK_INERTIA), np.full(q.shape[:-1], OAR_INERTIA)
    yaws = (OAR_INERTIA * np.cos(q[..., 2]) ** 2, OAR_INERTIA * np.cos(q[..., 4]) ** 2)
    return np.stack([crank, yaws[0], oar, yaws[1], oar], axis=-1)


def motion():
    """States (steps, 5) of the closed mechanism every timestep; both oars are at the same angles."""
    phi, _ = solve(np.arange(round(DURATION / TIMESTEP) + 1) * TIMESTEP)
    psi = np.arctan2(-RATIO * np.sin(phi), np.sqrt(1 - RATIO**2))
    theta = np.arcsin(RATIO * np.cos(phi))
    return np.stack([phi, psi, theta, psi, theta], axis=-1)


def along_oars(q):
    """Orthonormal directions (…, 6, 2) in the space of λ: the force at a pin that points along its oar."""
    directions = np.zeros((*q.shape[:-1], 6, 2))
    for index, row, column in ((0, 0, 1), (1, 3, 3)):
        psi, theta = q[..., column], q[..., column + 1]
        handle = (np.cos(theta) * np.sin(psi), -np.cos(theta) * np.cos(psi), -np.sin(theta))
        directions[..., row : row + 3, index] = np.stack(handle, axis=-1)
    return directions


def claim(said, holds, instead, figures):
    """A claim, whether it holds, what is so instead, and the figures that say it, each with what it is."""
    measured = [{"what": what, "value": value} for what, value in figures.items()]
    return {"claim": said, "holds": bool(holds), "instead": instead, "figures": measured}


def uniqueness(q):
    """λ has a family of values; Gᵀλ, and with it the acceleration, has one."""
    g = jacobian(q)
    values = np.linalg.svd(g, compute_uv=False)
    ranks = (values > ZERO * values[:, :1]).sum(axis=1)
    free = g.shape[1] - ranks
    axes = along_oars(q)
    least = values[np.arange(len(q)), ranks - 1]
    moved = np.linalg.norm(np.swapaxes(g, 1, 2) @ axes, ord=2, axis=(1, 2)) / least
    return claim(
        "The multipliers λ are unique.",
        free.max() == 0,
        "The accelerations and the generalised force Gᵀλ are, and of the force at a pin the two components across "
        "its oar; the one along it is free.",
        {
            "dimensions of the set of λ": int(free.min()),
            "largest ‖Gᵀ n‖ over the least singular value of G, n along an oar": moved.max(),
        },
    )


def misprint():
    """∂g₆/∂θ₃, as printed and as it is."""
    anywhere = np.random.default_rng(SEED).uniform(-1.0, 1.0, (STATES, 5))
    derivative = differences(anywhere)
    printed = jacobian(anywhere)
    printed[..., 5, 4] = -HANDLE_RADIUS * np.cos(anywhere[..., 2])
    wrong, right = (np.abs(matrix - derivative) for matrix in (printed, jacobian(anywhere)))
    return claim(
        "G₆₅ = −r_h cos θ₂.",
        wrong[:, 5, 4].max() <= ZERO,
        "G₆₅ = −r_h cos θ₃. Both oars obey sin θ = ρ cos φ, so that θ₂ = θ₃ along the motion, and the misprint hides.",
        {
            "largest error as printed, θ₂ and θ₃ free (m/rad)": wrong[:, 5, 4].max(),
            "with θ₃ (m/rad)": right[:, 5, 4].max(),
            "of all other entries of G (m/rad)": np.delete(wrong.reshape(STATES, -1), 29, axis=1).max(),
        },
    )


def hypotheses(q):
    """Of the theorem on SR1 updates: the signs of F = A(t + 1 ms) − A(t) on range(A), and its size."""
    g = jacobian(q)
    a = g / mass(q)[:, None, :] @ np.swapaxes(g, 1, 2)
    values, vectors = np.linalg.eigh(a)
    change, least, basis = a[1:] - a[:-1], values[:-1, 2], vectors[:-1, :, 2:]
    signs = np.linalg.eigvalsh(np.swapaxes(basis, 1, 2) @ change @ basis)
    # Where the crank turns back the matrix hardly changes: what is left is rounding, and has no sign.
    moving = np.abs(signs).max(axis=1) > ZERO * values[:-1, -1]
    smaller, larger = np.sort(np.abs(signs[moving][:, [0, -1]]), axis=1).T
    size = np.linalg.norm(change, ord=2, axis=(1, 2)) / least
    return [
        claim(
            "A changes by a matrix F of one sign from step to step (hypothesis of the theorem).",
            (signs[moving, 0] * signs[moving, -1] >= 0).all(),
            "F has both signs in every step; the algorithm converges all the same.",
            {"smaller over larger of the extreme eigenvalues of F on range(A), least": (smaller / larger).min()},
        ),
        claim(
            "‖F‖ < 1/‖A⁺‖ (hypothesis of the theorem).",
            size.max() < 1,
            "",
            {"largest ‖F‖ ‖A⁺‖ at 1 ms": size.max()},
        ),
    ]


def claims():
    """All of them."""
    q = motion()
    return [uniqueness(q), misprint(), *hypotheses(q)]


def main():
    """Writes claims.json beside this file."""
    text = json.dumps(claims(), ensure_ascii=False, indent=1)
    Path(__file__).with_name("claims.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
