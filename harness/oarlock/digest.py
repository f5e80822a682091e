"""What a run hangs on, as a digest: while that stays the same, its figures do."""

import ast
import functools
import hashlib
import importlib.metadata
import json
import platform
from pathlib import Path
from typing import Any

import mujoco

from oarlock import _core
from oarlock.cases import Case

PRESENTATION = (
    "catalogue.py",
    "check_command.py",
    "cli.py",
    "cluster.py",
    "console.py",
    "diff.py",
    "diff_command.py",
    "diff_figures.py",
    "diff_folders.py",
    "diff_tolerances.py",
    "explain_command.py",
    "figures.py",
    "growth.py",
    "growth_report.py",
    "junit.py",
    "pages.py",
    "report.py",
    "report_folder.py",
    "scaffold.py",
    "suite.py",
    "suite_command.py",
    "summary.py",
    "summary_figures.py",
    "sweep.py",
    "sweep_report.py",
    "workers.py",
)
"""Sources that no figure of a run depends on."""

TOLD = {"title", "summary", "source", "tags", "expect", "paper", "experiments", "gates", "variants", "sweep"}
"""Keys of a case file that are read after its runs, or that say which runs there are."""

_HARNESS = Path(__file__).parent


def of_text(text: str) -> str:
    """Sixteen hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def of_file(path: Path) -> str:
    """Sixteen hexadecimal digits of the contents; of nothing if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    except OSError:
        return ""


def of_document(document: Any) -> str:
    """The digest of what JSON can hold."""
    return of_text(json.dumps(document, sort_keys=True, ensure_ascii=False, default=str))


@functools.cache
def program() -> str:
    """Of everything that computes: the compiled core, the sources of the harness, the versions, the machine's kind."""
    sources = {path.name: _code(path) for path in sorted(_HARNESS.glob("*.py")) if path.name not in PRESENTATION}
    versions = {name: importlib.metadata.version(name) for name in ("mujoco", "numpy", "scipy")}
    core = of_file(Path(str(_core.__file__)))
    return of_document([core, sources, versions, platform.python_version(), platform.system(), platform.machine()])


@functools.cache
def presentation() -> str:
    """Of what makes pages from results."""
    sources = {path.name: of_file(path) for path in sorted([*_HARNESS.glob("*.py"), *_HARNESS.glob("templates/*")])}
    return of_document([sources, [importlib.metadata.version(name) for name in ("altair", "vl-convert-python")]])


def _code(path: Path) -> str:
    """A source without its comments and its layout."""
    return of_text(ast.dump(ast.parse(path.read_bytes())))


def of_case(case: Case) -> str:
    """Of a case and the program: its model with all that it includes, its truth, and what its runs read of its file.

    Of a ``model.py`` every file beside it counts, whatever it reads from elsewhere does not.
    """
    contents = case.file.model_dump(mode="json", exclude=TOLD)
    files = {path.name: of_file(path) for path in _files(case)}
    return of_document([case.name, case.parameters, contents, files, program()])


def _files(case: Case) -> list[Path]:
    if case.model_path.suffix == ".py":
        beside = (path for path in case.folder.iterdir() if path.is_file() and path.suffix not in (".md", ".csv"))
        files = sorted(path for path in beside if path.name != "case.toml")
    else:
        try:
            files = [Path(name) for name in sorted(mujoco.mju_getXMLDependencies(str(case.model_path)))]
        except Exception:  # a file that cannot be read: the run says what is wrong with it
            files = [case.model_path]
    return files if case.truth_path is None else [*files, case.truth_path]
