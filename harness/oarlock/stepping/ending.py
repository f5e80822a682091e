"""How a walk came to an end before its last step."""

import re
from dataclasses import dataclass

from oarlock.base.errors import InputError, RefusedError, one_line
from oarlock.mechanics.bounds import HUGE

NOT_FINITE = f"the state is no longer finite, or beyond MuJoCo's bound of {HUGE:g}"

_UNANSWERED = re.compile(r"solver '([^']+)': ")
"""What the message begins with of a solver that somebody brought along and that did not answer."""


@dataclass(frozen=True)
class Ending:
    """What ended a walk before its last step.

    Attributes:
        step: number of the step that it ended in; the table has the rows before it, and its own if it was taken.
        time_s: time of the state it was left at.
        error: why: a ``RefusedError`` if the model must not be run like this, another ``InputError`` if a question had
            no answer; None if the state is beyond the bound, or not finite.
    """

    step: int
    time_s: float
    error: InputError | None = None

    @property
    def reason(self) -> str:
        """Why, in one line."""
        return NOT_FINITE if self.error is None else one_line(self.error)

    @property
    def solver(self) -> str | None:
        """Name of the solver of somebody's own that did not answer; None if it was something else."""
        named = None if self.error is None else _UNANSWERED.match(self.reason)
        return named[1] if named and not isinstance(self.error, RefusedError) else None

    def message(self) -> str:
        """When and why, for a run that counts all the same, as that of a solver of one's own does from its first step.

        Raises:
            RefusedError: the model must not be run like this.
            InputError: its first question had no answer already, from none of the solvers here.
        """
        if self.error is not None and self.solver is None and (self.step == 0 or isinstance(self.error, RefusedError)):
            raise self.error
        return f"step {self.step}, t = {self.time_s:.6g} s: {self.reason}"
