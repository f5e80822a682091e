"""Solvers by name, with their options; and those that a user brings along, as ``module:function``."""

import importlib
import os
import re
import sys
from dataclasses import dataclass
from functools import reduce
from typing import Any

from oarlock.base import core
from oarlock.base.errors import InputError, choose, one_line
from oarlock.base.options import Number, join_options, split_options
from oarlock.cases.case import NO_CODE

MUJOCO = "mujoco"
"""Name that stands for MuJoCo itself among the solvers, in free runs and as a walker."""


REFERENCE = "pinv"
"""Solver whose multipliers count as the minimum-norm ones of a single state."""


BESIDE = "auto"
"""Solver of the walk at half the timestep that tells the error of a run, its solver's included."""


_ELSEWHERE = re.compile(r"([A-Za-z_][\w.]*):([A-Za-z_][\w.]*)")
"""A solver of one's own in words: a module, and a name in it."""


def solver_names() -> list[str]:
    """Returns the names of the solvers in the registry of the compiled core."""
    return list(core.solvers())


def register_elsewhere(text: str) -> str:
    """Imports a solver that is written as ``module:function``, or ``module:Class``, and registers it.

    The module is looked for in the working folder too.

    Returns:
        The name that it goes by: ``module.function``.

    Raises:
        InputError: there is no such module or nothing of that name in it, it cannot be a solver, or code is not to be
            run.
    """
    found = _ELSEWHERE.fullmatch(text)
    assert found is not None
    module, path = found.groups()
    name = f"{module}.{path}"
    if os.environ.get(NO_CODE, "") not in ("", "0"):
        raise InputError(f"solver '{text}' is code, which --no-code ({NO_CODE}) keeps from running")
    sys.path.insert(0, os.getcwd())
    try:
        solver: Any = reduce(getattr, path.split("."), importlib.import_module(module))
    except Exception as error:
        raise InputError(f"solver '{text}': {type(error).__name__}: {one_line(error)}") from None
    finally:
        sys.path.remove(os.getcwd())
    core.register_solver(name, solver)
    return name


@dataclass(frozen=True)
class SolverSpec:
    """A solver with options, written as ``sr1:eps_abs=1e-7,max_iterations=20``.

    Attributes:
        name: name of the solver, or ``mujoco``.
        options: pairs of name and value.
    """

    name: str
    options: tuple[tuple[str, Number], ...] = ()

    @classmethod
    def parse(cls, text: str) -> "SolverSpec":
        """Parses a specification. Values take the type of their option, so that equal solvers have equal names.

        Raises:
            InputError: the solver or an option is unknown, or a value is not a number or out of range.
        """
        if _ELSEWHERE.fullmatch(text):
            return cls(register_elsewhere(text))
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
        """Adds options that the solver has and the specification does not give. Values of None are left out."""
        if self.name == MUJOCO:
            return self
        known = core.solvers()[self.name][1]
        given = dict(self.options)
        added = {k: v for k, v in defaults.items() if v is not None and k in known and k not in given}
        return SolverSpec(self.name, (*self.options, *added.items()))

    def make(self) -> core.MultiplierSolver:
        """Makes a new solver.

        Raises:
            InputError: an option is unknown or its value out of range.
        """
        return core.make_solver(self.name, **dict(self.options))
