"""Temporary folders: those of dead processes go, and nothing else does."""

import os
import tempfile
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from oarlock.base.processes import myself
from oarlock.base.scratch import FOREIGN_S, PREFIX, scratch, scratch_folder, sweep_up

DEAD = replace(myself(), pid=2**22 + 1)
"""Above every number that Linux gives."""
ELSEWHERE = replace(DEAD, host="00000000")


@pytest.fixture(autouse=True)
def system(tmp_path, monkeypatch):
    """The system's temporary folder, for the test alone."""
    folder = tmp_path / "system"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def left(folder: Path, name: str) -> Path:
    made = folder / name
    (made / "deep").mkdir(parents=True)
    (made / "deep" / "0.parquet").touch()
    return made


def test_what_dead_processes_left_goes_and_is_said(system, tmp_path):
    results = tmp_path / "results"
    gone = [left(system, f"{PREFIX}.{DEAD}.abc"), left(results, f".steps.{DEAD}.ab_c"), left(results, f".new.{DEAD}.x")]
    unfinished = [results / f".summary.json.{DEAD.pid}.tmp", results / f".summary.0.{DEAD.pid}.tmp.json"]
    for path in unfinished:
        path.touch()
    said = sweep_up([results, results, tmp_path / "missing"])
    assert said == (
        f"removed 5 temporary folders and files of processes that ended before they could, in {results}, {system}"
    )
    assert not any(path.exists() for path in (*gone, *unfinished))
    assert sweep_up([results]) == ""


def test_nothing_else_goes(system, tmp_path):
    outside = left(tmp_path, "outside")
    stays = [
        scratch(),
        scratch(".steps", tmp_path),
        left(system, "oarlock-abc"),
        left(system, f"other.{DEAD}.abc"),
        left(system, f"{PREFIX}.{DEAD}"),
        left(system, f"{PREFIX}.{ELSEWHERE}.abc"),
    ]
    for name in (f".a.{DEAD.pid}.tmp", f"{PREFIX}.{DEAD}.file"):
        (system / name).touch()
        stays.append(system / name)
    (tmp_path / f".b.{os.getpid()}.tmp").touch()
    stays.append(tmp_path / f".b.{os.getpid()}.tmp")
    link = system / f"{PREFIX}.{DEAD}.link"
    link.symlink_to(outside)
    assert sweep_up([tmp_path]) == ""
    assert all(path.exists() for path in (*stays, link, outside / "deep" / "0.parquet"))


def test_of_another_machine_only_what_is_old_goes(system):
    folder = system / f"{PREFIX}.{ELSEWHERE}.abc"
    folder.mkdir()
    part = folder / "0.parquet"
    part.touch()
    before = part.stat().st_mtime - FOREIGN_S - 1
    os.utime(folder, (before, before))
    assert sweep_up() == ""
    os.utime(part, (before, before))
    assert sweep_up() == f"removed a temporary folder or file of processes that ended before they could, in {system}"
    assert not folder.exists()


def test_a_folder_of_a_block_goes_with_it(system):
    with suppress(RuntimeError), scratch_folder() as folder:
        assert folder.parent == system
        (folder / "a").touch()
        raise RuntimeError
    assert list(system.iterdir()) == []
