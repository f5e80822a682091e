"""Regenerates reference.csv: the angle between a scissor lift's legs while it lifts its load. No MuJoCo, no oarlock.

On a rigid floor without friction the lift stands level; its centre of mass never moves sideways. With both legs at a
slope θ the crossing M is at half the height ℓ sin θ, the platform's hinge at (−ℓ cos θ, ℓ sin θ)/2 from M, the shoe at
(ℓ cos θ, ℓ sin θ)/2, and M stands where the centre of mass stays. With derivatives by θ of the places cᵢ of all masses

    m(θ) = Σ mᵢ |c'ᵢ|² + 2 I,   m θ̈ = −Σ mᵢ c'ᵢ·c''ᵢ θ̇² − Σ mᵢ g c'ᵢ,z − P w',   P = kp (w − u(t)) + c ẇ

where I is a leg's moment of inertia, w = ℓ cos θ the distance of the feet and P the jack's pull. At rest P is
(platform, load, shoe and one leg's weight) · cot θ: a leg's middle rises half as much as the platform.
The floor carries Σ mᵢ (g + z̈ᵢ).

Run: python mjcf/scissor_lift/reference.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from _truth import grid, integrate_second, write

LENGTH, WIDTH, DENSITY, GRAVITY = 1.0, 0.03, 2700.0, 9.81
LEG = DENSITY * WIDTH**2 * LENGTH
INERTIA = LEG * (LENGTH**2 + WIDTH**2) / 12
MASSES = np.array([LEG, LEG, 4.0, 20.0, 0.1])
"""Legs, platform, load, shoe."""
ALONG = np.array([0.0, 0.0, -0.5, -0.5, 0.5]) * LENGTH
"""Their places to the right of the crossing, times cos θ; constant offsets do not move."""
UP = np.array([0.5, 0.5, 1.0, 1.0, 1.0]) * LENGTH
"""Their heights, times sin θ."""
STIFFNESS, DAMPING = 50000.0, 1000.0
START = np.arcsin(0.6)
PULL = (MASSES.sum() - LEG) * GRAVITY / np.tan(START)
DRAWN = 0.1
DURATION, INTERVAL = 1.0, 0.001


def target(time):
    """The jack's target (m) at t (s)."""
    return LENGTH * np.cos(START) - PULL / STIFFNESS - DRAWN * (1 - np.cos(np.pi * time))


def acceleration(time, theta, theta_dot):
    """θ̈ (rad/s²) at t (s), θ (rad) and θ̇ (rad/s)."""
    sin, cos = np.sin(theta), np.cos(theta)
    sideways = ALONG - MASSES @ ALONG / MASSES.sum()
    first = np.array([-sideways * sin, UP * cos])
    second = np.array([-sideways * cos, -UP * sin])
    inertia = (MASSES * first**2).sum() + 2 * INERTIA
    pull = STIFFNESS * (LENGTH * cos - target(time)) - DAMPING * LENGTH * sin * theta_dot
    force = -(MASSES * first * second).sum() * theta_dot**2 - MASSES @ first[1] * GRAVITY + pull * LENGTH * sin
    return force / inertia


def floor(time, theta, theta_dot):
    """What the floor carries (N)."""
    risen = np.cos(theta) * acceleration(time, theta, theta_dot) - np.sin(theta) * theta_dot**2
    return MASSES.sum() * GRAVITY + MASSES @ UP * risen


def main():
    """Writes reference.csv beside this file."""
    times = grid(DURATION, INTERVAL)
    states = integrate_second(acceleration, (START, 0.0), times).T
    carried = [floor(time, *state) for time, state in zip(times, states, strict=True)]
    print(f"pull at rest {PULL:.6f} N; the floor carries {min(carried):.6f} to {max(carried):.6f} N")
    # The joint between the legs turns back by twice their slope.
    rows = [
        (-2 * (theta - START), -2 * rate, -2 * acceleration(time, theta, rate))
        for time, (theta, rate) in zip(times, states, strict=True)
    ]
    write(__file__, "reduced equation of motion", 3, times, rows)


if __name__ == "__main__":
    main()
