"""What holds for every command: help with an example, versions, completion, one line for a mistake, plain terminals."""

import os
import pty
import re
import shlex
import subprocess
import sys
from pathlib import Path

import mujoco
import oarlock
import pytest
from mechanisms import COMMAND, four_bar, write_model
from oarlock.cli.app import COMMANDS, app
from oarlock.cli.console import STATUSES
from oarlock.cli.examples import EXAMPLES
from places import REPOSITORY
from typer.main import get_command


def complaint(finished):
    """The one line of arguments that are not understood."""
    assert (finished.returncode, finished.stdout) == (2, "")
    (line,) = finished.stderr.splitlines()
    return line


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ("run boat --duration soon", "oarlock: run: --duration = soon, expected a number"),
        ("run boat --seed 1.5", "oarlock: run: --seed = 1.5, expected a whole number"),
        ("run boat --seed", "oarlock: run: --seed without a value, expected --seed N"),
        ("run boat --durtion 3", "oarlock: run: unknown option '--durtion', expected --duration"),
        ("run boat --zzz", "oarlock: run: unknown option '--zzz', expected one of oarlock run --help"),
        ("bench --rounds 0", "oarlock: bench: --rounds = 0, expected ≥ 1"),
        ("suite --unit-timeout -1", "oarlock: suite: --unit-timeout = -1, expected ≥ 0"),
        ("suite --jobs=", "oarlock: suite: --jobs = nothing, expected a whole number"),
        ("list --json=3", "oarlock: list: --json with a value, expected none"),
        ("list extra", "oarlock: list: unexpected argument 'extra', expected 'oarlock list [OPTIONS]'"),
        ("diff a", "oarlock: diff: no B, expected 'oarlock diff [OPTIONS] {A} {B}'"),
        ("chek boat", "oarlock: unknown command 'chek', expected check"),
        ("dance", f"oarlock: unknown command 'dance', expected one of: {', '.join(COMMANDS)}"),
        ("--bogus", "oarlock: unknown option '--bogus', expected one of oarlock --help"),
    ],
)
def test_a_line_names_what_was_given_and_what_is_expected(oarlock_here, arguments, line):
    assert complaint(oarlock_here(*arguments.split())) == line


@pytest.mark.parametrize("argument", ["\u202egnp", "\x1b[2J", "a\nb", "9" * 5000, "'", "%s {x}"])
@pytest.mark.parametrize("arguments", ["list {}", "check x --seed {}", "run x --{}", "{} x"])
def test_arguments_are_shown_as_text(oarlock_here, arguments, argument):
    line = complaint(oarlock_here(*(word.format(argument) for word in arguments.split())))
    assert line.isprintable()
    assert len(line) < 1000


def test_no_arguments_show_the_help(oarlock_here):
    finished = oarlock_here()
    assert (finished.returncode, finished.stdout) == (2, "")
    assert finished.stderr == oarlock_here("--help").stdout


# Help.


def test_every_command_has_an_example():
    assert list(EXAMPLES) == list(COMMANDS)


@pytest.mark.parametrize("name", list(COMMANDS))
def test_help_ends_with_an_example_that_is_understood(oarlock_here, name):
    said = " ".join(oarlock_here(name, "--help").stdout.split())
    assert said.endswith(f"Example: {EXAMPLES[name]}")
    program, command, *arguments = shlex.split(EXAMPLES[name])
    assert (program, command) == ("oarlock", name)
    parsed = get_command(app).commands[name].make_context(name, arguments)
    assert [value for value in parsed.params.values() if value]


def statuses_of(text):
    """Rows of a Markdown table of statuses."""
    return {int(status): meaning for status, meaning in re.findall(r"^\| (\d+) \| (.+?) \|$", text, re.MULTILINE)}


def test_exit_statuses_are_one_table(oarlock_here):
    told = " ".join(oarlock_here("--help").stdout.partition("Exit status:")[2].split())
    assert told == " ".join(f"{status} {meaning}" for status, meaning in STATUSES.items())
    for document in ("README.md", "docs/command.md"):
        assert statuses_of((REPOSITORY / document).read_text(encoding="utf-8")) == STATUSES


