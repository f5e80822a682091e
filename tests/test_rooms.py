"""Rooms import downwards only, and there are no circles: the contracts of pyproject.toml, which name every room."""

import inspect
import re
from pathlib import Path

import grimp
import oarlock
from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports
from places import REPOSITORY

PACKAGE = Path(oarlock.__file__).parent


def test_rooms(monkeypatch):
    monkeypatch.chdir(REPOSITORY)
    assert lint_imports(config_filename="pyproject.toml", cache_dir=None) == EXIT_STATUS_SUCCESS


def test_the_compiled_core_is_named_in_one_file():
    sources = [path for path in PACKAGE.rglob("*.py") if "models" not in path.relative_to(PACKAGE).parts]
    assert len(sources) > 100
    imported = re.compile(r"import _core\b|\boarlock\._core\b")
    naming = [path.relative_to(PACKAGE).as_posix() for path in sources if imported.search(path.read_text("utf-8"))]
    assert naming == ["base/core.py"]


def test_no_public_name_hides_a_module():
    """A function oarlock.run beside a module oarlock/run.py would make the module out of reach."""
    public = set(oarlock.__all__)
    assert len(public) >= 7
    assert [name for name in public if inspect.ismodule(getattr(oarlock, name))] == []
    modules = {module.split(".")[1] for module in grimp.build_graph("oarlock", cache_dir=None).modules if "." in module}
    assert public & modules == set()


def test_every_folder_of_sources_is_a_package():
    """The contracts do not see a folder that is none."""
    sources = [path for path in PACKAGE.rglob("*.py") if "models" not in path.relative_to(PACKAGE).parts]
    folders = {path.parent for path in sources}
    assert len(folders) > 15
    assert [folder for folder in folders if not (folder / "__init__.py").is_file()] == []


BESIDE_ROOMS = {"docs", "packaging"}
"""Folders of tests of what is no room: documents with their examples, and what is handed out."""


def test_tests_mirror_the_rooms():
    rooms = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").is_file()}
    folders = {path.name for path in (REPOSITORY / "tests").iterdir() if any(path.glob("**/test_*.py"))}
    assert folders - rooms == BESIDE_ROOMS
    assert len(folders) >= 10
