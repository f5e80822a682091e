"""oarlock: cross-validates closed-chain MuJoCo models.

``make_solver`` gives a multiplier solver of the compiled core, ``run`` a whole comparison, ``diff`` what changed
between two folders of them, ``check`` why the loops of a file come apart and what would hold them, ``suite`` and
``sweep`` the runs of many models, ``reactions`` what goes through the equalities of one state, ``sample`` consistent
states spread over all that a mechanism can reach, ``view`` both motions on a page or in a video, ``close`` a tree with
its loops closed, ``conform`` and ``versions`` what other engines, and other versions of MuJoCo, make of the same
states. ``register_solver`` adds a solver of one's own to all of them, and ``Stepper`` takes exact steps in place of
``mj_step``:

    >>> import oarlock
    >>> solver = oarlock.make_solver("sr1", eps_abs=1e-7)
    >>> results = oarlock.run("boat", mode="free", duration=1.0)
    >>> results.summary, results.steps

Each of ``run``, ``check``, ``conform``, ``diff``, ``sample``, ``suite``, ``sweep``, ``versions`` and ``view`` gives an
``Answer``: its ``document`` is the command's JSON, ``report`` writes its page, its tables are polars frames, and a
notebook shows it. Arguments are named as the command's flags. A name is loaded when it is first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from oarlock.base.answer import Answer
    from oarlock.base.core import make_solver, register_solver
    from oarlock.base.errors import InputError
    from oarlock.base.progress import Progress
    from oarlock.batch.session import suite, sweep
    from oarlock.batch.suite import Suite, Sweep
    from oarlock.cases.case import load_case, model_names, variant_names
    from oarlock.closing.closing import Closing, close
    from oarlock.compare.compare import Difference, diff
    from oarlock.conformance.session import Matrix, conform, versions
    from oarlock.diagnosis.checked import Checked, check
    from oarlock.diagnosis.options import CheckOptions
    from oarlock.diagnosis.reactions import EqualityReaction, reactions
    from oarlock.diagnosis.sampling import Samples, sample
    from oarlock.experiments.options import RunOptions
    from oarlock.experiments.outcome import Results
    from oarlock.experiments.problems import Problems, export_problems
    from oarlock.experiments.session import run
    from oarlock.stepping.solvers import solver_names
    from oarlock.stepping.stepper import StepFigures, Stepper
    from oarlock.viewer.session import Viewed, view

    __version__: str

_PLACES = {
    "base.answer": ("Answer",),
    "base.core": ("make_solver", "register_solver"),
    "base.errors": ("InputError",),
    "base.progress": ("Progress",),
    "batch.session": ("suite", "sweep"),
    "batch.suite": ("Suite", "Sweep"),
    "cases.case": ("load_case", "model_names", "variant_names"),
    "closing.closing": ("Closing", "close"),
    "compare.compare": ("Difference", "diff"),
    "conformance.session": ("Matrix", "conform", "versions"),
    "diagnosis.checked": ("Checked", "check"),
    "diagnosis.options": ("CheckOptions",),
    "diagnosis.reactions": ("EqualityReaction", "reactions"),
    "diagnosis.sampling": ("Samples", "sample"),
    "experiments.options": ("RunOptions",),
    "experiments.outcome": ("Results",),
    "experiments.problems": ("Problems", "export_problems"),
    "experiments.session": ("run",),
    "stepping.solvers": ("solver_names",),
    "stepping.stepper": ("StepFigures", "Stepper"),
    "viewer.session": ("Viewed", "view"),
}

__all__ = [
    "Answer",
    "CheckOptions",
    "Checked",
    "Closing",
    "Difference",
    "EqualityReaction",
    "InputError",
    "Matrix",
    "Problems",
    "Progress",
    "Results",
    "RunOptions",
    "Samples",
    "StepFigures",
    "Stepper",
    "Suite",
    "Sweep",
    "Viewed",
    "__version__",
    "check",
    "close",
    "conform",
    "diff",
    "export_problems",
    "load_case",
    "make_solver",
    "model_names",
    "reactions",
    "register_solver",
    "run",
    "sample",
    "solver_names",
    "suite",
    "sweep",
    "variant_names",
    "versions",
    "view",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        found: Any = import_module("oarlock.base.core").VERSION
    else:
        place = next((place for place, names in _PLACES.items() if name in names), None)
        if place is None:
            raise AttributeError(f"module 'oarlock' has no attribute '{name}'")
        found = getattr(import_module(f"oarlock.{place}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
