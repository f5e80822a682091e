"""oarlock: cross-validates closed-chain MuJoCo models.

``make_solver`` gives a multiplier solver of the compiled core, ``run`` a whole comparison, ``diff`` what changed
between two folders of them, ``check`` why the loops of a file come apart and what would hold them:

    >>> import oarlock
    >>> solver = oarlock.make_solver("sr1", eps_abs=1e-7)
    >>> results = oarlock.run("boat", mode="free", duration=1.0)
    >>> results.summary, results.steps
"""

from oarlock.base.core import VERSION, make_solver
from oarlock.base.errors import InputError
from oarlock.cases.case import load_case, model_names, variant_names
from oarlock.compare.compare import Difference, diff
from oarlock.diagnosis.checked import Checked, check
from oarlock.experiments.outcome import Results
from oarlock.experiments.session import run
from oarlock.stepping.solvers import solver_names

__version__ = VERSION

__all__ = [
    "Checked",
    "Difference",
    "InputError",
    "Results",
    "__version__",
    "check",
    "diff",
    "load_case",
    "make_solver",
    "model_names",
    "run",
    "solver_names",
    "variant_names",
]
