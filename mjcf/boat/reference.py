"""Regenerates reference.csv: the boat's crank angle from its reduced equation of motion. No MuJoCo, no oarlock.

The handle of each oar runs on the circle of its crank, which lies on the sphere r_h about the oarlock:

    sin θ = ρ cos φ,   cos θ sin ψ = −ρ sin φ,   cos ψ cos θ = √(1 − ρ²),   ρ = r₀/r_h.

A thin rod about its end has the energy ½ J |u̇|² with u the unit vector along it, and |u̇| = ρ φ̇ here, so the
reduced inertia is constant. Gravity does m g r_c d(sin θ)/dφ = −m g r_c ρ sin φ an oar:

    (J₁ + (J₂ + J₃) ρ²) φ̈ = −c (φ − φ*) − d (φ̇ − φ̇*) − (m₂ + m₃) g r_c ρ sin φ,   φ* = ωt − k sin ωt.

Run: python mjcf/boat/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

CRANK_RADIUS, HANDLE_RADIUS = 0.5, 1.0
CRANK_INERTIA, OAR_INERTIA = 1.0, 13.0
OAR_MASS, OAR_CENTRE, GRAVITY = 4.0, 1.25, 9.81
STROKE, PERIOD = 0.7, 5.0
STIFFNESS, DAMPING = 10_000.0, 100.0
DURATION, INTERVAL = 12.0, 0.0025

RATIO = CRANK_RADIUS / HANDLE_RADIUS
OMEGA = 2 * np.pi / PERIOD
INERTIA = CRANK_INERTIA + 2 * OAR_INERTIA * RATIO**2
WEIGHT = 2 * OAR_MASS * GRAVITY * OAR_CENTRE * RATIO


def acceleration(time, phi, phi_dot):
    """φ̈ (rad/s²) at time (s), φ (rad) and φ̇ (rad/s)."""
    target = OMEGA * time - STROKE * np.sin(OMEGA * time)
    target_dot = OMEGA * (1 - STROKE * np.cos(OMEGA * time))
    motor = -STIFFNESS * (phi - target) - DAMPING * (phi_dot - target_dot)
    return (motor - WEIGHT * np.sin(phi)) / INERTIA


def solve(times):
    """φ and φ̇ at the times (s), from rest at φ = 0."""
    return integrate_second(acceleration, (0.0, 0.0), times)


def main():
    """Writes reference.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    phi, phi_dot = solve(times)
    rows = np.column_stack([phi, phi_dot, acceleration(times, phi, phi_dot)])
    write(__file__, "reduced equation of motion", 4, times, rows)


if __name__ == "__main__":
    main()
