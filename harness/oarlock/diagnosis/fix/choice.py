"""What a fix consists of, with what each part of it does."""

from dataclasses import dataclass, field

from oarlock.diagnosis.edit.changes import Change
from oarlock.diagnosis.fix.candidates import Offset
from oarlock.diagnosis.lint.collision import Collision
from oarlock.diagnosis.loops.poses import ClosedPose
from oarlock.diagnosis.runs.recipe import Recipe
from oarlock.diagnosis.runs.trials import Trial


@dataclass
class Choice:
    """The changes that a fix consists of.

    Attributes:
        changes: in the order in which they are told.
        effects: of each, a run without it and one with it: of settings with all others, of others before the settings.
        collisions: of exclusions; freeing: of those without which a servo does not move, why.
        offsets: of constants.
        reasons: of armatures and of equalities that are switched on, in words.
        pose: the closed one, with these constants.
        before: the file as it is; after: with all changes; both under the user's controls from the file's own start.
        elsewhere: with all changes under random controls.
        left_out: what was tried and did not help, in words.
        recipe: whose settings they are; None where none were looked for.
    """

    before: Trial
    after: Trial
    changes: list[Change] = field(default_factory=list)
    effects: dict[int, tuple[Trial, Trial]] = field(default_factory=dict)
    collisions: dict[int, Collision] = field(default_factory=dict)
    freeing: dict[int, str] = field(default_factory=dict)
    offsets: dict[int, Offset] = field(default_factory=dict)
    reasons: dict[int, str] = field(default_factory=dict)
    pose: ClosedPose | None = None
    elsewhere: list[Trial] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    recipe: Recipe | None = None

    @property
    def closed(self) -> bool:
        """Whether a pose near the start closes the loops."""
        return self.pose is not None and self.pose.closed
