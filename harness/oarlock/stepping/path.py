"""What a path of stepping is given and gives back."""

from collections.abc import Callable

from oarlock.base.core import MultiplierSolver
from oarlock.stepping.solvers import SolverSpec
from oarlock.tables.spool import Spool

Make = Callable[[SolverSpec], MultiplierSolver]
"""Makes a solver with the defaults of the case."""


Tick = Callable[[int], None]
"""Called with the number of steps just done."""


Finish = Callable[[float], None]
"""Called with the time in µs that the step took, once it is taken: writes the rows that were begun before it."""


Spools = Callable[[int], list[Spool]]
"""Makes a spool for each table of one walk."""


Tables = tuple[list[Spool], str]
"""A table for each who answers, and what ended the run early, or nothing."""
