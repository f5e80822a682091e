"""How figures of two runs are judged against each other: tolerances, each with its cause."""

import math
from dataclasses import dataclass, replace
from typing import Literal

Better = Literal["smaller", "larger", "neither"]


@dataclass(frozen=True)
class Tolerance:
    """How a figure is judged: two values below the floor are the same, otherwise their ratio decides.

    Attributes:
        group: what the figure is about; a test case of the JUnit report is a run and a group.
        better: which way is better, or ``neither`` if a change is reported but is no loss.
        relative: the ratio may be up to 1 + ``relative``.
        floor: value in the figure's unit below which it is rounding.
        cause: why the tolerance has these numbers.
    """

    group: str
    better: Better
    relative: float
    floor: float
    cause: str

    def factor(self, before: float, after: float) -> float:
        """Computes after over before, both raised to the floor."""
        low, high = max(abs(before), self.floor), max(abs(after), self.floor)
        return high / low if low > 0 else (math.inf if high > 0 else 1.0)

    def verdict(self, before: float, after: float) -> str:
        """Judges a change: ``same``, ``worse``, ``better`` or ``changed``."""
        factor = self.factor(before, after)
        if 1.0 / (1.0 + self.relative) <= factor <= 1.0 + self.relative:
            return "same"
        if self.better == "neither":
            return "changed"
        return "worse" if (factor > 1.0) is (self.better == "smaller") else "better"

    @property
    def words(self) -> str:
        """The tolerance in words."""
        return f"{self.relative:g} relative, {self.floor:g} absolute"


_LAST_BITS = "another version or machine changes last bits, which moves a settled figure by far less than a hundredth"
_COUNTED = "a stopping test that is met by a hair hangs on the last bit"

DRIFT = Tolerance("drift", "smaller", 0.01, 1e-12, f"{_LAST_BITS}; 1e-12 m or rad: a start counts as closed")
DRIFT_VEL = replace(DRIFT, floor=1e-11, cause=f"{_LAST_BITS}; 1e-11: rounding at speeds of 100 per s")
DRIFT_ACC = replace(DRIFT, floor=1e-8, cause=f"{_LAST_BITS}; 1e-8: rounding at 1e4 per s², times the condition of A")
ENERGY = Tolerance("energy", "smaller", 0.01, 1e-10, f"{_LAST_BITS}; 1e-10: rounding added up over a run")
TRUTH = Tolerance("truth", "smaller", 0.01, 1e-10, f"{_LAST_BITS}; 1e-10: to which outside truths are known")
ESTIMATE = Tolerance("error", "smaller", 0.1, 1e-10, "rounding of two walks that dead points magnify a thousandfold")
PARITY = Tolerance(
    "parity", "smaller", 0.1, 1e-7, "MuJoCo's Newton keeps a start within its tolerance of 1e-8 as it is"
)
WALK = Tolerance(
    "parity", "smaller", 0.1, 1e-10, "rounding that a passage through dead points magnifies a thousandfold"
)
APART = Tolerance("comparison", "neither", 0.01, 1e-9, f"{_LAST_BITS}; how far soft and exact are apart is no fault")
NORM = Tolerance("multipliers", "smaller", 0.1, 1e-8, "sr1 stops at 1e-8, and what it carries hangs on the last bits")
RESIDUAL = Tolerance(
    "solver", "smaller", 0.25, 1e-8, "below its stopping tolerance of 1e-8 a residual is as good as any"
)
QUESTION = Tolerance(
    "question", "neither", 0.05, 1e-9, "how far b is outside the range of A: noise where A is redundant"
)
MEAN = Tolerance("solver", "smaller", 0.05, 0.05, f"iterations a solve; {_COUNTED}")
MOST = Tolerance("solver", "smaller", 0.25, 2.0, f"of one solve; {_COUNTED}")
RESTARTS = Tolerance("solver", "smaller", 0.25, 3.0, f"restarts of a run; {_COUNTED}")
GIVEN_UP = Tolerance("solver", "smaller", 0.1, 1.0, f"solves or projections of a run that did not converge; {_COUNTED}")
FORCE = Tolerance("forces", "neither", 0.05, 1e-9, "an impact hangs on where in a step it falls")
WHOLE = Tolerance("structure", "neither", 0.0, 0.0, "a whole number")
MARGIN = Tolerance(
    "structure", "neither", 9.0, 1e4, "how far an eigenvalue stays from the rank cut, where it comes within 1e4 of it"
)
EVENT = Tolerance("structure", "neither", 0.01, 1e-9, "when something happens: steps are not finer")
MOVED = Tolerance("structure", "neither", 0.01, 1e-9, "how far closing moved the start")
LENGTH = Tolerance("status", "neither", 0.0, 0.0, "a whole number")
TIME = Tolerance("timing", "smaller", math.inf, 0.0, "reported; judged only with a factor")
UNKNOWN = Tolerance("other", "neither", 0.01, 1e-12, "a figure that this oarlock does not know")
