"""Folders that belong to one process at a time."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace

import pytest
from oarlock import InputError
from oarlock.base import lock
from oarlock.base.lock import NAME, locked
from oarlock.base.processes import myself

HOLD = """
import sys
from pathlib import Path
from oarlock.base.lock import locked
with locked([Path(sys.argv[1])], "oarlock run boat", print):
    print("held", flush=True)
    sys.stdin.read()
"""


def silent(text):
    raise AssertionError(text)


@pytest.fixture(params=["system", "file"])
def kind(request, monkeypatch):
    """With the system's locks, and as on a file system that has none."""
    if request.param == "file":
        monkeypatch.setattr(lock, "fcntl", None)
    return request.param


def test_a_second_is_refused_by_name_and_the_folder_is_free_afterwards(tmp_path, kind):
    folder = tmp_path / "a" / "b"
    for _ in range(2):
        with locked([folder, folder], "oarlock run boat", silent):
            with pytest.raises(InputError) as refused, locked([folder], "oarlock suite", silent):
                pass
            said = f"'{folder}' is in use by 'oarlock run boat', process {os.getpid()} on "
            assert str(refused.value).startswith(said)
            assert str(refused.value).endswith("; expected another folder, or that it ends first")
            (folder / "kept").touch()
        assert [path.name for path in folder.iterdir()] == ["kept"]


def test_all_or_none(tmp_path, kind):
    with locked([tmp_path / "b"], "oarlock run", silent):
        with (
            pytest.raises(InputError, match="in use"),
            locked([tmp_path / "a", tmp_path / "b"], "oarlock suite", silent),
        ):
            pass
        assert not (tmp_path / "a").exists()  # what was made for nothing is gone
    with locked([tmp_path / "a", tmp_path / "b"], "oarlock suite", silent):
        pass


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs signals")
def test_what_a_dead_process_had_is_taken_over_and_said(tmp_path, kind):
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, tmp_path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, encoding="utf-8"
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        said = f"'oarlock run boat', process {process.pid} on "
        with pytest.raises(InputError, match=said), locked([tmp_path], "oarlock suite", silent):
            pass
        process.kill()
        process.wait()
    said = []
    with locked([tmp_path], "oarlock suite", said.append):
        assert said == [f"'{tmp_path}' was left locked by oarlock run boat, process {process.pid}, which is gone"]
    assert list(tmp_path.iterdir()) == []


def test_another_machine_is_never_robbed(tmp_path, kind):
    owner = replace(myself(), pid=2**22 + 1, host="00000000")
    content = {"what": "oarlock suite", "owner": str(owner), "host": "node7", "since": "yesterday"}
    (tmp_path / NAME).write_text(json.dumps(content))
    with pytest.raises(InputError) as refused, locked([tmp_path], "oarlock run", silent):
        pass
    assert str(refused.value) == (
        f"'{tmp_path}' is in use by 'oarlock suite', process {owner.pid} on node7, since yesterday; if it is gone, "
        f"remove '{tmp_path / NAME}'"
    )
    assert json.loads((tmp_path / NAME).read_text()) == content


@pytest.mark.parametrize("content", [b"", b"{", b"[1]", b'"x"', b"\xff\xfe", b'{"owner": 3}'])
def test_garbage_is_nobody(tmp_path, kind, content):
    (tmp_path / NAME).write_bytes(content)
    with locked([tmp_path], "oarlock run", lambda text: None):
        assert json.loads((tmp_path / NAME).read_text())["owner"] == str(myself())


def test_a_link_is_not_followed(tmp_path, kind):
    (tmp_path / "other").write_text("kept")
    (tmp_path / NAME).symlink_to(tmp_path / "other")
    with pytest.raises(InputError, match="cannot write"), locked([tmp_path], "oarlock run", silent):
        pass
    assert (tmp_path / "other").read_text() == "kept"
