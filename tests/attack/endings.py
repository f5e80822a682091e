"""Ends suites by signals at random moments and resumes them; begins runs and suites in one folder.

A suite stood if its status is one that is documented, if no process of it is left after five seconds, if it is
resumed without a complaint, leaves no temporary file or folder then, and if all that it left equals what an undisturbed
one leaves, but for timings and the occasion.

    cd tests && ../.venv/bin/python -m attack.endings --tries 100 --seed 0 --seconds 900
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import polars as pl
from mechanisms import COMMAND, four_bar, write_model
from oarlock.tables import checksums
from oarlock.tables.figures import TIMING_FIGURES
from oarlock.tables.folder import OCCASION
from suites import TINY
from tolerances import GONE_S, SOON_S

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
TIMINGS = ("step_us", "solve_ns")
"""Columns of tables."""
EXACT = {".md", ".svg"}
"""Endings of files that are the same byte by byte."""
LIMIT_S = 120.0
"""Time after which a command counts as hanging, s."""
KINDS = ([], ["--scheduler", "local"], ["--sweep", "seed=1:3:3"])
"""Ways to run a suite: mostly the first."""


def main(arguments: list[str]) -> int:
    """Tries, and prints what was tried and what stood; 1 if anything fell."""
    parser = argparse.ArgumentParser(prog="attack.endings", description="Ends suites by signals, and resumes them.")
    parser.add_argument("--tries", type=int, default=100, help="suites that are ended")
    parser.add_argument("--pairs", type=int, default=12, help="pairs in one folder")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=900.0, help="time after which nothing new is begun")
    asked = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="attack-") as folder:
        place = Place(Path(folder))
        until = time.monotonic() + asked.seconds
        fell = report("suites ended by a signal", ended_suites(place, asked.tries, asked.seed, until))
        fell += report("two in one folder", pairs(place, asked.pairs, asked.seed, until))
    return min(fell, 1)


def report(what: str, complaints: Iterator[str]) -> int:
    """Prints what fell as soon as it did, then the count; gives how many fell."""
    tried, fell = 0, 0
    for complaint in complaints:
        tried += 1
        if complaint:
            fell += 1
            print(f"fell: {complaint}", flush=True)
    print(f"{what}: {tried} tried, {tried - fell} right", flush=True)
    return fell


class Place:
    """A folder for one attack after another, with two small cases and what undisturbed suites of them leave."""

    def __init__(self, root: Path):
        self.root = root
        self.temporary = root / "tmp"
        self.models = [write_model(root / name, four_bar(), TINY.replace("0.02", "2.0")).parent for name in ("a", "b")]
        self._expected: dict[int, tuple[dict[str, Any], float]] = {}

    def expected(self, kind: int) -> tuple[dict[str, Any], float]:
        """What an undisturbed suite of a kind leaves, and the time that it takes, s."""
        if kind not in self._expected:
            self.clear()
            began = time.monotonic()
            done = self.run(*self.suite(kind))
            took = time.monotonic() - began
            if done.returncode:
                raise RuntimeError(f"undisturbed, it ends with {done.returncode}: {done.stderr[-500:]}")
            self._expected[kind] = contents(self.root / "out"), took
        return self._expected[kind]

    def clear(self) -> None:
        """Makes room for the next."""
        for name in ("out", "tmp"):
            shutil.rmtree(self.root / name, ignore_errors=True)
        self.temporary.mkdir()

    def suite(self, kind: int) -> list[str]:
        """The arguments of a suite of a kind."""
        return ["suite", *map(str, self.models), "--out", "out", "--jobs", "2", *KINDS[kind]]

    def begin(self, *arguments: str, says: str = "stderr") -> "subprocess.Popen[str]":
        """Begins a command, which says what it says to a file of that name."""
        with (self.root / says).open("w") as said:
            return subprocess.Popen(
                [COMMAND, *arguments],
                cwd=self.root,
                env={**os.environ, "TMPDIR": str(self.temporary)},
                stdout=subprocess.DEVNULL,
                stderr=said,
                encoding="utf-8",
                start_new_session=True,
            )

    def run(self, *arguments: str) -> "subprocess.CompletedProcess[str]":
        """Runs a command to its end."""
        process = self.begin(*arguments)
        try:
            status = process.wait(LIMIT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            status = process.wait()
        return subprocess.CompletedProcess(arguments, status, "", self.said())

    def said(self) -> str:
        """What the last command said on standard error."""
        return (self.root / "stderr").read_text(errors="replace")

    def processes(self) -> list[int]:
        """Processes that were begun here and still live, as far as the system tells."""
        found = []
        mark = f"TMPDIR={self.temporary}".encode()
        for path in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                if mark in (path / "environ").read_bytes().split(b"\0"):
                    found.append(int(path.name))
        return found

    def left(self) -> list[str]:
        """Temporary files and folders, and locks."""
        found = [*self.temporary.iterdir(), *(path for path in self.root.rglob("*") if path.name.startswith("."))]
        return sorted(str(path.relative_to(self.root)) for path in found)


def ended_suites(place: Place, tries: int, seed: int, until: float) -> Iterator[str]:
    """Ends suites; a complaint each, empty if it stood."""
    for number in range(tries):
        if time.monotonic() > until:
            return
        chance = random.Random(f"{seed}-{number}")
        kind = chance.choice([0, 0, 0, 0, 1, 2])
        expected, took = place.expected(kind)
        which, after_s = SIGNALS[number % len(SIGNALS)], chance.uniform(0.0, 1.05 * took)
        place.clear()
        complaint = _ended(place, kind, which, after_s) or _resumed(place, kind, expected)
        how = " ".join(["suite", *KINDS[kind], which.name, f"after {after_s:.3f} s"])
        yield f"{how} (seed {seed}-{number}): {complaint}" if complaint else ""


def _ended(place: Place, kind: int, which: signal.Signals, after_s: float) -> str:
    process = place.begin(*place.suite(kind))
    with suppress(subprocess.TimeoutExpired):
        process.wait(after_s)
    began = time.monotonic()
    process.send_signal(which)
    try:
        status = process.wait(LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        return f"it goes on for {LIMIT_S:g} s"
    took = time.monotonic() - began
    # Before the command is loaded, or after it is done, nobody listens.
    documented = {0, -which} if which is signal.SIGKILL else {0, 130, -which}
    if status not in documented:
        return f"status {status}: {place.said()[-300:]}"
    if status == 130 and took > SOON_S:
        return f"it took {took:.1f} s to end"
    if status in (0, 130) and "Traceback" in place.said():
        return f"it said {place.said()[-300:]}"
    while (left := place.processes()) and time.monotonic() - began < took + GONE_S:
        time.sleep(0.05)
    return f"processes are left: {left}" if left else ""


def _resumed(place: Place, kind: int, expected: dict[str, Any]) -> str:
    done = place.run(*place.suite(kind))
    if done.returncode:
        return f"resumed, it ends with {done.returncode}: {done.stderr[-300:]}"
    if left := place.left():
        return f"left behind: {left}"
    found = contents(place.root / "out")
    if found.keys() != expected.keys():
        return f"other files: {sorted(found.keys() ^ expected.keys())}"
    different = [name for name in expected if found[name] != expected[name]]
    return f"not the same: {different}" if different else ""


def pairs(place: Place, count: int, seed: int, until: float) -> Iterator[str]:
    """Begins two commands in one folder; a complaint each pair, empty if both are right or the second is refused."""
    case = str(place.models[0])
    run = ["run", case, "--out", "out/a"]
    commands = [(place.suite(0), place.suite(0)), (place.suite(0), run), (run, place.suite(0)), (run, run)]
    for number in range(count):
        if time.monotonic() > until:
            return
        chance = random.Random(f"pair-{seed}-{number}")
        one, other = commands[number % len(commands)]
        place.clear()
        first = place.begin(*one, says="stderr of the first")
        time.sleep(chance.choice([0.0, chance.uniform(0.0, 2.0)]))
        second = place.run(*other)
        statuses = (first.wait(LIMIT_S), second.returncode)
        refused = "is in use by" in second.stderr or "holds" in second.stderr or statuses[0] == 2
        complaint = ""
        if sorted(statuses) not in ([0, 0], [0, 2]) or (2 in statuses and not refused):
            complaint = f"statuses {statuses}: {second.stderr[-300:]}"
        elif left := place.left():
            complaint = f"left behind: {left}"
        elif missing := _incomplete(place.root / "out" / "a"):
            complaint = missing
        yield f"{one[0]} and {other[0]} (seed {seed}-{number}): {complaint}" if complaint else ""


def _incomplete(folder: Path) -> str:
    """Says what the summary of a folder names that is not there, and the other way round."""
    rows = {row["run"] for row in json.loads((folder / "summary.json").read_text())["runs"]}
    tables = {path.stem for path in (folder / "steps").glob("*.parquet")}
    return "" if rows == tables and len(rows) == 7 else f"runs {sorted(rows)}, tables {sorted(tables)}"


def contents(out: Path) -> dict[str, Any]:
    """Name of a file in a folder of results → what is the same whenever the same is run."""
    return {str(path.relative_to(out)): _timeless(path) for path in sorted(out.rglob("*")) if path.is_file()}


def _timeless(path: Path) -> Any:
    if path.suffix == ".parquet":
        table = pl.read_parquet(path)
        return table.drop(TIMINGS, strict=False).hash_rows(seed=0).to_list()
    if path.suffix == ".csv":
        return pl.read_csv(path).drop(TIMING_FIGURES, strict=False).hash_rows(seed=0).to_list()
    if path.name in ("summary.json", "case.json", "sketch.json"):
        return _without(json.loads(path.read_text()))
    if path.name == "units.json":
        units = json.loads(path.read_text())["units"]
        return {name: (unit["digest"], unit["status"], sorted(unit["files"])) for name, unit in units.items()}
    return path.read_bytes() if path.suffix in EXACT else None  # pages with timings, and what has checksums of those


def _without(document: Any) -> Any:
    """A document without timings, their checksums and the occasion."""
    if isinstance(document, list):
        return [_without(one) for one in document]
    if not isinstance(document, dict):
        return document
    leave = {*TIMING_FIGURES, *OCCASION, checksums.KEY, "files", "sha256", "seconds"}
    return {key: _without(value) for key, value in document.items() if key not in leave}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