def test_versions(oarlock_here):
    finished = oarlock_here("--version")
    versions = f"oarlock {oarlock.__version__}, mujoco {mujoco.__version__}, python {sys.version.split()[0]}\n"
    assert (finished.returncode, finished.stdout, finished.stderr) == (0, versions, "")


def test_the_package_is_a_command():
    finished = subprocess.run(
        [sys.executable, "-m", "oarlock", "--version"], capture_output=True, encoding="utf-8", check=True
    )
    assert finished.stdout.startswith("oarlock ")


# Completion.


def completed(words, tmp_path):
    """What the shell is offered, and whether a command was loaded for it."""
    script = (
        "import atexit, sys; atexit.register(lambda: print(*sys.modules, file=sys.stderr)); "
        "from oarlock.cli.app import main; main()"
    )
    asked = {"_OARLOCK_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)}
    finished = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, **asked},
        cwd=tmp_path,
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    return finished.stdout.split(), finished.stderr.split()


def test_names_of_commands_are_completed_without_loading_one(tmp_path):
    offered, loaded = completed("oarlock s", tmp_path)
    assert offered == [name for name in COMMANDS if name.startswith("s")]
    assert [name for name in loaded if name in ("mujoco", "numpy", "polars", "rich.console")] == []


def test_options_are_completed(tmp_path):
    offered, _ = completed("oarlock check --write", tmp_path)
    assert offered == ["--write-keyframe", "--write-tuned"]


# Terminals.


def on_a_terminal(arguments, folder, **environment):
    """What a command writes to a terminal of 80 columns: both streams."""
    ours, theirs = pty.openpty()
    bare = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR")}
    size = {"COLUMNS": "80", "LINES": "24", "TERM": "xterm-256color"}
    with subprocess.Popen(
        [COMMAND, *map(str, arguments)], env={**bare, **size, **environment}, cwd=folder, stdout=theirs, stderr=theirs
    ) as process:
        os.close(theirs)
        said = b""
        while True:
            try:
                part = os.read(ours, 1 << 16)
            except OSError:  # the other end has gone
                break
            if not part:
                break
            said += part
    os.close(ours)
    return process.returncode, said.decode()


@pytest.fixture(scope="module")
def bar_model(tmp_path_factory):
    return write_model(tmp_path_factory.mktemp("bar"), four_bar())


CHECK = ("--budget", "0", "--duration", "0.05")


@pytest.mark.parametrize(
    ("environment", "plain"), [({}, False), ({"NO_COLOR": "1"}, True), ({"TERM": "dumb"}, True)], ids=str
)
def test_nothing_is_coloured_where_that_is_not_wanted(bar_model, environment, plain):
    status, said = on_a_terminal(["check", bar_model, *CHECK, "--quiet"], bar_model.parent, **environment)
    assert status == 0
    assert ("\x1b" not in said) is plain


def test_a_text_terminal_has_no_bar(bar_model):
    assert "\x1b" not in on_a_terminal(["check", bar_model, *CHECK], bar_model.parent, TERM="dumb")[1]


@pytest.mark.parametrize("command", ["run", "new", "suite", "check", "bench"])
def test_what_shows_progress_can_be_quiet(oarlock_here, command):
    assert re.search(r"-q\b.*--quiet|--quiet.*-q\b", oarlock_here(command, "--help").stdout)


def test_a_quiet_suite_says_nothing_of_its_progress(oarlock_here, tiny):
    loud, quiet = (oarlock_here("suite", tiny, "--out", out, *flag) for out, flag in (("a", ()), ("b", ("--quiet",))))
    assert (loud.returncode, quiet.returncode) == (0, 0)
    assert len(quiet.stderr.splitlines()) < len(loud.stderr.splitlines())
    assert set(quiet.stderr.splitlines()) <= set(loud.stderr.splitlines())


def test_a_bar_is_not_shown_if_quiet(bar_model):
    _, said = on_a_terminal(["check", bar_model, *CHECK, "--quiet", "--json", "-"], bar_model.parent)
    assert said.startswith("{")
    assert Path(bar_model).is_file()
