"""Digests of everything a run depends on: while they stay the same, so do the figures of the run."""

import ast
import functools
import importlib.metadata
import platform
from collections.abc import Sequence
from pathlib import Path

import mujoco

from oarlock.base import core
from oarlock.base.hashing import of_document, of_file, of_text
from oarlock.cases.case import Case

COMPUTING = ("base", "cases", "tables", "mechanics", "stepping", "experiments")
"""Rooms that the figures of a run depend on, besides ``unit.py``. The other rooms only present them."""

PRESENTING = ("base", "cases", "tables", "render", "report")
"""Rooms that the pages of results depend on."""

_DESCRIBED = {"title", "summary", "source", "tags", "expect", "paper"}
TOLD = _DESCRIBED | {"experiments", "gates", "endings", "variants", "beyond", "sweep"}
"""Keys of a case file that no run depends on: they are read after the runs, or say which runs there are."""


_HARNESS = Path(__file__).parents[1]


@functools.cache
def program() -> str:
    """Computes the digest of what computes: the compiled core, the rooms, the versions and the kind of machine."""
    sources = code_of(COMPUTING)
    sources["unit"] = _code(Path(__file__).with_name("unit.py"))
    versions = {name: importlib.metadata.version(name) for name in ("mujoco", "numpy", "scipy")}
    compiled = of_file(Path(core.FILE))
    return of_document([compiled, sources, versions, platform.python_version(), platform.system(), platform.machine()])


@functools.cache
def presentation() -> str:
    """Computes the digest of what makes pages from results."""
    sources = {name: of_file(path) for name, path in _sources(PRESENTING).items()}
    sources |= {path.name: of_file(path) for path in sorted(_HARNESS.glob("render/templates/*"))}
    return of_document([sources, [importlib.metadata.version(name) for name in ("altair", "vl-convert-python")]])


def code_of(rooms: Sequence[str]) -> dict[str, str]:
    """Computes the digests of the sources of some rooms, without comments, docstrings and layout."""
    return {name: _code(path) for name, path in _sources(rooms).items()}


def _sources(rooms: Sequence[str]) -> dict[str, Path]:
    """Returns the sources of some rooms: ``room/name`` → path."""
    return {f"{room}/{path.stem}": path for room in rooms for path in sorted((_HARNESS / room).glob("*.py"))}


def _code(path: Path) -> str:
    """Computes the digest of a source without its comments, its docstrings and its layout."""
    tree = ast.parse(path.read_bytes())
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [one for one in body if not _is_text(one)]  # pyright: ignore[reportAttributeAccessIssue]
    return of_text(ast.dump(tree))


def _is_text(statement: ast.AST) -> bool:
    """Whether a statement is a string that nobody reads: the docstring of what it is in or follows."""
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def of_case(case: Case) -> str:
    """Computes the digest of a case and the program.

    It covers the model with everything that it includes, its truth, and what its runs read of the case file. For a
    ``model.py`` every file beside it counts, and nothing that it reads from elsewhere.
    """
    contents = case.file.model_dump(mode="json", exclude=TOLD)
    files = {path.name: of_file(path) for path in _files(case)}
    return of_document([case.name, case.parameters, contents, files, program()])


def _files(case: Case) -> list[Path]:
    if case.model_path.suffix == ".py":
        told = (".md", ".csv", ".sha256")
        beside = (path for path in case.folder.iterdir() if path.is_file() and path.suffix not in told)
        files = sorted(path for path in beside if path.name != "case.toml")
    else:
        try:
            files = [Path(name) for name in sorted(mujoco.mju_getXMLDependencies(str(case.model_path)))]
        except Exception:  # a file that cannot be read: the run says what is wrong with it
            files = [case.model_path]
    return files if case.truth_path is None else [*files, case.truth_path]
