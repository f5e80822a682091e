"""The crate of a solver of one's own: laid out as the others, locked as they are, and right."""

import os
import re
import subprocess
import tomllib

import pytest
from places import REPOSITORY

CRATE = REPOSITORY / "examples" / "rust" / "own_solver"

PATIENCE_S = 1800
"""It compiles what the core is built on."""


def _cargo(*arguments: str) -> str:
    environment = {**os.environ, "CARGO_TARGET_DIR": str(REPOSITORY / "target" / "examples")}
    command = ["cargo", *arguments, "--manifest-path", str(CRATE / "Cargo.toml")]
    done = subprocess.run(
        command, env=environment, capture_output=True, encoding="utf-8", timeout=PATIENCE_S, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def _locked(path) -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}
    for package in tomllib.loads(path.read_text(encoding="utf-8"))["package"]:
        found.setdefault(package["name"], set()).add(package["version"])
    return found


def test_it_is_locked_to_what_the_workspace_is_locked_to():
    ours, theirs = _locked(CRATE / "Cargo.lock"), _locked(REPOSITORY / "Cargo.lock")
    assert len(ours) > 20
    assert {name: versions for name, versions in ours.items() if not versions <= theirs.get(name, versions)} == {}


def test_every_script_is_on_the_page():
    page = (REPOSITORY / "docs" / "how-to" / "examples.md").read_text(encoding="utf-8")
    scripts = sorted(path.name for path in (REPOSITORY / "examples").glob("*.py"))
    assert len(scripts) >= 4
    assert [name for name in scripts if f"python examples/{name}" not in page] == []


@pytest.mark.slow
def test_the_crate_of_an_own_solver():
    assert subprocess.run(["cargo", "fmt", "--check"], cwd=CRATE, check=False).returncode == 0
    told = _cargo("test", "--quiet", "--release", "--locked")
    assert sum(map(int, re.findall(r"(\d+) passed", told))) >= 3
