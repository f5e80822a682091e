"""Regenerates reference.csv: the ankle of a leg that sways on its foot. No MuJoCo, no oarlock.

The foot stands on a rigid floor. Crank and rod are a parallelogram with shank and foot: a crank turns as the foot does,
so that it keeps its direction in space, and a rod stays parallel to the shank. With the shank leaning forward by ψ, the
ankle and both cranks are at −ψ, the cranks move with their pivots, and the rods turn about the heels:

    J = I + Σ m (x² + z²) + 2 (m_c h² + m_a + I_r + m_r h²/4)
    J ψ̈ = g (Σ m z + 2 m_c h + m_r h) sin ψ + g Σ m x cos ψ − 2 (kp (u(t) + ψ) + kv ψ̇)

with sums over shank and trunk, whose centres are at (x, z) from the ankle, the rods' length h and what a motor's rotor
adds, m_a. At rest upright the motors carry g Σ m x, half of it each. The floor carries all masses times g + z̈.

Run: python mjcf/standing_leg/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

GRAVITY = 9.81
MASSES, X, Z = np.array([3.0, 15.0]), np.array([0.0, 0.032]), np.array([0.25, 0.65])
"""Shank and trunk."""
INERTIA = MASSES @ np.array([0.04**2 + 0.5**2, 0.2**2 + 0.3**2]) / 12
CRANK, ROD, FOOT, LENGTH, ROTOR = 0.2, 0.1, 1.0, 0.3, 0.02
ROD_INERTIA = ROD * (0.01**2 + LENGTH**2) / 12
STIFFNESS, DAMPING = 200.0, 10.0
SWAY = 0.01
DURATION, INTERVAL = 1.0, 0.001

TURNED = INERTIA + MASSES @ (X**2 + Z**2) + 2 * (CRANK * LENGTH**2 + ROTOR + ROD_INERTIA + ROD * LENGTH**2 / 4)
FORWARD, UPWARD = MASSES @ X, MASSES @ Z + 2 * CRANK * LENGTH + ROD * LENGTH
HOLD = GRAVITY * FORWARD / 2 / STIFFNESS


def target(time):
    """Both motors' commanded angle (rad) at t (s)."""
    return HOLD - SWAY * (1 - np.cos(2 * np.pi * time))


def acceleration(time, psi, psi_dot):
    """ψ̈ (rad/s²) at t (s), ψ (rad) and ψ̇ (rad/s)."""
    weight = GRAVITY * (UPWARD * np.sin(psi) + FORWARD * np.cos(psi))
    return (weight - 2 * (STIFFNESS * (target(time) + psi) + DAMPING * psi_dot)) / TURNED


def floor(time, psi, psi_dot):
    """What the floor carries (N)."""
    psi_ddot, sin, cos = acceleration(time, psi, psi_dot), np.sin(psi), np.cos(psi)
    risen = -(FORWARD * cos + UPWARD * sin) * psi_ddot + (FORWARD * sin - UPWARD * cos) * psi_dot**2
    return (MASSES.sum() + FOOT + 2 * CRANK + 2 * ROD) * GRAVITY + risen


def main():
    """Writes reference.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    states = integrate_second(acceleration, (0.0, 0.0), times).T
    carried = [floor(time, *state) for time, state in zip(times, states, strict=True)]
    print(f"motors {GRAVITY * FORWARD / 2:.6f} N m at rest; leans by up to {max(states[:, 0]):.6f} rad")
    print(f"the floor carries {min(carried):.6f} to {max(carried):.6f} N, {carried[0]:.6f} N at the start")
    rows = [(-psi, -rate, -acceleration(time, psi, rate)) for time, (psi, rate) in zip(times, states, strict=True)]
    write(__file__, "equation of motion", 3, times, rows)


if __name__ == "__main__":
    main()
