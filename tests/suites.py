"""What the tests of the suite have in common: a small case, models that misbehave, a suite that is done."""

import os
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path

from mechanisms import COMMAND, four_bar, write_model
from oarlock.base.processes import myself
from oarlock.base.progress import Progress
from oarlock.base.pulse import beat
from oarlock.batch.suite import carry_out, plan_suite
from oarlock.batch.unit import run_unit
from oarlock.tables.folder import ResultFolder

TINY = """title = "tiny"
summary = "Ten steps."
[run]
duration_s = 0.02
[[experiments]]
mode = "calibration"
[[experiments]]
mode = "lockstep"
forms = ["matched", "hard"]
solvers = ["pinv", "sr1"]
[[experiments]]
mode = "free"
forms = ["hard"]
solvers = ["mujoco", "pinv"]
[[gates]]
figure = "drift_pos_max"
where = { mode = "free", form = "hard" }
max = 1e-3
cause = "ten steps"
"""
UNITS = 4
"""Of ``TINY``: the calibration, the lockstep with its four runs, two free runs."""

SILENCE_S = 3.0
"""Time that items may be silent in tests, s: longer than a beat and what a busy machine adds."""

STRICT = TINY.replace("max = 1e-3", "max = 1e-30")

KILL = "os.kill(os.getpid(), signal.SIGKILL)"
KILL_ONCE = f"(HERE.parent / 'was_here').exists() or ((HERE.parent / 'was_here').touch(), {KILL})"


class Heard(Progress):
    """All that was heard of some work."""

    def __init__(self):
        self.ahead, self.done, self.names = 0, 0, []

    def begin(self, what, total, kept=0):
        self.ahead, self.done = total, kept

    def advance(self, count):
        self.done += count

    def finished(self, label, seconds=None, message=""):
        self.names.append(label)


class Counter(Progress):
    """Which units were done, and what was said of them."""

    def __init__(self):
        self.said = {}

    def finished(self, label, seconds=None, message=""):
        self.said[label] = message


def carried_out(models, out, workers, **options):
    """A suite, done; how many units it repeated is in it."""
    suite = plan_suite([str(model) for model in models], out)
    carry_out(suite, workers, **options)
    return suite


def python_model(folder, body, case=TINY):
    """A case whose model is the four-bar, after ``body`` was executed."""
    write_model(folder, four_bar(), case)
    (folder / "model.xml").rename(folder / "bar.xml")
    (folder / "model.py").write_text(
        "import os, pathlib, signal\n"
        "import mujoco\n"
        "HERE = pathlib.Path(__file__).parent\n"
        f"def build():\n    {body}\n    return mujoco.MjSpec.from_file(str(HERE / 'bar.xml'))\n"
    )
    return folder


def noted(unit):
    """Does a unit and notes when it begins and ends, beside its case; the one named in ``wait_for_death`` waits."""
    beside = Path(unit.case).parent
    with (beside / "notes").open("a") as file:
        file.write(f"begins {unit.name} {os.getpid()}\n")
    victim = beside / "wait_for_death"
    if victim.exists() and victim.read_text() == unit.name:
        time.sleep(60)
    outcome = run_unit(unit)
    with (beside / "notes").open("a") as file:
        file.write(f"ends {unit.name} {os.getpid()}\n")
    return outcome


def notes(folder):
    """What ``noted`` noted: event, unit, process."""
    path = folder / "notes"
    return [tuple(line.split()) for line in path.read_text().splitlines()] if path.exists() else []


def interrupted_and_resumed(tmp_path, *options):
    """A suite that is interrupted as from a terminal, the whole group of processes, and then done to its end."""
    folder = write_model(tmp_path / "long", four_bar(), TINY.replace("0.02", "4.0")).parent
    arguments = [COMMAND, "suite", folder, "--out", tmp_path / "out", "--jobs", "2", *options]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        arguments, stdout=pipe, stderr=pipe, encoding="utf-8", cwd=tmp_path, start_new_session=True
    ) as process:
        deadline = time.monotonic() + 60
        while not list((tmp_path / "out" / "long").glob("steps/*.parquet")):
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.01)
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    assert "Traceback" not in err
    assert err.endswith("oarlock: interrupted; the runs that were finished are kept\n")
    (member,) = plan_suite([str(folder)], tmp_path / "out").members
    finished = [unit for unit in member.units if member.ledger.finished(unit.name, unit.digest)]
    assert 1 <= len(finished) < UNITS
    assert ResultFolder(tmp_path / "out" / "long").read_json("summary.json")["runs"] == member.ledger.rows()
    assert not [path for path in (tmp_path / "out").rglob("*") if path.name.startswith(".")]
    again = subprocess.run(arguments, capture_output=True, encoding="utf-8", cwd=tmp_path, timeout=120, check=False)
    assert again.returncode == 0, again.stderr
    assert f"running: {len(finished)} of {UNITS} kept from before" in again.stderr
    return err


def told_where(note):
    """Writes the number of this process to a file, and does not come to an end."""
    path = Path(note)
    path.with_suffix(".new").write_text(str(os.getpid()))
    path.with_suffix(".new").rename(path)
    time.sleep(600)


def stopped_once(item):
    """Stops this process, where the item is the first and was not here before."""
    path = Path(item)
    if path.name == "a" and not path.exists():
        path.touch()
        os.kill(os.getpid(), signal.SIGSTOP)
    return f"{item} done"


def stopped_twice(item):
    """Stops this process, where the item is the first."""
    if Path(item).name == "a":
        os.kill(os.getpid(), signal.SIGSTOP)
    return f"{item} done"


def slow_with_a_pulse(item):
    """Takes twice as long as an item may be silent, and is never silent for so long."""
    path = Path(item)
    with path.open("a") as file:
        file.write("begun\n")
    ends = time.monotonic() + 2 * SILENCE_S
    while time.monotonic() < ends:
        time.sleep(0.1)
        beat()
    return path.read_text().count("begun")


def late_once(item):
    """Is silent for twice as long as it may be, where it was not here before; then it ends."""
    path = Path(item)
    if not path.exists():
        path.touch()
        time.sleep(2 * SILENCE_S)
        return "late"
    return "in time"


def alive(process):
    """Whether there is a process of that number that has not ended."""
    return not replace(myself(), pid=process, started=0).dead
