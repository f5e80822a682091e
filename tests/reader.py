"""A reader who does what a document says, from its first block to its last, in a folder that looks like a checkout."""

import contextlib
import io
import os
import shutil
import stat
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml
from fences import Block, commands
from oarlock.cases.case_file import CaseFile, read_case_file
from oarlock.cli.app import app
from places import FIXTURES, REPOSITORY
from shown import missing
from typer.main import get_command

PATIENCE_S = 600

CHECKOUT = ("tests", "examples", "mjcf", "reports", "docs", "Cargo.toml")
"""What a reader's folder has of the repository, as links."""

_GRIPPER = FIXTURES / "check" / "gripper_2f"
READERS = {
    "my_gripper.xml": _GRIPPER / "gripper_2f.xml",
    "defaults.xml": _GRIPPER / "defaults.xml",
    "my_linkage.xml": FIXTURES / "check" / "pin_collision.xml",
    "path/to/model.xml": REPOSITORY / "mjcf" / "four_bar" / "model.xml",
    "mine.xml": REPOSITORY / "mjcf" / "four_bar" / "model.xml",
    "arm.xml": FIXTURES / "check" / "pin_collision.xml",
    "arm.urdf": FIXTURES / "closing" / "four_bar.urdf",
    "robots/one.xml": REPOSITORY / "mjcf" / "four_bar" / "model.xml",
    "robots/other.xml": FIXTURES / "check" / "pin_collision.xml",
}
"""Names that documents give to a file of the reader's → what stands in for it."""

RENAMED = {"arm.urdf": {"closing_pin_1": "tip_a", "closing_pin_2": "tip_b"}}
"""A file of the reader's → what documents call things in it."""

OWN_SOLVER = """import numpy as np

def my_solver(A, b):
    return np.linalg.lstsq(A, b, rcond=1e-10)[0]
"""

STAND_INS = {
    # Whether the target is there, and not what it takes an hour to do: CI does that.
    "make": f'exec /usr/bin/env -i PATH="$REAL_PATH" make --dry-run -C "{REPOSITORY}" "$@" > /dev/null',
    # It is installed; tests/packaging installs the wheel and builds the sources.
    "pip": 'case "$*" in "install oarlock"|"install .") ;; *) echo "pip $*: not known" >&2; exit 1;; esac',
}
"""Programs that are not run → what is done in their place."""


