"""Which path steps in this process."""

from oarlock.cases.case_file import Baumgarte
from oarlock.stepping import native_path
from oarlock.stepping.native_path import NativePath
from oarlock.stepping.path import Path
from oarlock.stepping.prepared import Prepared
from oarlock.stepping.python_path import PythonPath


def fitting_path(prepared: Prepared, terms: Baumgarte) -> Path:
    """The native path where this process can take it, else the Python path; with solvers as they are by themselves."""
    refused = native_path.refusal() or native_path.refusal_of(prepared)
    return PythonPath(prepared, terms) if refused else NativePath(prepared, terms)
