"""Names of the compiled core. No other file of the package imports ``oarlock._core``."""

import sys

from oarlock._core import (
    BUILD_PROFILE,
    VERSION,
    Certificate,
    Column,
    ConstrainedSystem,
    Inequalities,
    InequalityReport,
    Info,
    InputError,
    MultiplierSolver,
    Run,
    Setup,
    Stepper,
    TimeLaw,
    advance_all,
    bench_sizes,
    bench_solvers,
    make_solver,
    mujoco_layout,
    mujoco_versions,
    open_mujoco,
    python_solvers,
    register_solver,
    solvers,
)

FILE = str(sys.modules["oarlock._core"].__file__)
"""Path of the compiled module."""

__all__ = [
    "BUILD_PROFILE",
    "FILE",
    "VERSION",
    "Certificate",
    "Column",
    "ConstrainedSystem",
    "Inequalities",
    "InequalityReport",
    "Info",
    "InputError",
    "MultiplierSolver",
    "Run",
    "Setup",
    "Stepper",
    "TimeLaw",
    "advance_all",
    "bench_sizes",
    "bench_solvers",
    "make_solver",
    "mujoco_layout",
    "mujoco_versions",
    "open_mujoco",
    "python_solvers",
    "register_solver",
    "solvers",
]
