"""What is handed out: a wheel that an empty Python installs and runs without a compiler, and sources that build."""

import hashlib
import os
import re
import subprocess
import sys
import time
import venv
import zipfile
from pathlib import Path

import pytest
from places import FIXTURES, REPOSITORY

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("packaging")]

GRIPPER = FIXTURES / "check" / "gripper_2f" / "gripper_2f.xml"

DATE = "1767225600"
"""Of all files, whatever the last commit is."""

CHECK_S = 60
"""A check of a gripper, with everything that Python loads for the first time; it takes four on one free core."""

PATIENCE_S = 3600
"""A build with optimisation across crates, from nothing, beside other work."""


def _done(
    *command: object, cwd: Path | None = None, environment: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env={**os.environ, **(environment or {})},
        capture_output=True,
        encoding="utf-8",
        timeout=PATIENCE_S,
        check=False,
    )


def _made(target: str, pattern: str) -> Path:
    done = _done("make", target, cwd=REPOSITORY, environment={"SOURCE_DATE_EPOCH": DATE})
    assert done.returncode == 0, done.stdout + done.stderr
    (found,) = (REPOSITORY / "dist").glob(pattern)
    return found


@pytest.fixture(scope="module")
def wheel() -> Path:
    return _made("wheel", "*.whl")


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """An environment with nothing in it but the wheel and what it depends on; its folder of programs."""
    folder = tmp_path_factory.mktemp("empty") / "environment"
    venv.create(folder, with_pip=True)
    programs = folder / "bin"
    done = _done(
        programs / "python",
        "-m",
        "pip",
        "install",
        "--quiet",
        "--only-binary",
        ":all:",
        wheel,
        environment=_bare(programs),
    )
    assert done.returncode == 0, done.stderr
    return programs


def _bare(programs: Path) -> dict[str, str]:
    """Surroundings without a compiler, and without this checkout."""
    return {"PATH": str(programs), "PYTHONPATH": "", "VIRTUAL_ENV": ""}


def test_one_wheel_is_for_every_python_of_this_system(wheel):
    assert re.fullmatch(r"oarlock-[\d.]+-cp311-abi3-(manylinux_\d+_\d+_\w+|macosx_\w+)\.whl", wheel.name)


def test_the_wheel_has_what_it_needs_and_no_more(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert [name for name in names if name.startswith("oarlock/_core") and name.endswith(".so")] != []
    assert {"oarlock/py.typed", "oarlock/_core.pyi", "oarlock/models/boat/case.toml"} <= set(names)
    vendor = {"oarlock/render/vendor/three.min.js", "oarlock/render/vendor/LICENSE-three"}
    assert vendor | {"oarlock/viewer/viewer.js", "oarlock/render/templates/view.page.html.j2"} <= set(names)
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.startswith("oarlock")} == set()
    assert [name for name in names if "__pycache__" in name or name.endswith((".rs", ".c", ".h"))] == []


def test_the_wheel_has_no_path_of_this_machine(wheel):
    archive = zipfile.ZipFile(wheel)
    home = [str(REPOSITORY), str(Path.home() / ".cargo")]
    found = [name for name in archive.namelist() for path in home if path.encode() in archive.read(name)]
    assert found == []


def test_the_wheel_is_the_same_when_it_is_made_again(wheel):
    before = hashlib.sha256(wheel.read_bytes()).hexdigest()
    assert hashlib.sha256(_made("wheel", "*.whl").read_bytes()).hexdigest() == before


def test_a_check_runs_where_nothing_else_is_installed(installed, tmp_path):
    start = time.monotonic()
    done = _done(
        installed / "oarlock", "check", GRIPPER, "--controls", "random", cwd=tmp_path, environment=_bare(installed)
    )
    assert done.returncode == 0, done.stderr
    assert "opens by" in done.stdout
    assert time.monotonic() - start <= CHECK_S
    told = "import oarlock, oarlock.base.core; print(oarlock.__file__, oarlock.base.core.BUILD_PROFILE)"
    said = _done(installed / "python", "-c", told, cwd=tmp_path, environment=_bare(installed)).stdout.split()
    assert Path(said[0]).is_relative_to(installed.parent)
    assert said[1] == "release"


def test_a_run_steps_natively_there(installed, tmp_path):
    command = [installed / "oarlock", "run", "four_bar", "--mode", "free", "--duration", "0.1", "--stepping", "native"]
    done = _done(*command, cwd=tmp_path, environment=_bare(installed))
    assert done.returncode == 0, done.stderr


def test_the_sources_build(tmp_path):
    """With the tools of this environment; what others wrote is taken as it was compiled for the wheel, if it was."""
    paths = {REPOSITORY: "/oarlock", Path.home() / ".cargo": "/cargo"}
    source = _made("sdist", "*.tar.gz")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", source]
    done = _done(
        *command,
        "--wheel-dir",
        tmp_path,
        environment={
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
            "CARGO_TARGET_DIR": str(REPOSITORY / "target" / "wheel"),
            "RUSTFLAGS": " ".join(f"--remap-path-prefix={path}={name}" for path, name in paths.items()),
            "PYO3_PYTHON": sys.executable,
            "MATURIN_PEP517_ARGS": "",  # of a checkout, which make sets
        },
    )
    assert done.returncode == 0, done.stderr
    (built,) = tmp_path.glob("*.whl")
    assert "oarlock/models/boat/model.xml" in zipfile.ZipFile(built).namelist()
