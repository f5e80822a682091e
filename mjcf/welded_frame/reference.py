"""Regenerates reference.csv: the first leg's angle from the reduced equation of motion. No MuJoCo, no oarlock.

In a leg of two uniform links of length l and mass m the lower one leans by ψ and the upper by −ψ, and the platform
stands at 2 l cos ψ. The leg's energy is ½ J(ψ) ψ̇² + 2 m g l cos ψ + ½ k (ψ − ψ₀)² with J = m l² (2/3 + 2 sin²ψ): about
the base m l²/3, above the knee m (¼ l² cos²ψ + 9/4 l² sin²ψ) + m l²/12. The second leg, of length l₂, reaches as high,

    l₂ cos ψ₂ = l₁ cos ψ₁,   ψ₂' = l₁ sin ψ₁ / (l₂ sin ψ₂),   ψ₂'' = (l₁/l₂ cos ψ₁ − cos ψ₂ ψ₂'²) / sin ψ₂

by ψ₁. With the platform's mass M (lug included) the energy is ½ I ψ̇₁² + V, so that I ψ̈₁ + ½ I' ψ̇₁² + V' = 0, with

    I = J₁ + 4 M l₁² sin²ψ₁ + J₂ ψ₂'².

Run: python mjcf/welded_frame/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

LENGTHS, LINK_MASS, PLATFORM_MASS = (0.4, 0.5), 0.6, 2.0
STIFFNESS, SPRING_ZERO = 25.0, 0.3
GRAVITY, START = 9.81, 0.75
DURATION, INTERVAL = 8.0, 0.004


def second_leg(psi):
    """ψ₂ (rad) and its first two derivatives by ψ₁."""
    ratio = LENGTHS[0] / LENGTHS[1]
    other = np.arccos(ratio * np.cos(psi))
    first = ratio * np.sin(psi) / np.sin(other)
    return other, first, (ratio * np.cos(psi) - np.cos(other) * first**2) / np.sin(other)


def _leg(psi, length):
    """J (kg m²), dJ/dψ and dV/dψ of one leg, its spring in V."""
    size = LINK_MASS * length**2
    fall = -2 * LINK_MASS * GRAVITY * length * np.sin(psi) + STIFFNESS * (psi - SPRING_ZERO)
    return size * (2 / 3 + 2 * np.sin(psi) ** 2), 4 * size * np.sin(psi) * np.cos(psi), fall


def acceleration(psi, rate):
    """ψ̈₁ (rad/s²) at ψ₁ (rad) and ψ̇₁ (rad/s)."""
    other, first, second = second_leg(psi)
    inertia1, slope1, fall1 = _leg(psi, LENGTHS[0])
    inertia2, slope2, fall2 = _leg(other, LENGTHS[1])
    platform = 4 * PLATFORM_MASS * LENGTHS[0] ** 2
    inertia = inertia1 + platform * np.sin(psi) ** 2 + inertia2 * first**2
    slope = slope1 + 2 * platform * np.sin(psi) * np.cos(psi) + slope2 * first**3 + 2 * inertia2 * first * second
    fall = fall1 + fall2 * first - 2 * PLATFORM_MASS * GRAVITY * LENGTHS[0] * np.sin(psi)
    return -(0.5 * slope * rate**2 + fall) / inertia


def solve(times):
    """ψ₁ and ψ̇₁ at the times (s), from rest at ψ₁ = 0.75."""
    return integrate_second(lambda _, *state: acceleration(*state), (START, 0.0), times)


def main():
    """Writes reference.csv beside this file, and prints the start of case.toml."""
    times = grid(DURATION, INTERVAL)
    psi, rate = solve(times)
    write(__file__, "reduced equation of motion", 4, times, np.column_stack([psi, rate, acceleration(psi, rate)]))
    other = second_leg(START)[0]
    print(f"base2 = top2 = {other:.16g}, knee2 = {-2 * other:.16g}")


if __name__ == "__main__":
    main()
