"""MuJoCo's fatal errors are one line, with status 2, whichever command meets them, and no file is left of warnings."""

import re

import mujoco
import oarlock
import pytest
from mechanisms import four_bar, write_model

BOXES = "".join(
    f'<body pos="{0.12 * index} 0 0.051"><freejoint/><geom type="box" size="0.05 0.05 0.05" mass="0.3"/></body>'
    for index in range(36)
)


def short_of_memory(memory):
    """A four-bar beside boxes on a floor, whose contacts need more memory than the model reserves."""
    text = four_bar(rest=f'<size memory="{memory}"/>')
    text = text.replace('contype="0" conaffinity="0"/></default>', "/></default>")
    floor = '<geom type="plane" size="9 9 0.1" contype="1" conaffinity="1"/>'
    text = re.sub(r"<geom fromto", '<geom contype="0" conaffinity="0" fromto', text)
    return text.replace("<worldbody>", f"<worldbody>{floor}{BOXES}", 1)


NEW = ("new", "fresh", "--to", ".")
COMMANDS = [
    ("run",),
    ("run", "--ignore-inequalities", "--mode", "free", "--duration", "0.01"),
    ("check", "--budget", "0", "--duration", "0.1"),
    ("suite", "--jobs", "1"),
    NEW,
]


def _tried(memory, arguments):
    # With memory enough, a case of 36 boxes takes minutes to measure.
    marks = [pytest.mark.slow] if arguments is NEW and memory in ("5M", "600K") else []
    return pytest.param(memory, arguments, id=f"{memory}-{'-'.join(arguments[:2])}", marks=marks)


@pytest.mark.parametrize(
    ("memory", "arguments"), [_tried(memory, one) for memory in ("5M", "600K", "40K", "1K") for one in COMMANDS]
)
def test_commands(tmp_path, oarlock_here, memory, arguments):
    path = write_model(tmp_path / "memory", short_of_memory(memory), 'title = "m"\nrun.duration_s = 0.004\n')
    command, *rest = arguments
    finished = oarlock_here(
        command, *(rest[:1] if command == "new" else ()), path, *(rest[1:] if command == "new" else rest)
    )
    assert finished.returncode in (0, 2), finished.stderr
    assert "Traceback" not in finished.stderr
    said = [line for line in finished.stderr.splitlines() if line.startswith("oarlock: ")]
    assert said or finished.returncode == 0
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_the_function_says_the_same(tmp_path, monkeypatch):
    def stop(*_, **__):
        raise mujoco.FatalError("mj_stackAlloc: out of memory\n  max = 1")

    monkeypatch.setattr("oarlock.experiments.session.Laboratory", stop)
    with pytest.raises(oarlock.InputError, match=r"^MuJoCo cannot go on: mj_stackAlloc: out of memory max = 1$"):
        oarlock.run(write_model(tmp_path / "bar", four_bar()))


def test_warnings_as_errors_are_a_line(tmp_path, oarlock_here, monkeypatch):
    def warn(*_, **__):
        raise UserWarning("something is old\nand long")

    monkeypatch.setattr("oarlock.experiments.session.run_beside", warn)
    finished = oarlock_here("run", write_model(tmp_path / "old", four_bar()))
    assert (finished.returncode, finished.stderr) == (2, "oarlock: something is old and long\n")
