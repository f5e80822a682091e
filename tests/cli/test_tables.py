"""Tables: figures whole at every width, words wrapped between words, and what does not fit stacked."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import termios

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import COMMAND
from oarlock.cli.tables import laid_out
from places import FIXTURES
from rich.cells import cell_len

HEAD = ["run", "status", "min-norm error (rel)", "drift (m, rad)"]
ROWS = [
    ["lockstep-hard-along-mujoco-pinv-euler", "done", "1.87e-14", "0.000169"],
    ["free-hard-sr1-euler", "unconverged", "0.0201", "3.15e-07"],
]


def lines(head, rows, words, width):
    return [line.text for line in laid_out(head, rows, words, width)]


def test_what_fits_stands_side_by_side():
    assert lines(HEAD, ROWS, 2, 90) == lines(HEAD, ROWS, 2, None)
    assert lines(HEAD, ROWS, 2, None)[1].split() == ROWS[0]


def test_titles_are_wrapped_before_anything_else():
    said = lines(HEAD, ROWS, 2, 80)
    assert max(map(len, said)) <= 80
    assert said[-1].split() == ROWS[1]
    assert len(said) == 4  # the head takes two


def test_what_is_too_wide_is_stacked():
    said = lines(HEAD, ROWS, 2, 60)
    assert max(map(len, said)) <= 60
    assert [line.split() for line in said[-4:]] == [ROWS[0][:2], ROWS[0][2:], ROWS[1][:2], ROWS[1][2:]]


def test_words_are_wrapped_between_words():
    rows = [["connect of 'right_follower' and 'right_coupler'", "3.85e-06"], ["mimic", "–"]]
    said = lines(["equality", "m"], rows, 1, 40)
    assert [line.removesuffix("3.85e-06").strip() for line in said[1:3]] == [
        "connect of 'right_follower'",
        "and 'right_coupler'",
    ]
    assert said[1].endswith("3.85e-06")


words_of = st.lists(
    st.sampled_from(["a", "of", "'right_coupler'", "lockstep-hard-along-mujoco", "–"]), min_size=1, max_size=6
).map(" ".join)
figures = st.sampled_from(["–", "3.85e-06", "-1.20e+03 rad", "0.000169", "100 %"])


@given(
    st.lists(st.tuples(words_of, words_of, *[figures] * 6), min_size=1, max_size=3),
    st.lists(words_of, min_size=8, max_size=8),
    st.integers(0, 2),
    st.integers(20, 200),
)
def test_nothing_is_lost_and_no_figure_is_cut(rows, head, words, width):
    said = list(laid_out(head, rows, words, width))
    for number, row in enumerate(rows):
        own = [line.text for line in said if line.row == number]
        for cell in row[words:]:
            assert any(cell in line for line in own)
        letters = sorted("".join(own).replace(" ", ""))
        assert letters == sorted("".join(row).replace(" ", ""))
    widest = max([cell_len(cell) for row in rows for cell in row[words:]], default=0)
    longest = max(cell_len(word) for row in [head, *rows] for cell in row for word in cell.split())
    assert all(cell_len(line.text) <= max(width, widest + 2, longest + 2) for line in said)


def on_80_columns(*arguments, folder):
    """The lines of a command on a terminal of 80 columns that says so itself."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    with subprocess.Popen(
        [COMMAND, *map(str, arguments)],
        env={**environment, "NO_COLOR": "1", "TERM": "xterm"},
        cwd=folder,
        stdin=theirs,
        stdout=theirs,
        stderr=subprocess.DEVNULL,
    ):
        os.close(theirs)
        said = b""
        while part := _read(ours):
            said += part
    os.close(ours)
    return said.decode().replace("\r\n", "\n").splitlines()


def _read(stream):
    try:
        return os.read(stream, 1 << 16)
    except OSError:  # the other end has gone
        return b""


def test_a_run_can_be_read_at_80_columns(tmp_path):
    asked = ("run", "four_bar", "--duration", "0.05", "--out", "r", "--quiet")
    said = on_80_columns(*asked, folder=tmp_path)
    piped = subprocess.run([COMMAND, *asked], cwd=tmp_path, capture_output=True, encoding="utf-8", check=True).stdout
    *table, motion, verdict = piped.splitlines()
    assert said[-2:] == [motion, verdict]
    assert re.match(r"\d+ runs: ", verdict)
    assert max(map(len, said[:-2])) <= 80
    assert len(table) > 5
    times = re.compile(r"\d+\.\d+e?[-+]?\d*|\d+")
    assert sorted(times.findall(" ".join(said[:-2]))) == sorted(times.findall(" ".join(table)))


@pytest.mark.parametrize("file", [FIXTURES / "check" / "gripper_2f" / "gripper_2f.xml", "four_bar"])
def test_a_check_can_be_read_at_80_columns(tmp_path, file):
    asked = ("check", file, "--budget", "1", "--duration", "0.2", "--quiet")
    said = on_80_columns(*asked, folder=tmp_path)
    piped = subprocess.run([COMMAND, *asked], cwd=tmp_path, capture_output=True, encoding="utf-8", check=True).stdout
    assert "".join("".join(said).split()) != ""
    figures = re.compile(r"-?\d+\.\d\de[-+]\d\d")
    assert sorted(figures.findall("\n".join(said))) == sorted(figures.findall(piped))
    assert said[-1] == piped.splitlines()[-1]
    assert "…" not in "".join(said)
