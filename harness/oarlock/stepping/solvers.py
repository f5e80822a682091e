"""Solvers by name, and their answers to the question of one state."""

from dataclasses import dataclass

from oarlock.base import core
from oarlock.base.errors import InputError, choose
from oarlock.base.options import Number, join_options, split_options

MUJOCO = "mujoco"
"""Stands among the solvers for MuJoCo itself, in free runs and as a walker."""


REFERENCE = "pinv"
"""The solver whose multipliers count as the minimum-norm ones."""


RUN_REFERENCE = "pinv-tracked"
"""The same along a run, where the last step's decomposition helps."""


def solver_names() -> list[str]:
    """Names in the registry of the compiled core."""
    return list(core.solvers())


@dataclass(frozen=True)
class SolverSpec:
    """A solver with options, as written: ``sr1:eps_abs=1e-7,max_iterations=20``."""

    name: str
    options: tuple[tuple[str, Number], ...] = ()

    @classmethod
    def parse(cls, text: str) -> "SolverSpec":
        """Reads a specification; each value becomes one of its option's kind, so that a solver has one name.

        Raises:
            InputError: unknown solver or option, or a value that is not a number or out of range.
        """
        name, given = split_options(text, "solver option", switches=True)
        choose("solver", name, [MUJOCO, *solver_names()])
        if name == MUJOCO:
            if given:
                raise InputError(f"'{text}': MuJoCo takes no options here, its settings come from the case")
            return cls(name)
        core.make_solver(name, **given)
        defaults = core.solvers()[name][1]
        return cls(name, tuple((key, type(defaults[key])(value)) for key, value in given.items()))

    def __str__(self) -> str:
        return join_options(self.name, dict(self.options))

    def with_defaults(self, **defaults: float | None) -> "SolverSpec":
        """Adds options that the solver has and the specification leaves open; None is left out."""
        if self.name == MUJOCO:
            return self
        known = core.solvers()[self.name][1]
        given = dict(self.options)
        added = {k: v for k, v in defaults.items() if v is not None and k in known and k not in given}
        return SolverSpec(self.name, (*self.options, *added.items()))

    def make(self) -> core.MultiplierSolver:
        """A fresh solver. Raises InputError for an unknown option or a value out of range."""
        return core.make_solver(self.name, **dict(self.options))
