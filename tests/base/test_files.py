"""The one way to write files: regular files are replaced whole; of what the user names, links are followed and
anything else is written to; what stands in the place of a file of ours goes."""

import errno
import os
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
from oarlock import InputError
from oarlock.base.files import replacing, write_text
from oarlock.base.scratch import sweep_up


def test_a_file_is_replaced_whole_and_keeps_its_permissions(tmp_path):
    path = tmp_path / "kept.json"
    path.write_text("old")
    path.chmod(0o640)
    before = path.stat().st_ino
    write_text(path, "new")
    assert path.read_text() == "new"
    assert path.stat().st_ino != before
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert os.listdir(tmp_path) == ["kept.json"]


def _fill_the_disk(path):
    with replacing(path) as temporary:
        temporary.write_text("half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_what_fails_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "kept.json"
    path.write_text("old")
    with pytest.raises(InputError, match="No space left"):
        _fill_the_disk(path)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["kept.json"]


def test_an_error_of_input_while_writing_keeps_its_words(tmp_path):
    with pytest.raises(InputError, match=r"^its own words$"), replacing(tmp_path / "a"):
        raise InputError("its own words")


@pytest.mark.parametrize("there", [True, False])
def test_a_link_is_followed(tmp_path, there):
    (tmp_path / "far").mkdir()
    (tmp_path / "mid").symlink_to("far/file")
    (tmp_path / "link").symlink_to("mid")
    if there:
        (tmp_path / "far" / "file").write_text("old")
    write_text(tmp_path / "link", "new", named=True)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "mid").is_symlink()
    assert (tmp_path / "far" / "file").read_text() == "new"
    assert os.listdir(tmp_path / "far") == ["file"]


def test_a_device_stays_one(tmp_path):
    if os.geteuid() == 0:  # whoever may not make devices could not have replaced this one either
        device = tmp_path / "null"
        os.mknod(device, 0o666 | stat.S_IFCHR, os.makedev(1, 3))
    else:
        device = Path(os.devnull)
    with suppress(InputError):  # a file system may forbid devices
        write_text(device, "text", named=True)
    assert stat.S_ISCHR(device.stat().st_mode)


def test_a_pipe_is_written_to(tmp_path):
    pipe, got = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_text()))
    reader.start()
    write_text(pipe, "text", named=True)
    reader.join(10)
    assert got == ["text"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_socket_is_not_replaced(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind("socket")
        with pytest.raises(InputError, match=r"^cannot write 'socket': "):
            write_text(Path("socket"), "text", named=True)
        assert stat.S_ISSOCK(os.stat("socket").st_mode)


@pytest.mark.parametrize("where", ["/dev/stdout", "/proc/self/fd/1"])
def test_standard_output_goes_on_where_it_was(tmp_path, where):
    script = (
        "from pathlib import Path; from oarlock.base.files import write_text; "
        f"print('before'); write_text(Path({where!r}), 'text\\n', named=True); print('after')"
    )
    with (tmp_path / "out").open("w") as out:
        subprocess.run([sys.executable, "-c", script], stdout=out, check=True)
    assert (tmp_path / "out").read_text() == "before\ntext\nafter\n"
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True).stdout == (
        "before\ntext\nafter\n"
    )


@pytest.mark.parametrize("name", ["folder", "a\0b", "round", "file/below", "x" * 300])
def test_what_cannot_be_written_is_one_line(tmp_path, name):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("")
    (tmp_path / "round").symlink_to("round")
    with pytest.raises(InputError, match=r"^cannot write '") as caught:
        write_text(tmp_path / name, "text", named=True)
    assert "\n" not in str(caught.value)
    assert sorted(os.listdir(tmp_path)) == ["file", "folder", "round"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_pipe_that_nobody_reads_can_be_interrupted(tmp_path, monkeypatch, number):
    """Opening it waits for its other end: SIGINT ends that, and what was to be written is gone, at the next start at
    the latest."""
    pipe, other = tmp_path / "pipe", tmp_path / "temporary"
    os.mkfifo(pipe)
    other.mkdir()
    code = "import sys, pathlib; from oarlock.base.files import write_text\nprint('begun', flush=True)\n"
    code += "write_text(pathlib.Path(sys.argv[1]), 'text', named=True)"
    command, here = [sys.executable, "-c", code, str(pipe)], {**os.environ, "TMPDIR": str(other)}
    with subprocess.Popen(command, env=here, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        process.stdout.readline()
        while not os.listdir(other):  # until it is about to open the pipe
            time.sleep(0.01)
        time.sleep(0.1)
        process.send_signal(number)
        process.wait(timeout=10)
    monkeypatch.setattr(tempfile, "tempdir", str(other))
    assert bool(sweep_up()) is (number == signal.SIGKILL)
    assert os.listdir(other) == []
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.parametrize("kind", ["link", "dangling", "round", "pipe", "folder link"])
def test_a_file_of_ours_takes_its_place_whatever_stands_there(tmp_path, kind):
    """A folder of results may come from somebody else: a link in it is no wish of the user's."""
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "theirs").write_text("theirs")
    path = tmp_path / "summary.json"
    leads = {"link": "far/theirs", "dangling": "far/gone", "round": path.name, "folder link": "far"}
    os.mkfifo(path) if kind == "pipe" else path.symlink_to(leads[kind])
    write_text(path, "ours")
    assert stat.S_ISREG(path.lstat().st_mode)
    assert path.read_text() == "ours"
    assert os.listdir(tmp_path / "far") == ["theirs"]
    assert (tmp_path / "far" / "theirs").read_text() == "theirs"


def test_a_name_may_be_as_long_as_names_of_files_may_be(tmp_path):
    name = "n" * 250 + ".json"
    write_text(tmp_path / name, "text")
    assert os.listdir(tmp_path) == [name]


def test_two_threads_may_write_one_file(tmp_path):
    texts = [letter * 100_000 for letter in "abcd"]
    threads = [threading.Thread(target=write_text, args=(tmp_path / "one", text)) for text in texts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (tmp_path / "one").read_text() in texts
    assert os.listdir(tmp_path) == ["one"]


def test_no_other_file_of_the_package_replaces_or_opens_files_to_write():
    """All writing goes through one place; here are the exceptions, each with its reason."""
    allowed = {
        "base/files.py",  # is the place
        "render/folder.py",  # folders, of files that went through it
        "scaffold/scaffold.py",  # the same
        "tables/spool.py",  # its own temporary files
        "batch/workers.py",  # a trial whether a folder can be written to
        "mechanics/mjcf.py",  # copies into a new folder of its own
        "diagnosis/edit/copy.py",  # inside ``replacing``
        "diagnosis/sampling.py",  # the same
        "experiments/problems.py",  # the same
        "mechanics/given.py",  # stand-ins in the process's own temporary folder
        "engines/asking.py",  # a question in a temporary folder, of which nothing is kept
        "engines/environments.py",  # a folder of an environment, whole or not at all
        "engines/programs/shared/family.py",  # runs elsewhere, and answers in a temporary folder
        "tables/folder.py",  # the same
    }
    import oarlock

    home = Path(oarlock.__file__).parent
    writing = (
        "os.replace(",
        ".write_text(",
        ".write_bytes(",
        "NamedTemporaryFile(",
        'open("w',
        "copyfile(",
        "os.rename(",
    )
    found = {
        str(path.relative_to(home))
        for path in home.rglob("*.py")
        if "models" not in path.parts and any(word in path.read_text() for word in writing)
    }
    assert found <= allowed
