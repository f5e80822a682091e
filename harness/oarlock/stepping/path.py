"""What a path of stepping is: one protocol for both, what it is given, and what it gives back."""

from collections.abc import Callable
from functools import partial
from typing import Protocol

from oarlock.base.core import MultiplierSolver
from oarlock.cases.case_file import Form
from oarlock.stepping.ending import Ending
from oarlock.stepping.solvers import BESIDE, SolverSpec
from oarlock.tables import spool
from oarlock.tables.schema import SCHEMA
from oarlock.tables.spool import Spool

Make = Callable[[SolverSpec], MultiplierSolver]
"""Makes a solver with the defaults of the case."""


Tick = Callable[[int], None]
"""Called with the number of steps just done."""


Spools = Callable[[int], list[Spool]]
"""Makes a spool for each table of one walk."""


Tables = tuple[list[Spool], Ending | None]
"""A table for each who answers, and what ended the walk before its last step, if anything did."""


TICK_STEPS = 200
"""Steps between two reports of progress, and between two looks at interruptions."""

SOLVER_BESIDE = SolverSpec(BESIDE)
"""Who walks beside an exact run with half the timestep."""

SPOOLS: Spools = partial(spool.spools, schema=SCHEMA)
"""Tables in memory; what is too long for it goes where the system keeps temporary files."""


def silent(_steps: int) -> None:
    """A tick that nobody listens to."""


class Path(Protocol):
    """One way to walk what is prepared. Both ways give the same tables, bit for bit but for the times.

    A path is made of what is prepared (``Prepared``), the terms of the hard form (``Baumgarte``) and, where the
    defaults do not do, how solvers are made (``Make``), who hears of progress (``Tick``) and where tables go
    (``Spools``). Rows are of the start of every step, where state, question and answer belong together.
    """

    name: str
    """Its name in the results."""

    def calibration(self) -> Tables:
        """MuJoCo's own force through our stepping, against MuJoCo: the trajectory difference must be rounding."""
        ...

    def lockstep(
        self,
        walker: SolverSpec,
        projector: SolverSpec | None,
        forms: tuple[Form, ...],
        solvers: tuple[SolverSpec, ...],
    ) -> Tables:
        """One engine walks; at each of its states every solver answers the same question, and MuJoCo its own.

        A solver walks in the hard form, and a projector with a solver of its own may end its steps. The tables come
        form by form.
        """
        ...

    def one_step(self, forms: tuple[Form, ...], solvers: tuple[SolverSpec, ...]) -> Tables:
        """From each of MuJoCo's states, one step each: what a single step adds to the difference. Form by form.

        Never projected: from MuJoCo's states, which are open, the way to the manifold would drown what a step adds.
        """
        ...

    def free(
        self,
        solver: SolverSpec,
        form: Form | None,
        projector: SolverSpec | None,
        *,
        judged: bool = True,
    ) -> Tables:
        """One engine walks alone, against MuJoCo as configured and against the truth; MuJoCo has no form.

        A solver that is not judged is spared MuJoCo's run and the minimum-norm multipliers of another solver beside
        it, which on mechanisms of many loops cost more than the walk: the table lacks the figures of both.

        In the hard form another walk is taken beside it, with half the timestep, which tells its error. Not in the
        matched one: MuJoCo's softness hangs on the timestep, so that at half of it the question is another.
        """
        ...
