"""Logs of controls: read as written, held between rows, and refused in one line that names what is wrong."""

from pathlib import Path

import numpy as np
import pytest
from oarlock import InputError
from oarlock.mechanics.control_log import ControlLog

ACTUATORS = ["lift", "#1"]
TIME = np.array([0.0, 0.01, 0.03])
LIFT = np.array([1.0, -0.1, 1.0 / 3.0])


def written(folder: Path, text: str) -> Path:
    path = folder / "log.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_both_kinds_of_files_say_the_same(tmp_path):
    rows = "".join(f"{time!r},{value!r}\n" for time, value in zip(TIME.tolist(), LIFT.tolist(), strict=True))
    np.savez(tmp_path / "log.npz", time=TIME, lift=LIFT)
    for path in (written(tmp_path, f"\ufefftime, lift\r\n{rows}\n"), tmp_path / "log.npz"):
        log = ControlLog(path, ACTUATORS)
        law = log.laws()["lift"]
        assert [law.at(time) for time in (-1.0, 0.0, 0.005, 0.01, 0.029, 0.03, 9.0)] == [*LIFT[[0, 0, 0, 1, 1, 2, 2]]]
        assert str(log) == f"log '{path}' (3 rows from 0 to 0.03 s, each held until the next)"


def test_times_are_sums_of_timesteps_and_rounded(tmp_path):
    """A row of every step is met at every step, though 0.1 + 0.2 is not 0.3."""
    time = np.arange(1000) * 0.001
    np.savez(tmp_path / "log.npz", time=time, lift=np.arange(1000.0))
    law, now = ControlLog(tmp_path / "log.npz", ACTUATORS).laws()["lift"], 0.0
    for step in range(1000):
        assert law.at(now) == step
        now += 0.001


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no column 'time'"),
        ("t,lift\n0,1\n", "no column 'time', expected one, in s"),
        ("time\n0\n", "no column besides 'time', expected actuators: lift, #1"),
        ("time,lift\n", "no rows, expected at least one"),
        ("time,grip\n0,1\n", "column 'grip', expected one of: lift, #1"),
        ("time,lift,lift\n0,1,1\n", "column 'lift' is there twice"),
        ("time,lift\n0,1\n0.1\n", "row 2 has 1 values, expected 2"),
        ("time,lift\n0,1\n0.1,up\n", "column 'lift', row 2: 'up', expected a finite number"),
        ("time,lift\n0,1\n0.1,1e999\n", "column 'lift', row 2: '1e999', expected a finite number"),
        ("time,lift\n0,1\n0.2,1\n0.1,1\n", "column 'time', row 3: 0.1 after 0.2, expected a later time"),
        ('time,lift\n0,"1\n', "not a CSV file"),
    ],
)
def test_a_bad_table_is_one_line(tmp_path, text, said):
    with pytest.raises(InputError) as raised:
        ControlLog(written(tmp_path, text), ACTUATORS)
    assert said in str(raised.value)
    assert "log.csv" in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"lift": LIFT}, "no column 'time'"),
        ({"time": TIME, "lift": LIFT[:2]}, "column 'lift' has 2 values, expected 3"),
        ({"time": TIME, "lift": LIFT[:, None]}, "column 'lift' is an array of float64 of the shape (3, 1)"),
        ({"time": TIME, "lift": np.array(["a", "b", "c"])}, "column 'lift' is an array of <U1"),
        ({"time": TIME, "lift": np.array([0.0, np.nan, 0.0])}, "column 'lift', row 2: nan, expected a finite number"),
        ({"time": TIME, "lift": np.array([{}, {}, {}])}, "not an NPZ file of arrays of numbers"),
    ],
)
def test_bad_arrays_are_one_line(tmp_path, arrays, said):
    np.savez(tmp_path / "log.npz", **arrays)
    with pytest.raises(InputError) as raised:
        ControlLog(tmp_path / "log.npz", ACTUATORS)
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)


def test_what_is_no_file_is_one_line(tmp_path):
    (tmp_path / "log.npz").write_bytes(b"PK\x03\x04 no archive")
    for path, said in ((tmp_path / "log.npz", "not an NPZ file"), (tmp_path / "none.csv", "cannot be read")):
        with pytest.raises(InputError, match=said):
            ControlLog(path, ACTUATORS)
