"""Tolerances by kind of figure, with their causes: when a figure has changed, and which way is worse."""

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

Better = Literal["smaller", "larger", "neither"]


@dataclass(frozen=True)
class Kind:
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
    def tolerance(self) -> str:
        """The tolerance in words."""
        return f"{self.relative:g} relative, {self.floor:g} absolute"


_LAST_BITS = "another version or machine changes last bits, which moves a settled figure by far less than a hundredth"
_COUNTED = "a stopping test that is met by a hair hangs on the last bit"

_DRIFT = Kind("drift", "smaller", 0.01, 1e-12, f"{_LAST_BITS}; 1e-12 m or rad: a start counts as closed")
_DRIFT_VEL = replace(_DRIFT, floor=1e-11, cause=f"{_LAST_BITS}; 1e-11: rounding at speeds of 100 per s")
_DRIFT_ACC = replace(_DRIFT, floor=1e-8, cause=f"{_LAST_BITS}; 1e-8: rounding at 1e4 per s², times the condition of A")
_ENERGY = Kind("energy", "smaller", 0.01, 1e-10, f"{_LAST_BITS}; 1e-10: rounding added up over a run")
_TRUTH = Kind("truth", "smaller", 0.01, 1e-10, f"{_LAST_BITS}; 1e-10: to which outside truths are known")
_PARITY = Kind("parity", "smaller", 0.1, 1e-7, "MuJoCo's Newton keeps a start within its tolerance of 1e-8 as it is")
_WALK = Kind("parity", "smaller", 0.1, 1e-10, "rounding that a passage through dead points magnifies a thousandfold")
_APART = Kind("comparison", "neither", 0.01, 1e-9, f"{_LAST_BITS}; how far soft and exact are apart is no fault")
_NORM = Kind("multipliers", "smaller", 0.1, 1e-8, "sr1 stops at 1e-8, and what it carries hangs on the last bits")
_RESIDUAL = Kind("solver", "smaller", 0.25, 1e-8, "below its stopping tolerance of 1e-8 a residual is as good as any")
_QUESTION = Kind("question", "neither", 0.05, 1e-9, "how far b is outside the range of A: noise where A is redundant")
_MEAN = Kind("solver", "smaller", 0.05, 0.05, f"iterations a solve; {_COUNTED}")
_MOST = Kind("solver", "smaller", 0.25, 2.0, f"of one solve; {_COUNTED}")
_RESTARTS = Kind("solver", "smaller", 0.25, 3.0, f"restarts of a run; {_COUNTED}")
_GIVEN_UP = Kind("solver", "smaller", 0.1, 1.0, f"solves or projections of a run that did not converge; {_COUNTED}")
_WHOLE = Kind("structure", "neither", 0.0, 0.0, "a whole number")
_MOVED = Kind("structure", "neither", 0.01, 1e-9, "how far closing moved the start")
_LENGTH = Kind("status", "neither", 0.0, 0.0, "a whole number")
_TIME = Kind("timing", "smaller", math.inf, 0.0, "reported; judged only with a factor")

APART = replace(_WALK, group="trajectory", better="neither", relative=0.0)
"""Largest distance between the coordinates of a run and its counterpart, by the tables of steps. Its floor decides."""

FIGURES: dict[str, Kind] = {
    "drift_pos_max": _DRIFT,
    "drift_vel_max": _DRIFT_VEL,
    "drift_acc_max": _DRIFT_ACC,
    "projection_moved_max": _DRIFT,
    "energy_drift_rel": _ENERGY,
    "truth_error_max": _TRUTH,
    "published_position_error_max": _TRUTH,
    "published_velocity_error_rel_max": _TRUTH,
    "published_multiplier_error_rel_max": _TRUTH,
    "qacc_rel_diff_max": _PARITY,
    "qfrc_constraint_rel_diff_max": _PARITY,
    "trajectory_diff_max": _WALK,
    "min_norm_error_max": _NORM,
    "min_norm_error_median": _NORM,
    "residual_rel_max": _RESIDUAL,
    "inconsistency_max": _QUESTION,
    "iterations_mean": _MEAN,
    "iterations_max": _MOST,
    "projection_rounds_mean": _MEAN,
    "projection_rounds_max": _MOST,
    "projection_iterations_mean": _MEAN,
    "refreshes": _RESTARTS,
    "refolds": _RESTARTS,
    "unconverged": _GIVEN_UP,
    "unprojected": _GIVEN_UP,
    "rank_min": _WHOLE,
    "rank_max": _WHOLE,
    "nv": _WHOLE,
    "rows": _WHOLE,
    "rank": _WHOLE,
    "dof": _WHOLE,
    "closing_moved": _MOVED,
    "steps_done": _LENGTH,
    "solve_ns_median": _TIME,
    "step_us_median": _TIME,
}
"""Figure of a summary → how it is judged. The other columns identify the run or follow from these."""

_UNKNOWN = Kind("other", "neither", 0.01, 1e-12, "a figure that this oarlock does not know")


def kind_of(figure: str, before: dict[str, Any], after: dict[str, Any], timings: float | None = None) -> Kind:
    """Returns how a figure of a run and its counterpart is judged.

    Args:
        figure: its name in the summary.
        before: summary row of the run.
        after: summary row of its counterpart.
        timings: factor by which timings may change; None to leave them unjudged.
    """
    kind = FIGURES.get(figure, _UNKNOWN)
    matched = before["form"] == after["form"] == "matched" or before["mode"] == after["mode"] == "calibration"
    if kind.group == "parity" and not matched:
        # Exact constraints differ from soft ones, and MuJoCo's solvers from each other, for good reasons.
        return _APART
    if kind is _LENGTH and before["status"] == after["status"] == "diverged":
        return replace(kind, better="larger", cause="steps until it diverged")
    if kind is _TIME and timings is not None:
        return replace(kind, relative=timings - 1.0, cause="--timings")
    return kind