class Reader:
    """One reader of one document.

    Args:
        folder: an empty one.
        slow: whether to run blocks that take long, too.
    """

    def __init__(self, folder: Path, slow: bool):
        self._home, self._slow = folder / "reader", slow
        self._home.mkdir()
        self._folder = self._home
        for name in CHECKOUT:
            (self._home / name).symlink_to(REPOSITORY / name)
        for name, source in READERS.items():
            (self._home / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, self._home / name)
        for name, words in RENAMED.items():
            text = (self._home / name).read_text(encoding="utf-8")
            for known, called in words.items():
                text = text.replace(known, called)
            (self._home / name).write_text(text, encoding="utf-8")
        (self._home / "my_module.py").write_text(OWN_SOLVER, encoding="utf-8")
        _write_log(self._home / "arm.xml", self._home / "run.npz")
        programs = folder / "programs"
        programs.mkdir()
        for name, script in {**STAND_INS, "oarlock": _oarlock(), "python": f'exec "{sys.executable}" "$@"'}.items():
            (programs / name).write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
            (programs / name).chmod(0o755 | stat.S_IXUSR)
        self._environment = {
            **os.environ,
            "REAL_PATH": os.environ["PATH"],
            "PATH": f"{programs}:{os.environ['PATH']}",
            "NO_COLOR": "1",
            "CARGO_TARGET_DIR": str(REPOSITORY / "target" / "examples"),
        }
        self._names: dict[str, Any] = {"__name__": "__main__"}

    def play(self, block: Block) -> None:
        """Does what a block says.

        Raises:
            AssertionError: it does not go, or shows something else.
        """
        if block.note == "slow" and not self._slow:
            return
        note = block.note.partition(" ")[0]
        {
            ("console", ""): self._run,
            ("console", "slow"): self._run,
            ("sh", ""): self._run,
            ("sh", "slow"): self._run,
            ("sh", "arguments"): self._parse,
            ("python", ""): self._execute,
            ("python", "slow"): self._execute,
            ("python", "syntax"): lambda block: compile(block.text, "block", "exec"),
            ("toml", ""): lambda block: CaseFile.model_validate({"title": "a block", **tomllib.loads(block.text)}),
            ("toml", "append"): self._append,
            ("xml", ""): lambda block: mujoco.MjSpec.from_string(f"<mujoco>{block.text}</mujoco>"),
            ("yaml", ""): lambda block: yaml.safe_load(block.text),
            ("rust", ""): _quote,
        }[block.language, note](block)

    def _run(self, block: Block) -> None:
        asked = commands(block)
        mark = "@@end of a command@@"
        script = "".join(
            f"{command.text}\n__status=$?; printf '\\n%s %s\\n' '{mark}' $__status; (exit $__status)\n"
            for command in asked
        )
        script += f"printf '%s' \"$PWD\" > '{self._home.parent / 'where'}'\n"
        done = subprocess.run(
            ["bash", "-c", script],
            cwd=self._folder,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            encoding="utf-8",
            timeout=PATIENCE_S,
            check=False,
        )
        outputs = done.stdout.split(f"\n{mark} ")
        assert len(outputs) == len(asked) + 1, f"line {block.line}: {done.stdout}"
        for number, command in enumerate(asked):
            output = outputs[number].partition("\n")[2] if number else outputs[number]
            status = int(outputs[number + 1].partition("\n")[0])
            expects_failure = number + 1 < len(asked) and asked[number + 1].text == "echo $?"
            differs = command.text.startswith("diff ") and status == 1
            assert status == 0 or expects_failure or differs, f"line {block.line}: $ {command.text}\n{output}"
            line = missing(command.shown, output)
            assert line is None, f"line {block.line}: $ {command.text}\nexpected: {line}\ngot:\n{output}"
        self._folder = Path((self._home.parent / "where").read_text(encoding="utf-8"))

    def _parse(self, block: Block) -> None:
        """Commands that would take minutes: only whether they understand their arguments."""
        for command in commands(block):
            program, name, *arguments = command.text.partition("#")[0].split()
            assert program == "oarlock", command
            get_command(app).commands[name].make_context(name, arguments)  # type: ignore[attr-defined]

    def _execute(self, block: Block) -> None:
        code = compile(block.text, f"block at line {block.line}", "exec")
        before = Path.cwd()
        os.chdir(self._folder)
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                exec(code, self._names)
        finally:
            os.chdir(before)

    def _append(self, block: Block) -> None:
        path = self._home / block.note.removeprefix("append to ")
        path.write_text(path.read_text(encoding="utf-8") + "\n" + block.text, encoding="utf-8")
        read_case_file(path)


def _write_log(model: Path, log: Path) -> None:
    """What a program notes that steps the model for a fifth of a second."""
    loaded = mujoco.MjModel.from_xml_path(str(model))
    data = mujoco.MjData(loaded)
    rows: dict[str, list[Any]] = {name: [] for name in ("time", "qpos", "qvel", "ctrl")}
    for _ in range(100):
        for name, values in rows.items():
            values.append(np.copy(getattr(data, name)))
        mujoco.mj_step(loaded, data)
    np.savez(log, **rows)  # type: ignore[arg-type]


def _quote(block: Block) -> None:
    """A shortened quotation of the example: every line that is whole stands in it."""
    sources = [path.read_text(encoding="utf-8") for path in (REPOSITORY / "examples" / "rust").glob("*/src/*.rs")]
    known = {" ".join(line.split()) for source in sources for line in source.splitlines()}
    for line in block.text.splitlines():
        whole = " ".join(line.partition("…")[0].split())
        assert not whole or any(one.startswith(whole) for one in known), f"line {block.line}: {line}"


def _oarlock() -> str:
    return f'exec "{sys.executable}" -c "from oarlock.cli.app import main; main()" "$@"'
