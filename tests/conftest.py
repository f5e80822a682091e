"""Fixtures. The whole case of the boat runs once: the tests that read it go to one worker."""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import oarlock
import pytest
from browser import Browser, executable
from mechanisms import COMMAND, four_bar, write_model
from oarlock.cli import app as cli
from pairs import GATED
from strange import write_files
from suites import TINY

WHOLE_CASE = "boat_run"


@dataclass(frozen=True)
class BoatRun:
    """What ``oarlock run boat`` left: exit status, its two streams, the summary, the folder."""

    status: int
    out: str
    err: str
    document: dict[str, Any]
    folder: Path

    @property
    def rows(self) -> list[dict[str, Any]]:
        return self.document["runs"]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if WHOLE_CASE in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.xdist_group(WHOLE_CASE))


@pytest.fixture(scope="session")
def boat_run(tmp_path_factory: pytest.TempPathFactory) -> BoatRun:
    """The whole case of the boat: 46 runs of 12 s."""
    folder = tmp_path_factory.mktemp("whole") / "boat"
    arguments = [COMMAND, "run", "boat", "--out", folder, "--json", "-"]
    done = subprocess.run(arguments, capture_output=True, encoding="utf-8", timeout=600, check=False)
    assert done.returncode in (0, 1), done.stderr
    return BoatRun(done.returncode, done.stdout, done.stderr, json.loads(done.stdout), folder)


@pytest.fixture(scope="module")
def browser(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """A real browser, with the flags that the module names as ``BROWSER_FLAGS``; without one the test is skipped."""
    if executable() is None:
        pytest.skip("there is no Chromium")
    browser = Browser(tmp_path_factory.mktemp("browser"), *getattr(request.module, "BROWSER_FLAGS", ()))
    yield browser
    browser.close()


@pytest.fixture
def oarlock_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """As ``oarlock_command``, but in this process: the entry point without the second that a new one takes."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> subprocess.CompletedProcess[str]:
        monkeypatch.setattr(sys, "argv", ["oarlock", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capsys.readouterr()
        status = ended.value.code
        assert isinstance(status, int)
        return subprocess.CompletedProcess(sys.argv, status, out, err)

    return call


@pytest.fixture
def oarlock_command(tmp_path: Path):
    """Runs the installed command in an empty folder; gives the finished process."""

    def call(*arguments: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [COMMAND, *map(str, arguments)],
            cwd=tmp_path,
            capture_output=True,
            encoding="utf-8",
            timeout=120,
            check=False,
        )

    return call


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    """A small case of a suite."""
    return write_model(tmp_path / "tiny", four_bar(), TINY).parent


@pytest.fixture(scope="session")
def strange(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The fixtures, with their meshes and textures made."""
    return write_files(tmp_path_factory.mktemp("strange") / "files")


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of real results: a small case with a gate that holds."""
    folder = tmp_path_factory.mktemp("diff")
    case = write_model(folder / "tiny", four_bar(), GATED).parent
    found = oarlock.run(case, out=folder / "results")
    assert [verdict.held for verdict in found.verdicts] == [True]
    return folder / "results"


@pytest.fixture
def pair(results: Path, tmp_path: Path) -> tuple[Path, Path]:
    """The same results twice, to be changed."""
    for name in ("a", "b"):
        shutil.copytree(results, tmp_path / name)
    return tmp_path / "a", tmp_path / "b"
