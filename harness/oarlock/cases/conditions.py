"""Under which conditions a case is run, where they are not its own."""

from dataclasses import dataclass

from oarlock.cases.case import Case
from oarlock.cases.motion import RULE, Motion
from oarlock.cases.point import SEED, SOLREF, TIMESTEP, Point


@dataclass(frozen=True)
class Conditions:
    """What of a run differs from what its case says; None: nothing.

    Attributes:
        timestep_s: timestep, s.
        duration_s: duration, s. It may be shorter than a timestep, which is one step, while the case's own may not.
        ignore_inequalities: leave out the model's contacts, limits and friction, whatever the case says.
        solref_s: time constant of every equality, s, with the damping ratio 1.
        seed: of a disturbance of the start.
        motion: where it starts and what drives it.
    """

    timestep_s: float | None = None
    duration_s: float | None = None
    ignore_inequalities: bool = False
    solref_s: float | None = None
    seed: int | None = None
    motion: Motion = RULE

    @classmethod
    def at(cls, point: Point) -> "Conditions":
        """Those of a point of a sweep."""
        return cls(timestep_s=point.get(TIMESTEP), solref_s=point.get(SOLREF), seed=point.get(SEED))

    def own(self, case: Case) -> bool:
        """Whether they are the case's own, for which its bounds were set."""
        run = case.file.run
        given = self.timestep_s in (None, run.timestep_s) and self.duration_s in (None, run.duration_s)
        return given and self.solref_s is None and self.seed is None and not self.motion.given


OWN = Conditions()
"""The case as it is."""
