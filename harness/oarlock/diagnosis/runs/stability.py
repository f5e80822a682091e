"""What a solref and a solimp make of a row in a step: stiffness, damping, impedance, and whether the step is stable.

MuJoCo computes a row's K and B from its solref and solimp (dmax is solimp[1], and tc and dr are the two numbers of a
positive solref):

    solref = (tc, dr) > 0:    K = 1/(dmax² tc² dr²),  B = 2/(dmax tc);  refsafe raises tc to 2 h
    solref = (−k, −b) ≤ 0:    K = k/dmax²,            B = b/dmax;       nothing guards them

Without compliance a row obeys r̈ = −B ṙ − K d r, sampled once a step. Under Euler and the implicit integrators, which
take the constraint force as it was at the start of the step, that is stable exactly for h²K d + 2hB < 4; under
Runge–Kutta where |1 + z + z²/2 + z³/6 + z⁴/24| < 1 at both roots of z² + hB z + h²K d = 0. Compliance takes from both
terms: a row that is stable without it stays so, and near the limit a soft one may be stable where this says it is not.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.cases.integrators import INTEGRATORS
from oarlock.mechanics.prepare import integrator_of
from oarlock.poses.layout import Layout

MIN_IMPEDANCE, MAX_IMPEDANCE = 1e-4, 0.9999
"""MuJoCo's bounds of solimp's impedances and midpoint (mjMINIMP, mjMAXIMP)."""

_TINY = 1e-15
"""mjMINVAL."""

DEFAULT_SOLREF = (0.02, 1.0)
"""What MuJoCo takes where a solref mixes signs."""


@dataclass(frozen=True)
class RowSettings:
    """A solref and a solimp as they take effect at a timestep.

    Attributes:
        given: solref as written; effective: as MuJoCo takes it.
        solimp: as MuJoCo takes it, clamped.
        stiffness: K, 1/s²; damping: B, 1/s.
    """

    given: tuple[float, float]
    effective: tuple[float, float]
    solimp: tuple[float, float, float, float, float]
    timestep_s: float
    stiffness: float
    damping: float

    @classmethod
    def of(cls, solref: np.ndarray, solimp: np.ndarray, timestep_s: float, refsafe: bool = True) -> "RowSettings":
        """From numbers as in ``eq_solref`` (2) and ``eq_solimp`` (5)."""
        first, second = (float(number) for number in solref)
        given = first, second
        if (first > 0.0) != (second > 0.0):
            first, second = DEFAULT_SOLREF
        if refsafe and first > 0.0:
            first = max(first, 2.0 * timestep_s)
        bounded = clamped(solimp)
        largest = bounded[1]
        if first > 0.0:
            stiffness = 1.0 / max(_TINY, largest**2 * first**2 * second**2)
            damping = 2.0 / max(_TINY, largest * first)
        else:
            stiffness, damping = -first / max(_TINY, largest**2), -second / max(_TINY, largest)
        return cls(given, (first, second), bounded, timestep_s, stiffness, damping)

    @property
    def changed(self) -> bool:
        """Whether MuJoCo silently takes another solref than what was written."""
        return self.given != self.effective

    def growth(self, integrator: str) -> float:
        """Factor by which a step multiplies a row's deviation, at worst: stable below 1."""
        return growth(self.spring, self.damping, self.timestep_s, integrator)

    @property
    def spring(self) -> float:
        """K d where d is largest, 1/s²."""
        return self.stiffness * max(self.solimp[:2])

    def impedance(self, deviation: np.ndarray | float) -> np.ndarray:
        """Impedance d where an equality is off by so much: the norm over its rows, any shape."""
        return impedance(self.solimp, deviation)


@dataclass(frozen=True)
class EqualityStability:
    """One equality's settings at the model's timestep and integrator.

    Attributes:
        number: h²K d + 2hB, which Euler and the implicit integrators need below 4.
        growth: factor by which a step multiplies a deviation, at worst.
    """

    name: str
    settings: RowSettings
    integrator: str
    number: float
    growth: float

    @property
    def stable(self) -> bool:
        """Whether deviations fade."""
        return self.growth < 1.0


def clamped(solimp: np.ndarray) -> tuple[float, float, float, float, float]:
    """A solimp (5) as MuJoCo takes it."""
    low, high, width, middle, power = (float(number) for number in solimp)
    low, high, middle = (min(max(value, MIN_IMPEDANCE), MAX_IMPEDANCE) for value in (low, high, middle))
    return low, high, max(0.0, width), middle, max(1.0, power)


def impedance(solimp: tuple[float, float, float, float, float], deviation: np.ndarray | float) -> np.ndarray:
    """Impedance d of a clamped solimp: from solimp[0] at 0 to solimp[1] at its width, by two powers.

    All rows of an equality have the impedance of the norm of their deviations, a weld's lengths and angles in one.
    """
    low, high, width, middle, power = solimp
    deviation = np.asarray(deviation, dtype=float)
    if low == high or width <= _TINY:
        return np.full(deviation.shape, 0.5 * (low + high))
    x = np.minimum(np.abs(deviation) / width, 1.0)
    rising = x**power / middle ** (power - 1.0)
    falling = 1.0 - (1.0 - x) ** power / (1.0 - middle) ** (power - 1.0)
    return low + (high - low) * np.where(x <= middle, rising, falling)


def growth(spring: float, damping: float, timestep_s: float, integrator: str) -> float:
    """Spectral radius of a step of r̈ = −B ṙ − k r under one of MuJoCo's integrators."""
    scaled, damper = timestep_s**2 * spring, timestep_s * damping
    if not np.isfinite(scaled + damper):
        return float("inf")
    if INTEGRATORS[integrator].holds_force:
        factors = np.roots([1.0, scaled + damper - 2.0, 1.0 - damper])
    else:
        z = np.roots([1.0, damper, scaled])
        factors = np.sum([z**power / divisor for power, divisor in enumerate(INTEGRATORS[integrator].divisors)], axis=0)
    return float(np.abs(factors).max())


def refsafe(model: mujoco.MjModel) -> bool:
    """Whether MuJoCo raises time constants that are too short for the timestep."""
    return not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE


def stability(model: mujoco.MjModel) -> list[EqualityStability]:
    """Of every equality that is active at the start, at the model's own timestep and integrator."""
    timestep, integrator, safe = float(model.opt.timestep), integrator_of(model).name, refsafe(model)
    found = []
    for equality in Layout.of(model).equalities:
        index = equality.index
        settings = RowSettings.of(model.eq_solref[index], model.eq_solimp[index], timestep, safe)
        number = timestep**2 * settings.spring + 2.0 * timestep * settings.damping
        found.append(EqualityStability(equality.name, settings, integrator, number, settings.growth(integrator)))
    return found
